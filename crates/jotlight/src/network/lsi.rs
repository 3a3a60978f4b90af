//! The linear shift-invariant filters: equation (9), its adjoint, and its gradient with respect to the taps.

use multiversion::multiversion;
use ndarray::{Array3, ArrayView3, ArrayView4, ArrayViewMut4};
use rayon::prelude::*;

use super::Real;
use crate::sensing::mirrored;

/// Products of a tap and a pixel that make it worth while to start a task.
const TASK: usize = 1 << 19;
/// Numbers that are summed side by side.
const LANES: usize = 16;
/// Taps of a line whose gradients are summed side by side.
const TAPS: usize = 5;

/// A stack of planes with a border, in rows with room to read past their end.
pub(super) struct Padded<F> {
    data: Vec<F>,
    /// Numbers from one plane to the next, and from one row to the next.
    plane: usize,
    stride: usize,
    /// Of the planes without border.
    height: usize,
    width: usize,
    taps: (usize, usize),
}

impl<F: Real> Padded<F> {
    fn room(
        channels: usize,
        (rows, columns): (usize, usize),
        taps: (usize, usize),
    ) -> (Vec<F>, usize, usize) {
        let stride = columns.next_multiple_of(LANES) + taps.1.next_multiple_of(TAPS) + LANES;
        let plane = rows * stride;
        (vec![F::zero(); channels * plane + LANES], plane, stride)
    }

    /// Planes `(channels, height, width)` with room for filters of `(height, width)` = `taps`, continued past the rim by mirroring.
    pub fn mirrored(planes: ArrayView3<'_, F>, taps: (usize, usize)) -> Self {
        let (channels, height, width) = planes.dim();
        let (rows, columns) = (height + taps.0 - 1, width + taps.1 - 1);
        let (mut data, plane, stride) = Self::room(channels, (rows, columns), taps);
        let inner = before(taps.1);
        data.par_chunks_exact_mut(stride)
            .take(channels * rows)
            .enumerate()
            .with_min_len((TASK / (64 * columns)).max(1))
            .for_each(|(index, out)| {
                let row = mirrored((index % rows) as isize - before(taps.0) as isize, height);
                let source = planes.slice(ndarray::s![index / rows, row, ..]);
                for (out, &value) in out[inner..].iter_mut().zip(source) {
                    *out = value;
                }
                for column in (0..inner).chain(inner + width..columns) {
                    out[column] = source[mirrored(column as isize - inner as isize, width)];
                }
            });
        Self {
            data,
            plane,
            stride,
            height,
            width,
            taps,
        }
    }

    /// (h * u), summed over the input channels: `(channels out, height, width)`.
    pub fn convolve(&self, filters: ArrayView4<'_, F>) -> Array3<F> {
        let (outputs, inputs, ..) = filters.dim();
        let size = (outputs, self.height, self.width);
        let mut out = vec![F::zero(); size.0 * size.1 * size.2];
        for (filter, out) in filters
            .outer_iter()
            .zip(out.chunks_exact_mut(self.height * self.width))
        {
            // Turned around once, so that the loops run forward in both.
            let taps: Vec<F> = filter
                .slice(ndarray::s![.., ..;-1, ..;-1])
                .iter()
                .copied()
                .collect();
            self.correlate(inputs, &taps, 0..self.height + self.taps.0, self.width, out);
        }
        Array3::from_shape_vec(size, out).unwrap_or_default()
    }

    /// Adds Σ taps · planes at every place to rows of `width`; source rows outside of `live` are 0.
    fn correlate(
        &self,
        channels: usize,
        taps: &[F],
        live: std::ops::Range<usize>,
        width: usize,
        out: &mut [F],
    ) {
        // An even number, since rows are worked on in pairs.
        let rows = (TASK / (taps.len() * width)).max(4).next_multiple_of(2);
        out.par_chunks_mut(rows * width)
            .enumerate()
            .for_each(|(chunk, out)| {
                for channel in 0..channels {
                    let size = self.taps.0 * self.taps.1;
                    correlate_rows(
                        &self.data[channel * self.plane..],
                        self.stride,
                        &taps[channel * size..][..size],
                        self.taps.1,
                        chunk * rows,
                        (live.start, live.end),
                        width,
                        out,
                    );
                }
            });
    }

