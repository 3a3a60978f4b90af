//! The sensor model, from an image to bits (paper, section 2.1, equations (1) to (3)).
//!
//! The light of an image c is s = (α/T)·(G c): the expected photons per jot and frame. The quantum
//! efficiency η and the dark counts d turn it into the rate η s + d: the expected detections per
//! jot and frame. A jot reports 1 if at least q photons are detected (equation (3)).

mod compare;
mod count;
mod expose;
mod exposure;
mod filter;
mod interleave;
mod kernel;
mod probability_table;
mod rate;
mod row_sampler;
mod spread;

pub(crate) use count::can_draw_counts;
pub(crate) use exposure::Exposure;

use std::ops::Range;

use ndarray::{ArrayView2, ArrayViewMut3, ArrayViewMut4, s};

use crate::bits::contiguous;
use crate::error::{Error, Result, check_shape};
use crate::images::for_each_image;
use crate::likelihood::Threshold;
use crate::numbers::Real;
use crate::rng::check_size;
use crate::values::check_not_negative;

pub use count::draw_counts;
pub use expose::expose;
pub use kernel::Kernel;
pub use rate::{probability, rate};
pub use spread::SpreadOperator;

/// The number of jots of a row that are drawn together. It bounds the memory of a thread.
pub(crate) const JOTS_PER_SEGMENT: usize = 2048;

/// A view of a two-dimensional image of 32-bit or 64-bit floats.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// 32-bit floats.
    F32(ArrayView2<'a, f32>),
    /// 64-bit floats.
    F64(ArrayView2<'a, f64>),
}

impl Image<'_> {
    /// Return the height and the width in pixels.
    #[must_use]
    pub fn shape(&self) -> (usize, usize) {
        match self {
            Self::F32(image) => image.dim(),
            Self::F64(image) => image.dim(),
        }
    }

    /// Check that the intensities of some rows are finite and at least 0.
    fn check_values(&self, rows: Range<usize>) -> Result<()> {
        match self {
            Self::F32(image) => check_rows("image", *image, rows),
            Self::F64(image) => check_rows("image", *image, rows),
        }
    }
}

/// Check that the values of some rows are finite and at least 0.
fn check_rows<F: Real>(
    what: &'static str,
    values: ArrayView2<'_, F>,
    rows: Range<usize>,
) -> Result<()> {
    let rows = values.slice(s![rows, ..]);
    if let Some(values) = rows.to_slice() {
        return check_not_negative(what, values);
    }
    let mut rows = rows.rows().into_iter();
    rows.try_for_each(|row| check_not_negative(what, &contiguous(row)))
}

/// A property of the jots: one number for all jots, or a map with one number per jot.
#[derive(Clone, Copy, Debug)]
pub enum PerJot<'a> {
    /// The value of all jots.
    Same(f64),
    /// The value of each jot, `(H·K̂, W·K̂)`.
    Map(ArrayView2<'a, f32>),
}

impl PerJot<'_> {
    fn check_shape(&self, what: &'static str, jots: (usize, usize)) -> Result<()> {
        match self {
            Self::Map(map) if map.dim() != jots => Err(Error::shape(what, jots, map.dim())),
            _ => Ok(()),
        }
    }

    /// Check that the values of rows of jots are finite and at least 0.
    fn check_values(&self, what: &'static str, rows: Range<usize>) -> Result<()> {
        match self {
            Self::Same(value) => check_not_negative(what, &[*value]),
            Self::Map(map) => check_rows(what, *map, rows),
        }
    }
}

/// The properties of a sensor that determine its bits.
#[derive(Clone, Debug)]
pub struct Sensor<'a> {
    /// The interpolation kernel g, which also holds the oversampling K̂.
    pub kernel: Kernel,
    /// α/T, the number of photons per frame and pixel at intensity 1. The kernel distributes them
    /// over the jots.
    pub gain_per_frame: f64,
    /// The quantum efficiency η.
    pub efficiency: PerJot<'a>,
    /// The dark counts d per jot and frame.
    pub dark_counts: PerJot<'a>,
    /// Whether each jot is dead, `(H·K̂, W·K̂)`. A dead jot always reports 0.
    pub dead: Option<ArrayView2<'a, bool>>,
    /// The threshold q.
    pub threshold: Threshold,
}

