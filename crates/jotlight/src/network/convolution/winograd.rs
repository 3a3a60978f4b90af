//! Convolution, equation (9), with filters of three rows by Winograd's algorithm F(4, 3).
//!
//! Four output rows need six multiplications per column of a filter instead of twelve. The
//! algorithm is applied along columns only, so its transforms need not rearrange the lanes of a
//! register.

use ndarray::{ArrayView4, Axis};

use super::channel_bank::ChannelBank;
use super::winograd_transforms::{InputTransform, OutputTransform, TRANSFORMED_ROWS, filter_rows};
use super::{PlanesView, leading_rows};
use crate::cpu;
use crate::interrupt;
use crate::network::tiling::region::Region;
use crate::network::tiling::strips::StripedPlanes;
use crate::numbers::{MAX_LANES, Real};

/// The number of rows of a filter.
pub(super) const FILTER_ROWS: usize = 3;
/// The number of output rows that are computed together.
pub(crate) const OUTPUT_ROWS: usize = 4;

/// The minimum number of inputs. With fewer, the transforms take longer than the multiplications
/// that they save.
const MIN_INPUTS: usize = 16;
/// The minimum number of outputs, for the same reason.
const MIN_OUTPUTS: usize = 4;

/// The number of columns that are processed together. The transformed rows of all planes then fit
/// into the cache.
const WINOGRAD_BLOCK_COLUMNS: usize = 144;
/// The length of a transformed row in memory. The loops read whole registers, which may extend
/// beyond the end of a block.
pub(super) const ROW_STRIDE: usize = WINOGRAD_BLOCK_COLUMNS + 2 * MAX_LANES;

/// Transformed filters. For each transformed row, there is a bank of filters with one row.
#[derive(Clone, Debug)]
pub(crate) struct Winograd<F> {
    banks: Vec<ChannelBank<F>>,
    inputs: usize,
    outputs: usize,
    columns: usize,
}

impl<F: Real> Winograd<F> {
    /// Return the transformed filters `(outputs, inputs, rows, columns)`, or None where direct
    /// convolution is faster.
    pub fn new(filters: ArrayView4<'_, F>, stride: usize) -> Option<Self> {
        let (outputs, inputs, rows, columns) = filters.dim();
        let many = inputs >= MIN_INPUTS && outputs >= MIN_OUTPUTS;
        if rows != FILTER_ROWS || columns > MAX_LANES || stride != 1 || !many {
            return None;
        }
        // The taps are reversed, so that the loops read their input forward.
        let transformed = filters.lanes(Axis(2)).into_iter();
        let transformed: Vec<_> = transformed
            .map(|taps| filter_rows(taps.iter().rev().copied()))
            .collect();
        let bank = |row: usize| {
            let shape = (outputs, inputs, 1, columns);
            ChannelBank::new(shape, |output, input, _, column| {
                transformed[(output * inputs + input) * columns + columns - 1 - column][row]
            })
        };
        Some(Self {
            banks: (0..TRANSFORMED_ROWS).map(bank).collect(),
            inputs,
            outputs,
            columns,
        })
    }

    /// Write h * u for a region of the output into `out` `(outputs, height, width)`.
    ///
    /// The first row of the region must be a multiple of [`OUTPUT_ROWS`].
    pub fn convolve(
        &self,
        source: &StripedPlanes<'_, F>,
        output: &Region,
        workspace: &mut Vec<F>,
        out: &mut [F],
    ) {
        let transformed_length = self.inputs * ROW_STRIDE;
        let length =
            TRANSFORMED_ROWS * (transformed_length + self.outputs * WINOGRAD_BLOCK_COLUMNS);
        workspace.resize(workspace.len().max(length), F::zero());
        let (transformed, products) = workspace.split_at_mut(TRANSFORMED_ROWS * transformed_length);
        let (height, width) = (output.rows.len(), output.columns.len());
        let first = |start: usize, taps: usize| start as isize - leading_rows(taps, 1) as isize;
        let top = first(output.rows.start, FILTER_ROWS);
        let left = first(output.columns.start, self.columns);
        for row in (0..height).step_by(OUTPUT_ROWS) {
            if interrupt::is_requested() {
                return;
            }
            for column in (0..width).step_by(WINOGRAD_BLOCK_COLUMNS) {
                let length = WINOGRAD_BLOCK_COLUMNS.min(width - column);
                cpu::run(InputTransform {
                    source,
                    top: top + row as isize,
                    rows: TRANSFORMED_ROWS.min(height - row + FILTER_ROWS - 1),
                    left: left + column as isize,
                    length: length + self.columns - 1,
                    transformed,
                });
                let padded_length = length.next_multiple_of(MAX_LANES);
                let products = &mut products[..TRANSFORMED_ROWS * self.outputs * padded_length];
                self.multiply(transformed, padded_length, products);
                cpu::run(OutputTransform {
                    products,
                    padded_length,
                    row,
                    column,
                    length,
                    size: (height, width),
                    out,
                });
            }
        }
    }