    /// Calls `visit` with the number of each tap of a filter and the plane that it weighs, row by row.
    pub fn each_tap(
        &self,
        (channels, lines, columns): (usize, usize, usize),
        mut visit: impl FnMut(usize, &[F]),
    ) {
        let mut plane = Vec::with_capacity(self.height * self.width);
        for number in 0..channels * lines * columns {
            let (channel, line, column) = (
                number / (lines * columns),
                lines - 1 - number / columns % lines,
                columns - 1 - number % columns,
            );
            plane.clear();
            for row in 0..self.height {
                let start = channel * self.plane + (line + row) * self.stride + column;
                plane.extend_from_slice(&self.data[start..start + self.width]);
            }
            visit(number, &plane);
        }
    }

    /// Adds the gradient with respect to the taps, given that of the outputs: equation (18).
    pub fn push_to_taps(&self, gradient: ArrayView3<'_, F>, mut of_taps: ArrayViewMut4<'_, f64>) {
        let (outputs, height, width) = gradient.dim();
        let stride = width.next_multiple_of(LANES);
        let mut rows = vec![F::zero(); height * stride];
        let mut sums = vec![0.0; self.taps.0 * self.taps.1.next_multiple_of(TAPS)];
        for output in 0..outputs {
            for (row, source) in rows
                .chunks_exact_mut(stride)
                .zip(gradient.index_axis(ndarray::Axis(0), output).rows())
            {
                for (out, &value) in row.iter_mut().zip(source) {
                    *out = value;
                }
            }
            let mut of_output = of_taps.index_axis_mut(ndarray::Axis(0), output);
            for (channel, mut of_taps) in of_output.outer_iter_mut().enumerate() {
                sums.fill(0.0);
                let source = &self.data[channel * self.plane..];
                // In bands, so that no long sum is kept in few bits.
                for (band, rows) in rows.chunks(64 * stride).enumerate() {
                    let source = &source[64 * band * self.stride..];
                    correlate_gradient(source, self.stride, rows, stride, self.taps, &mut sums);
                }
                let lines = sums.chunks_exact(self.taps.1.next_multiple_of(TAPS)).rev();
                for (mut of_taps, sums) in of_taps.outer_iter_mut().zip(lines) {
                    for (of_tap, sum) in of_taps.iter_mut().zip(sums[..self.taps.1].iter().rev()) {
                        *of_tap += sum;
                    }
                }
            }
        }
    }
}

/// The adjoint of [`Padded::mirrored`] and [`Padded::convolve`]: from the gradient of the outputs to that of the planes.
pub(super) fn push_to_planes<F: Real>(
    filters: ArrayView4<'_, F>,
    gradient: ArrayView3<'_, F>,
) -> Array3<F> {
    let (outputs, inputs, lines, columns) = filters.dim();
    let (_, height, width) = gradient.dim();
    // Every place of the padded planes gathers from the outputs that read it; past the rim there are none.
    let size = (height + lines - 1, width + columns - 1);
    let (mut data, plane, stride) = Padded::<F>::room(
        outputs,
        (size.0 + lines - 1, size.1 + columns - 1),
        (lines, columns),
    );
    for (gradient, plane) in gradient.outer_iter().zip(data.chunks_exact_mut(plane)) {
        for (gradient, row) in gradient
            .rows()
            .into_iter()
            .zip(plane.chunks_exact_mut(stride).skip(lines - 1))
        {
            for (out, &value) in row[columns - 1..].iter_mut().zip(gradient) {
                *out = value;
            }
        }
    }
    let padded = Padded {
        data,
        plane,
        stride,
        height,
        width,
        taps: (lines, columns),
    };
    let columns_back: Vec<usize> = (0..size.1)
        .map(|column| mirrored(column as isize - before(columns) as isize, width))
        .collect();
    let mut planes = Array3::zeros((inputs, height, width));
    let mut sums = vec![F::zero(); size.0 * size.1];
    for (input, mut out) in planes.outer_iter_mut().enumerate() {
        sums.fill(F::zero());
        let taps: Vec<F> = filters
            .index_axis(ndarray::Axis(1), input)
            .iter()
            .copied()
            .collect();
        padded.correlate(
            outputs,
            &taps,
            lines - 1..lines - 1 + height,
            size.1,
            &mut sums,
        );
        for (row, sums) in sums.chunks_exact(size.1).enumerate() {
            let mut out = out.row_mut(mirrored(row as isize - before(lines) as isize, height));
            for (&column, &sum) in columns_back.iter().zip(sums) {
                out[column] += sum;
            }
        }
    }
    planes
}