impl Sensor<'_> {
    /// Check the shapes of the image and the maps.
    pub(crate) fn check(&self, image: &Image<'_>) -> Result<()> {
        let (height, width) = image.shape();
        if height == 0 || width == 0 {
            return Err(Error::range(
                "image",
                "at least one pixel",
                format!("{height} x {width}"),
            ));
        }
        let jots = self.jots(image)?;
        self.efficiency.check_shape("efficiency", jots)?;
        self.dark_counts.check_shape("dark counts", jots)?;
        if let Some(dead) = &self.dead
            && dead.dim() != jots
        {
            return Err(Error::shape("mask", jots, dead.dim()));
        }
        Ok(())
    }

    /// Check that the parameters of some rows of jots, and the intensities whose light reaches
    /// them, are finite and at least 0.
    pub(crate) fn check_values(&self, image: &Image<'_>, rows: Range<usize>) -> Result<()> {
        check_not_negative("gain per frame", &[self.gain_per_frame])?;
        self.efficiency.check_values("efficiency", rows.clone())?;
        self.dark_counts.check_values("dark counts", rows.clone())?;
        image.check_values(self.kernel.rows_of_pixels(rows, image.shape().0))
    }

    /// Check that readings of a window can be drawn. Return its rows and its columns of jots.
    pub(crate) fn check_draw(
        &self,
        image: &Image<'_>,
        channel: usize,
        window: &Window,
    ) -> Result<(Range<usize>, Range<usize>)> {
        self.check(image)?;
        window.check(image.shape())?;
        let oversampling = self.kernel.oversampling();
        let jots = |pixels: &Range<usize>| pixels.start * oversampling..pixels.end * oversampling;
        let (rows, columns) = (jots(&window.rows), jots(&window.columns));
        self.check_values(image, rows.clone())?;
        check_size(channel, window.frames.end, self.jots(image)?.0)?;
        Ok((rows, columns))
    }

    /// Return the numbers of rows and of columns of jots.
    pub(crate) fn jots(&self, image: &Image<'_>) -> Result<(usize, usize)> {
        jots_of_pixels(image.shape(), &self.kernel, &self.kernel)
    }

    /// Return whether all jots of a pixel have the same rate for any image.
    pub(crate) fn has_uniform_pixels(&self) -> bool {
        let maps = (&self.efficiency, &self.dark_counts, &self.dead);
        self.kernel.degree() == 0 && matches!(maps, (PerJot::Same(_), PerJot::Same(_), None))
    }

    pub(crate) fn is_dead(&self, row: usize, column: usize) -> bool {
        self.dead.is_some_and(|dead| dead[[row, column]])
    }
}

/// The seed and the channel of an image, which select its random numbers.
pub type Stream = ([u8; 32], usize);

/// Call `draw` for each image with its stream and its part of `out` `(N, …)`: [`expose`], for
/// example, or [`crate::multibit::draw`].
///
/// # Errors
/// [`Error::Shape`] if the numbers of images, streams, and parts differ, and those of `draw`.
pub fn draw_images<T: Send + Sync>(
    images: Vec<Image<'_>>,
    streams: &[Stream],
    mut out: ArrayViewMut4<'_, T>,
    draw: impl Fn(Image<'_>, Stream, ArrayViewMut3<'_, T>) -> Result<()> + Send + Sync,
) -> Result<()> {
    check_shape("streams", images.len(), streams.len())?;
    check_shape("out", images.len(), out.dim().0)?;
    let images = images.into_iter().zip(streams);
    for_each_image(
        images.zip(out.outer_iter_mut()),
        |((image, stream), out)| draw(image, *stream, out),
    )
}

/// Return the numbers of rows and of columns of jots of an image.
fn jots_of_pixels(
    (height, width): (usize, usize),
    vertical: &Kernel,
    horizontal: &Kernel,
) -> Result<(usize, usize)> {
    let rows = height.checked_mul(vertical.oversampling());
    let columns = width.checked_mul(horizontal.oversampling());
    rows.zip(columns).ok_or_else(|| {
        let received = format!("{height} x {width}");
        Error::range("image", "jots whose number fits into memory", received)
    })
}

/// A range of frames, rows of pixels, and columns of pixels.
#[derive(Clone, Debug)]
pub struct Window {
    /// The range of frames.
    pub frames: Range<usize>,
    /// The range of rows, in pixels.
    pub rows: Range<usize>,
    /// The range of columns, in pixels.
    pub columns: Range<usize>,
}

impl Window {
    pub(crate) fn check(&self, (height, width): (usize, usize)) -> Result<()> {
        for (what, range, size) in [
            ("window rows", &self.rows, height),
            ("window columns", &self.columns, width),
        ] {
            if range.start > range.end || range.end > size {
                return Err(Error::range(
                    what,
                    format!("a range within 0..{size}"),
                    format!("{range:?}"),
                ));
            }
        }
        if self.frames.start > self.frames.end {
            let frames = format!("{:?}", self.frames);
            return Err(Error::range(
                "window frames",
                "a start that does not exceed the end",
                frames,
            ));
        }
        Ok(())
    }
}