    /// Correlate each transformed row with its bank, and write the results into `products`
    /// `(rows, outputs, length)`.
    fn multiply(&self, transformed: &[F], length: usize, products: &mut [F]) {
        let products = products.chunks_exact_mut(self.outputs * length);
        let rows = transformed.chunks_exact(self.inputs * ROW_STRIDE);
        for (bank, (products, row)) in self.banks.iter().zip(products.zip(rows)) {
            let planes = PlanesView {
                data: row,
                plane_stride: ROW_STRIDE,
                row_stride: ROW_STRIDE,
            };
            bank.correlate(planes, (1, length), products);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, Array4, s};

    use super::*;
    use crate::sensing::mirror_index;

    /// Return pseudorandom values in \[−0.5, 0.6\] from a linear congruential generator.
    fn random(length: usize) -> Vec<f32> {
        let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        let states = std::iter::successors(Some(1u32), next);
        states
            .map(|state| state as f32 / 4e9 - 0.5)
            .take(length)
            .collect()
    }

    fn convolved(
        winograd: &Winograd<f32>,
        planes: &[f32],
        size: (usize, usize),
        output: &Region,
    ) -> Vec<f32> {
        let source = StripedPlanes::single(planes, Region::whole(size), size);
        let mut out = vec![f32::NAN; winograd.outputs * output.pixels()];
        winograd.convolve(&source, output, &mut Vec::new(), &mut out);
        out
    }

    /// Return the sum of products at one pixel of an output.
    fn sum_of_products(
        planes: &[f32],
        (height, width): (usize, usize),
        filters: &Array4<f32>,
        (output, row, column): (usize, usize, usize),
    ) -> f64 {
        let (_, inputs, rows, columns) = filters.dim();
        let mut sum = 0.0;
        for input in 0..inputs {
            for tap_row in 0..rows {
                for tap_column in 0..columns {
                    let y = mirror_index((row + tap_row) as isize - 1, height);
                    let leading = leading_rows(columns, 1) as isize;
                    let x = mirror_index((column + tap_column) as isize - leading, width);
                    let value = planes[(input * height + y) * width + x];
                    let tap = [output, input, rows - 1 - tap_row, columns - 1 - tap_column];
                    sum += f64::from(value) * f64::from(filters[tap]);
                }
            }
        }
        sum
    }

    #[test]
    fn results_are_sums_of_products_and_do_not_depend_on_the_region()
    -> Result<(), Box<dyn std::error::Error>> {
        for (height, width) in [(1, 1), (2, 17), (9, 40), (13, 230)] {
            for columns in [1, 2, 3, 6] {
                let (outputs, inputs) = (5, MIN_INPUTS);
                let planes = random(inputs * height * width);
                let shape = (outputs, inputs, FILTER_ROWS, columns);
                let filters = random(outputs * inputs * FILTER_ROWS * columns);
                let filters = Array4::from_shape_vec(shape, filters)?;
                let winograd = Winograd::new(filters.view(), 1).ok_or("expected Winograd")?;
                let size = (height, width);
                let all = convolved(&winograd, &planes, size, &Region::whole(size));
                let all = Array3::from_shape_vec((outputs, height, width), all)?;

                for (index, &value) in all.indexed_iter() {
                    let expected = sum_of_products(&planes, size, &filters, index);
                    assert!((f64::from(value) - expected).abs() < 1e-5);
                }

                let part = Region {
                    rows: height / 2 / OUTPUT_ROWS * OUTPUT_ROWS..height,
                    columns: width / 3..width.div_ceil(2),
                };
                let found = convolved(&winograd, &planes, size, &part);
                let expected = all.slice(s![.., part.rows.clone(), part.columns.clone()]);
                assert!(expected.iter().eq(found.iter()));
            }
        }
        Ok(())
    }

    #[test]
    fn unsuitable_filters_have_no_winograd_transform() {
        for (outputs, inputs, rows, stride) in [
            (MIN_OUTPUTS, MIN_INPUTS, 5, 1),
            (MIN_OUTPUTS, MIN_INPUTS - 1, 3, 1),
            (MIN_OUTPUTS - 1, MIN_INPUTS, 3, 1),
            (MIN_OUTPUTS, MIN_INPUTS, 3, 2),
        ] {
            let filters = Array4::<f32>::zeros((outputs, inputs, rows, 3));
            assert!(Winograd::new(filters.view(), stride).is_none());
        }
    }
}