/// Places before a pixel that a convolution with so many taps reads: it reads from m − before to m + taps/2.
pub(super) fn before(taps: usize) -> usize {
    taps - 1 - taps / 2
}

/// Adds Σ taps · source to rows of `out`, the first of them at row `first` of the source.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+avx2", "x86_64+avx2"))]
#[allow(clippy::too_many_arguments)]
fn correlate_rows<F: Real>(
    source: &[F],
    stride: usize,
    taps: &[F],
    columns: usize,
    first: usize,
    live: (usize, usize),
    width: usize,
    out: &mut [F],
) {
    let rows = out.len() / width;
    let mut row = 0;
    while row < rows {
        let pair = row + 1 < rows;
        // Lines of taps that meet a live row from either row of the pair.
        let top = first + row;
        let lines = taps.len() / columns;
        let from = live.0.saturating_sub(top + usize::from(pair)).min(lines);
        let to = live.1.saturating_sub(top).min(lines);
        if from < to {
            let source = &source[(top + from) * stride..];
            let taps = &taps[from * columns..to * columns];
            let out = &mut out[row * width..];
            let mut column = 0;
            while column < width {
                let rest = width - column;
                let source = &source[column..];
                let out = &mut out[column..];
                column += match (pair, rest) {
                    (true, 33..) => {
                        tile::<F, 2, 3>(source, stride, taps, columns, width, rest, out)
                    }
                    (true, 17..) => {
                        tile::<F, 2, 2>(source, stride, taps, columns, width, rest, out)
                    }
                    (true, _) => tile::<F, 2, 1>(source, stride, taps, columns, width, rest, out),
                    (false, 17..) => {
                        tile::<F, 1, 2>(source, stride, taps, columns, width, rest, out)
                    }
                    (false, _) => tile::<F, 1, 1>(source, stride, taps, columns, width, rest, out),
                };
            }
        }
        row += 1 + usize::from(pair);
    }
}

/// Sums side by side. Handed on by value, so that the compiler keeps them in vector registers.
#[derive(Clone, Copy)]
struct Lanes<F>([F; LANES]);

impl<F: Real> Lanes<F> {
    #[inline(always)]
    fn zero() -> Self {
        Self([F::zero(); LANES])
    }

    #[inline(always)]
    fn add(self, factors: &[F], window: &[F]) -> Self {
        let mut sums = self;
        for lane in 0..LANES {
            sums.0[lane] += factors[lane] * window[lane];
        }
        sums
    }

    #[inline(always)]
    fn add_scaled(self, factor: F, window: &[F]) -> Self {
        self.add(&[factor; LANES], window)
    }
}

