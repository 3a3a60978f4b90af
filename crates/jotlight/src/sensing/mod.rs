//! From light to bits (paper, section 2.1).
//!
//! An image c gives every jot s = (α/T)·(G c) expected photons a frame; quantum efficiency η and dark counts d make
//! that η s + d; a jot reports 1 when at least q photons arrive.

mod bound;
mod expose;
mod kernel;
mod rate;
mod spread;

pub(crate) use kernel::mirrored;

use std::ops::Range;

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::likelihood::Threshold;

pub use expose::expose;
pub use kernel::Kernel;
pub use rate::{probability, rate};
pub use spread::Spread;

/// A two-dimensional image of either floating-point width, so that none is copied to be read.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// 32-bit.
    F32(ArrayView2<'a, f32>),
    /// 64-bit.
    F64(ArrayView2<'a, f64>),
}

impl Image<'_> {
    /// Height and width in pixels.
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        match self {
            Self::F32(image) => image.dim(),
            Self::F64(image) => image.dim(),
        }
    }
}

/// What jots may have in common or each for itself: one number, or a map over the jots.
#[derive(Clone, Copy, Debug)]
pub enum PerJot<'a> {
    /// The same for all jots.
    Same(f64),
    /// One for each jot, `(H·K̂, W·K̂)`.
    Map(ArrayView2<'a, f32>),
}

impl PerJot<'_> {
    fn check(&self, what: &'static str, jots: (usize, usize)) -> Result<()> {
        match self {
            Self::Map(map) if map.dim() != jots => Err(Error::shape(what, jots, map.dim())),
            _ => Ok(()),
        }
    }
}

/// A sensor, as far as light is concerned.
#[derive(Clone, Debug)]
pub struct Sensor<'a> {
    /// The interpolation kernel, which knows the oversampling K̂.
    pub kernel: Kernel,
    /// α/T: photons per frame and unit of intensity, spread over the jots by the kernel.
    pub gain_per_frame: f64,
    /// Quantum efficiency η.
    pub efficiency: PerJot<'a>,
    /// Dark counts d, per jot and frame.
    pub dark_counts: PerJot<'a>,
    /// Jots that never fire, `(H·K̂, W·K̂)`, true where dead.
    pub dead: Option<ArrayView2<'a, bool>>,
    /// The threshold q.
    pub threshold: Threshold,
}

impl Sensor<'_> {
    fn check(&self, image: &Image<'_>) -> Result<()> {
        let (height, width) = image.shape();
        if height == 0 || width == 0 {
            return Err(Error::range(
                "image",
                "at least one pixel",
                format!("{height} x {width}"),
            ));
        }
        let side = self.kernel.oversampling();
        let jots = (height * side, width * side);
        self.efficiency.check("efficiency", jots)?;
        self.dark_counts.check("dark counts", jots)?;
        if let Some(dead) = &self.dead
            && dead.dim() != jots
        {
            return Err(Error::shape("mask", jots, dead.dim()));
        }
        Ok(())
    }

    /// η and d of all jots, where the jots of a pixel all have the same rate.
    fn blockwise(&self) -> Option<(f64, f64)> {
        match (self.efficiency, self.dark_counts) {
            (PerJot::Same(efficiency), PerJot::Same(dark))
                if self.kernel.degree() == 0 && self.dead.is_none() =>
            {
                Some((efficiency, dark))
            }
            _ => None,
        }
    }

    fn is_dead(&self, row: usize, column: usize) -> bool {
        self.dead.is_some_and(|dead| dead[[row, column]])
    }
}

/// A part of all that a sensor reports: frames, and rows and columns of *pixels*.
#[derive(Clone, Debug)]
pub struct Window {
    /// Frames.
    pub frames: Range<usize>,
    /// Rows of pixels.
    pub rows: Range<usize>,
    /// Columns of pixels.
    pub columns: Range<usize>,
}

impl Window {
    fn check(&self, (height, width): (usize, usize)) -> Result<()> {
        for (what, range, size) in [
            ("window rows", &self.rows, height),
            ("window columns", &self.columns, width),
        ] {
            if range.start > range.end || range.end > size {
                return Err(Error::shape(what, 0..size, range));
            }
        }
        if self.frames.start > self.frames.end {
            return Err(Error::shape("window frames", "start <= end", &self.frames));
        }
        Ok(())
    }
}
