//! The input of the first layer in training: counts for tied filters, and bits for other filters.

use ndarray::{Array2, Array3, ArrayView3, ArrayView4, ArrayViewMut4};

use super::bit_tables::filter_bits;
use crate::bits::{PackedBits, add_block_counts, bit_field, trials};
use crate::error::Result;
use crate::numbers::Real;
use crate::{interrupt, memory};

/// The input of a first layer.
pub(crate) enum FirstLayerData<'a> {
    /// For tied filters: the count of each pixel, and the maximum count K. The layer is evaluated
    /// on a plane of the counts 0 to K, and not on the pixels, because the output depends only on
    /// the count.
    Counts(Array2<i32>, usize),
    /// For other filters: the bits, and the number of rows and columns of pixels.
    Bits(PackedBits<'a>, (usize, usize)),
}

impl<'a> FirstLayerData<'a> {
    /// Return the input for bits of a sensor with K̂ = `side`.
    pub fn new(bits: PackedBits<'a>, side: usize, tied: bool) -> Result<Self> {
        let pixels = bits.pixel_shape(side)?;
        if !tied {
            return Ok(Self::Bits(bits, pixels));
        }
        let mut counts = Array2::zeros(pixels);
        add_block_counts(&bits, side, None, counts.view_mut())?;
        let max = trials(bits.shape().0, side)?;
        Ok(Self::Counts(counts, max as usize))
    }

    /// Return p, one plane per filter. A plane has one value per pixel, or one per count if the
    /// filters are tied.
    ///
    /// # Errors
    /// [`crate::error::Error::Memory`] if the memory for the planes is not available.
    pub fn filter<F: Real>(&self, filters: ArrayView4<'_, F>) -> Result<Array3<F>> {
        Ok(match self {
            Self::Counts(_, max) => {
                memory::check::<F>("sums of the counts", &[filters.len(), max + 1])?;
                let taps: Vec<F> = filters.iter().copied().collect();
                Array3::from_shape_fn((taps.len(), 1, max + 1), |(channel, _, count)| {
                    taps[channel] * F::from_index(count)
                })
            }
            Self::Bits(bits, pixels) => filter_bits(bits, filters, *pixels),
        })
    }

    /// Return planes with one value per pixel from planes of the shape that
    /// [`FirstLayerData::filter`] returns.
    pub fn to_pixels<F: Real>(&self, planes: Array3<F>) -> Array3<F> {
        match self {
            Self::Counts(counts, _) => {
                let mut out = Array3::zeros((planes.dim().0, counts.nrows(), counts.ncols()));
                for (mut out, by_count) in out.outer_iter_mut().zip(planes.outer_iter()) {
                    let by_count = by_count.row(0);
                    out.zip_mut_with(counts, |value, &count| *value = by_count[count as usize]);
                }
                out
            }
            Self::Bits(..) => planes,
        }
    }

    /// Apply the adjoint of [`FirstLayerData::to_pixels`] to planes with one value per pixel, and
    /// return the result.
    pub fn to_pixels_adjoint<F: Real>(&self, planes: Array3<F>) -> Array3<F> {
        let Self::Counts(counts, max) = self else {
            return planes;
        };
        let mut out = Array3::zeros((planes.dim().0, 1, max + 1));
        for (mut out, plane) in out.outer_iter_mut().zip(planes.outer_iter()) {
            let mut sums = vec![0.0; max + 1];
            for (&value, &count) in plane.iter().zip(counts) {
                sums[count as usize] += value.as_f64();
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = F::from_f64(sum);
            }
        }
        out
    }

    /// Add the gradient with respect to the taps to `tap_gradient`: equation (16).
    ///
    /// `gradient` is the gradient with respect to p.
    pub fn add_tap_gradient<F: Real>(
        &self,
        gradient: ArrayView3<'_, F>,
        mut tap_gradient: ArrayViewMut4<'_, f64>,
    ) {
        let outputs = gradient.outer_iter().zip(tap_gradient.outer_iter_mut());
        for (gradient, mut tap_gradient) in outputs {
            self.for_each_tap(tap_gradient.dim(), |tap, plane: &[F]| {
                let products = gradient.iter().zip(plane).map(|(&g, &x)| (g * x).as_f64());
                tap_gradient[tap] += products.sum::<f64>();
            });
        }
    }

    /// Call `visit` with each tap and the plane that it multiplies.
    ///
    /// The tap is an index `[frame, row, column]`.
    pub fn for_each_tap<F: Real>(
        &self,
        (frames, rows, columns): (usize, usize, usize),
        mut visit: impl FnMut([usize; 3], &[F]),
    ) {
        match self {
            Self::Counts(_, max) => {
                let counts: Vec<F> = (0..=*max).map(F::from_index).collect();
                visit([0, 0, 0], &counts);
            }
            Self::Bits(bits, (height, width)) => {
                let mut plane = vec![F::zero(); height * width];
                for tap in ndarray::indices((frames, rows, columns)) {
                    if interrupt::is_requested() {
                        return;
                    }
                    let (frame, tap_row, tap_column) = tap;
                    for (row, plane) in plane.chunks_exact_mut(*width).enumerate() {
                        let jots = bits.row(frame, row * rows + tap_row);
                        for (pixel, value) in plane.iter_mut().enumerate() {
                            let bit = bit_field(&jots, pixel * columns + tap_column, 1);
                            *value = F::from_index(bit as usize);
                        }
                    }
                    visit([frame, tap_row, tap_column], &plane);
                }
            }
        }
    }
}
