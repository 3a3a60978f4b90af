//! The linear operator G, which maps intensities to the light of the jots, and its exact adjoint
//! (paper, sections 2.1 and 2.2.1).

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis};
use num_integer::div_rem;
use rayon::prelude::*;

use super::filter::filter_row;
use super::jots_of_pixels;
use super::kernel::Kernel;
use crate::bits::contiguous;
use crate::border::mirror_index;
use crate::error::{Error, Result, check_shape};
use crate::images::for_each_image;
use crate::{interrupt, memory};

/// The operator G, which spreads the intensities of an image over the jots.
///
/// The vertical kernel filters along the columns, and the horizontal kernel along the rows. A
/// one-dimensional signal is an image of one row. Its vertical kernel is the box with K̂ = 1.
#[derive(Clone, Debug)]
pub struct SpreadOperator {
    vertical: Kernel,
    horizontal: Kernel,
}

impl SpreadOperator {
    /// Return the operator with the two kernels.
    #[must_use]
    pub fn new(vertical: Kernel, horizontal: Kernel) -> Self {
        Self {
            vertical,
            horizontal,
        }
    }

    /// Write gain · G of each image `(N, H, W)` into `out` `(N, H·K̂, W·K̂)`.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the images are
    /// empty.
    pub fn forward(
        &self,
        gain: f64,
        images: ArrayView3<'_, f64>,
        mut out: ArrayViewMut3<'_, f64>,
    ) -> Result<()> {
        self.check_shapes(images.dim(), out.dim())?;
        for_each_image(
            images.outer_iter().zip(out.outer_iter_mut()),
            |(image, out)| {
                self.write_forward(gain, image, out);
                Ok(())
            },
        )
    }

    fn write_forward(
        &self,
        gain: f64,
        image: ArrayView2<'_, f64>,
        mut out: ArrayViewMut2<'_, f64>,
    ) {
        let width = out.ncols();
        out.axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each_init(Vec::new, |light, (row, mut out)| {
                if interrupt::is_requested() {
                    return;
                }
                filter_row(
                    &self.vertical,
                    &self.horizontal,
                    image,
                    row,
                    0..width,
                    light,
                );
                for (out, light) in out.iter_mut().zip(light.iter()) {
                    *out = gain * light;
                }
            });
    }

    /// Write gain · Gᵀ of the jots `(N, H·K̂, W·K̂)` of each image into `out` `(N, H, W)`.
    ///
    /// The adjoint is exact: ⟨G x, y⟩ = ⟨x, Gᵀ y⟩ up to rounding. This includes the symmetric
    /// continuation at the border.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the images are
    /// empty.
    pub fn adjoint(
        &self,
        gain: f64,
        jots: ArrayView3<'_, f64>,
        mut out: ArrayViewMut3<'_, f64>,
    ) -> Result<()> {
        self.check_shapes(out.dim(), jots.dim())?;
        for_each_image(
            jots.outer_iter().zip(out.outer_iter_mut()),
            |(jots, out)| {
                self.apply_adjoint(gain, out, |row, light| {
                    light.clear();
                    light.extend_from_slice(&contiguous(jots.row(row)));
                })
            },
        )
    }

    /// Write gain² · Gᵀ diag(weights) G of each image `(N, H, W)` into `out` `(N, H, W)`.
    ///
    /// The intermediate result G `images` is not stored: each row of jots is computed when it is
    /// needed.
    ///
    /// # Errors
    /// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if the images are
    /// empty.
    pub fn normal(
        &self,
        gain: f64,
        weights: ArrayView3<'_, f64>,
        images: ArrayView3<'_, f64>,
        mut out: ArrayViewMut3<'_, f64>,
    ) -> Result<()> {
        self.check_shapes(images.dim(), weights.dim())?;
        self.check_shapes(out.dim(), weights.dim())?;
        let images = weights.outer_iter().zip(images.outer_iter());
        for_each_image(
            images.zip(out.outer_iter_mut()),
            |((weights, image), out)| self.write_normal(gain, weights, image, out),
        )
    }

