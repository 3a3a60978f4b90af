//! The adjoint of the convolution with mirrored borders. It maps the gradient with respect to the
//! outputs to the gradient with respect to the inputs (equations (16) and (17)).

use ndarray::{Array3, ArrayView3, ArrayView4};

use super::direct::FilterTiles;
use super::leading_rows;
use super::padded::Padded;
use crate::border::mirror_index;
use crate::network::tiling::strips::PlanesMut;
use crate::numbers::Real;

/// For each input channel, a filter that holds the taps of all outputs for this channel.
#[derive(Clone, Debug)]
pub(crate) struct AdjointTaps<F> {
    inputs: Vec<FilterTiles<F>>,
    /// The numbers of rows and columns of a filter.
    size: (usize, usize),
}

impl<F: Real> AdjointTaps<F> {
    pub fn new(filters: ArrayView4<'_, F>) -> Self {
        let (outputs, inputs, rows, columns) = filters.dim();
        let inputs = (0..inputs).map(|input| {
            FilterTiles::new((outputs, rows, columns), |output, row, column| {
                filters[[output, input, row, column]]
            })
        });
        Self {
            inputs: inputs.collect(),
            size: (rows, columns),
        }
    }

    /// Return the gradient with respect to the planes that [`Padded::mirrored`] pads and
    /// [`Padded::convolve`] convolves. The filters must not have a stride.
    ///
    /// `gradient` is the gradient with respect to the result of the convolution.
    pub fn pull_back(&self, gradient: ArrayView3<'_, F>) -> Array3<F> {
        let (outputs, height, width) = gradient.dim();
        let (rows, columns) = self.size;
        // The gradient of a pixel of the padded input is a sum over the outputs that read it.
        // Outputs beyond the border do not exist, so their gradient is 0.
        let (padded_rows, padded_columns) = (height + rows - 1, width + columns - 1);
        let mut padded = Padded::default();
        let size = (padded_rows + rows - 1, padded_columns + columns - 1);
        padded.allocate(outputs, size);
        let planes = padded.data.chunks_exact_mut(padded.plane_stride);
        for (gradient, plane) in gradient.outer_iter().zip(planes) {
            let plane = plane.chunks_exact_mut(padded.row_stride).skip(rows - 1);
            for (gradient, row) in gradient.rows().into_iter().zip(plane) {
                for (out, &value) in row[columns - 1..].iter_mut().zip(gradient) {
                    *out = value;
                }
            }
        }
        // The border is a copy of pixels inside the image, so its gradient is added to theirs.
        let source = |index: usize, taps: usize, size: usize| {
            mirror_index(index as isize - leading_rows(taps, 1) as isize, size)
        };
        let source_columns: Vec<usize> = (0..padded_columns)
            .map(|column| source(column, columns, width))
            .collect();
        let mut planes = Array3::zeros((self.inputs.len(), height, width));
        let mut sums = vec![F::zero(); padded_rows * padded_columns];
        for (taps, mut out) in self.inputs.iter().zip(planes.outer_iter_mut()) {
            let nonzero = rows - 1..rows - 1 + height;
            let mut out_planes = PlanesMut::contiguous(&mut sums, (padded_rows, padded_columns));
            taps.correlate(padded.view(), nonzero, &mut out_planes);
            for (row, sums) in sums.chunks_exact(padded_columns).enumerate() {
                let mut out = out.row_mut(source(row, rows, height));
                for (&column, &sum) in source_columns.iter().zip(sums) {
                    out[column] += sum;
                }
            }
        }
        planes
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array4, Zip};

    use super::*;
    use crate::network::convolution::filter_taps::FilterTaps;
    use crate::network::tiling::region::Region;
    use crate::network::tiling::strips::StripedPlanes;

    /// Return pseudorandom values in \[−0.5, 0.6\] from a linear congruential generator.
    fn random<D: ndarray::Dimension>(
        shape: impl ndarray::ShapeBuilder<Dim = D>,
    ) -> ndarray::Array<f64, D> {
        let mut state = 1u32;
        ndarray::Array::from_shape_simple_fn(shape, || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / 4e9 - 0.5
        })
    }

    fn inner_product(a: &Array3<f64>, b: &Array3<f64>) -> f64 {
        Zip::from(a).and(b).fold(0.0, |sum, a, b| sum + a * b)
    }

    #[test]
    fn gradients_are_the_adjoints() {
        for (height, width) in [(1, 1), (3, 70), (9, 20), (40, 33)] {
            for (rows, columns) in [(1, 1), (4, 2), (3, 5), (15, 15)] {
                let planes = random((2, height, width));
                let taps = random((3, 2, rows, columns));
                let filters = FilterTaps::new(taps.view(), 1);
                let gradient = random((3, height, width)) * 2.0;
                let padded = Padded::mirrored(planes.view(), &filters);
                let product = inner_product(&padded.convolved(&filters), &gradient);

                let pulled_back = AdjointTaps::new(taps.view()).pull_back(gradient.view());
                assert!((inner_product(&planes, &pulled_back) - product).abs() < 1e-10);

                let mut tap_gradient = Array4::zeros(taps.dim());
                padded.add_tap_gradient(gradient.view(), tap_gradient.view_mut());
                assert!(((&tap_gradient * &taps).sum() - product).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn convolutions_with_a_stride_are_sums_of_products() {
        for (height, width, stride) in [(6, 8, 2), (9, 3, 3), (12, 36, 3), (16, 8, 4)] {
            for (rows, columns) in [(stride, stride), (stride + 2, stride), (7, 6)] {
                let planes = random((2, height, width));
                let taps = random((3, 2, rows, columns));
                let filters = FilterTaps::new(taps.view(), stride);
                let values: Vec<f64> = planes.iter().copied().collect();
                let size = (height, width);
                let source = StripedPlanes::contiguous(&values, size);
                let output = Region::whole((height / stride, width / stride));
                let mut padded = Padded::default();
                padded.fill(&source, &output, &filters);
                for ((output, row, column), found) in padded.convolved(&filters).indexed_iter() {
                    let mut sum = 0.0;
                    for ((input, tap_row, tap_column), tap) in
                        taps.index_axis(ndarray::Axis(0), output).indexed_iter()
                    {
                        let index = |position: usize, taps: usize, tap: usize, size: usize| {
                            let first = position * stride + taps - 1 - tap;
                            mirror_index(first as isize - leading_rows(taps, stride) as isize, size)
                        };
                        let y = index(row, rows, tap_row, height);
                        let x = index(column, columns, tap_column, width);
                        sum += tap * planes[[input, y, x]];
                    }
                    assert!((found - sum).abs() < 1e-12);
                }
            }
        }
    }
}