/// Adds `R` rows of `C` · [`LANES`] sums, and tells how many columns they were.
#[inline(always)]
fn tile<F: Real, const R: usize, const C: usize>(
    source: &[F],
    stride: usize,
    taps: &[F],
    columns: usize,
    width: usize,
    rest: usize,
    out: &mut [F],
) -> usize {
    let mut sums = [[Lanes::zero(); C]; R];
    for (line, taps) in taps.chunks_exact(columns).enumerate() {
        let rows: [&[F]; R] =
            std::array::from_fn(|row| &source[(line + row) * stride..][..C * LANES + columns - 1]);
        for (offset, &tap) in taps.iter().enumerate() {
            for row in 0..R {
                for column in 0..C {
                    let window = &rows[row][offset + column * LANES..][..LANES];
                    sums[row][column] = sums[row][column].add_scaled(tap, window);
                }
            }
        }
    }
    let length = rest.min(C * LANES);
    for (row, sums) in sums.iter().enumerate() {
        let sums = sums.iter().flat_map(|lanes| lanes.0);
        for (out, sum) in out[row * width..][..length].iter_mut().zip(sums) {
            *out += sum;
        }
    }
    length
}

/// Adds Σ gradient · source for every shift of the source, `sums[line][column]`.
// Not for AVX-512, which the compiler makes a slow mixture of here.
#[multiversion(targets("x86_64+avx2"))]
fn correlate_gradient<F: Real>(
    source: &[F],
    stride: usize,
    gradient: &[F],
    gradient_stride: usize,
    taps: (usize, usize),
    sums: &mut [f64],
) {
    let columns = taps.1.next_multiple_of(TAPS);
    for (line, sums) in sums.chunks_exact_mut(columns).enumerate() {
        for (group, sums) in sums.as_chunks_mut::<TAPS>().0.iter_mut().enumerate() {
            let mut lanes = [Lanes::zero(); TAPS];
            for (row, gradient) in gradient.chunks_exact(gradient_stride).enumerate() {
                let source = &source[(row + line) * stride + group * TAPS..];
                let source = &source[..gradient_stride + TAPS - 1];
                for (step, gradient) in gradient.chunks_exact(LANES).enumerate() {
                    let source = &source[step * LANES..][..LANES + TAPS - 1];
                    for tap in 0..TAPS {
                        lanes[tap] = lanes[tap].add(gradient, &source[tap..tap + LANES]);
                    }
                }
            }
            for (sum, lanes) in sums.iter_mut().zip(lanes) {
                *sum += lanes.0.iter().map(|x| x.as_f64()).sum::<f64>();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array4, Zip};

    use super::*;

    /// Numbers without a pattern, from a linear congruence.
    fn some<D: ndarray::Dimension>(
        shape: impl ndarray::ShapeBuilder<Dim = D>,
    ) -> ndarray::Array<f64, D> {
        let mut state = 1u32;
        ndarray::Array::from_shape_simple_fn(shape, || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / 4e9 - 0.5
        })
    }

    fn product(a: &Array3<f64>, b: &Array3<f64>) -> f64 {
        Zip::from(a).and(b).fold(0.0, |sum, a, b| sum + a * b)
    }

    #[test]
    fn gradients_are_the_adjoints() {
        for (height, width) in [(1, 1), (3, 70), (9, 20), (40, 33)] {
            for (lines, columns) in [(1, 1), (4, 2), (3, 5), (15, 15)] {
                let planes = some((2, height, width));
                let filters = some((3, 2, lines, columns));
                let gradient = some((3, height, width)) * 2.0;
                let padded = Padded::mirrored(planes.view(), (lines, columns));
                let direct = product(&padded.convolve(filters.view()), &gradient);

                let back = push_to_planes(filters.view(), gradient.view());
                assert!((product(&planes, &back) - direct).abs() < 1e-10);

                let mut of_taps = Array4::zeros(filters.dim());
                padded.push_to_taps(gradient.view(), of_taps.view_mut());
                assert!(((&of_taps * &filters).sum() - direct).abs() < 1e-10);
            }
        }
    }
}