    fn write_normal(
        &self,
        gain: f64,
        weights: ArrayView2<'_, f64>,
        image: ArrayView2<'_, f64>,
        out: ArrayViewMut2<'_, f64>,
    ) -> Result<()> {
        self.apply_adjoint(gain * gain, out, |row, light| {
            filter_row(
                &self.vertical,
                &self.horizontal,
                image,
                row,
                0..weights.ncols(),
                light,
            );
            for (light, weight) in light.iter_mut().zip(weights.row(row)) {
                *light *= weight;
            }
        })
    }

    /// Write gain · Gᵀ y into `out`, where `fill_row` computes the rows of the array y over the
    /// jots.
    fn apply_adjoint(
        &self,
        gain: f64,
        mut out: ArrayViewMut2<'_, f64>,
        fill_row: impl Fn(usize, &mut Vec<f64>) + Sync,
    ) -> Result<()> {
        let (height, width) = out.dim();
        let jot_rows = height * self.vertical.oversampling();
        let mut rows = memory::zeros("rows of jots", (jot_rows, width))?;
        rows.axis_iter_mut(Axis(0))
            .into_par_iter()
            .enumerate()
            .for_each_init(
                || (Vec::new(), Vec::new()),
                |(light, padded), (index, mut row)| {
                    if interrupt::is_requested() {
                        return;
                    }
                    fill_row(index, light);
                    self.apply_horizontal_adjoint(
                        light,
                        row.as_slice_mut().unwrap_or_default(),
                        padded,
                    );
                },
            );

        // For each row of pixels, the rows of jots that its light reaches, and their weights.
        let mut lit_rows: Vec<Vec<(usize, f64)>> = vec![Vec::new(); height];
        for row in 0..jot_rows {
            let (bottom, position) = self.vertical.last_pixel(row);
            for (distance, tap) in self.vertical.pixel_taps(position).enumerate() {
                lit_rows[mirror_index(bottom - distance as isize, height)].push((row, gain * tap));
            }
        }
        out.axis_iter_mut(Axis(0))
            .into_par_iter()
            .zip(lit_rows)
            .for_each(|(mut out, lit_rows)| {
                out.fill(0.0);
                for (row, weight) in lit_rows {
                    if interrupt::is_requested() {
                        return;
                    }
                    out.scaled_add(weight, &rows.row(row));
                }
            });
        Ok(())
    }

    /// Write the horizontal part of Gᵀ into `row`. It maps a row of jots to a row of pixels, and is
    /// the adjoint of the horizontal filter in [`filter_row`].
    fn apply_horizontal_adjoint(&self, jots: &[f64], row: &mut [f64], padded: &mut Vec<f64>) {
        let oversampling = self.horizontal.oversampling();
        let degree = self.horizontal.degree();
        let (first, phase) = self.horizontal.last_pixel(0);
        let (last, _) = self.horizontal.last_pixel(jots.len() - 1);
        let start = first - degree as isize;
        padded.clear();
        padded.resize((last - start + 1) as usize, 0.0);
        for (index, &jot) in (phase..).zip(jots) {
            let (pixel, position) = div_rem(index, oversampling);
            let pixels = &mut padded[pixel..];
            for (distance, tap) in self.horizontal.pixel_taps(position).enumerate() {
                pixels[degree - distance] += tap * jot;
            }
        }
        row.fill(0.0);
        for (pixel, &light) in (start..).zip(padded.iter()) {
            row[mirror_index(pixel, row.len())] += light;
        }
    }

    /// Check the shapes of images `(N, H, W)` and of their jots `(N, H·K̂, W·K̂)`.
    fn check_shapes(
        &self,
        (number, height, width): (usize, usize, usize),
        jots: (usize, usize, usize),
    ) -> Result<()> {
        if height == 0 || width == 0 {
            let received = format!("{height} x {width}");
            return Err(Error::range("image", "at least one pixel", received));
        }
        let (rows, columns) = jots_of_pixels((height, width), &self.vertical, &self.horizontal)?;
        check_shape("jots", (number, rows, columns), jots)
    }
}
