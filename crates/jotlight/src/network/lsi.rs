//! The linear shift-invariant filters: equation (9), its adjoint, and its gradient with respect to the taps.

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{Array3, ArrayView, ArrayView3, ArrayView4, ArrayViewMut4, Dimension};

use super::Real;
use super::correlate::{self, Planes, SPARE_COLUMNS, SPARE_ROWS, Taps};
use crate::cpu::LANES;
use crate::sensing::mirrored;

/// Rows of weights whose gradients are summed in few bits.
const BAND: usize = 64;

/// The taps of a filter bank `(channels out, channels in, lines, columns)` as loops take them.
#[derive(Clone, Debug)]
pub(super) struct Filters<F> {
    /// Of every output channel, turned around, so that loops run forward in both.
    forward: Vec<Taps<F>>,
    /// Of every input channel.
    backward: Vec<Taps<F>>,
    taps: (usize, usize),
}

impl<F: Real> Filters<F> {
    pub fn new(filters: ArrayView4<'_, F>) -> Self {
        let (outputs, inputs, lines, columns) = filters.dim();
        let forward = (0..outputs).map(|output| {
            Taps::new((inputs, lines, columns), |input, line, column| {
                filters[[output, input, lines - 1 - line, columns - 1 - column]]
            })
        });
        let backward = (0..inputs).map(|input| {
            Taps::new((outputs, lines, columns), |output, line, column| {
                filters[[output, input, line, column]]
            })
        });
        Self {
            forward: forward.collect(),
            backward: backward.collect(),
            taps: (lines, columns),
        }
    }

    /// The part of planes of a size that a part of the output needs.
    pub fn read(&self, wanted: &Place, size: (usize, usize)) -> Place {
        Place {
            rows: needed(&wanted.rows, self.taps.0, size.0),
            columns: needed(&wanted.columns, self.taps.1, size.1),
        }
    }
}

fn needed(wanted: &Range<usize>, taps: usize, size: usize) -> Range<usize> {
    wanted.start.saturating_sub(before(taps))..(wanted.end + taps / 2).min(size)
}

/// A rectangle of pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Place {
    pub rows: Range<usize>,
    pub columns: Range<usize>,
}

impl Place {
    pub fn pixels(&self) -> usize {
        self.rows.len() * self.columns.len()
    }
}

/// Part of a stack of planes, `(channels, rows, columns)`.
pub(super) struct Part<'a, F> {
    pub planes: &'a [F],
    /// Which part, of planes of which size.
    pub place: Place,
    pub size: (usize, usize),
}

/// A stack of planes with a border, in rows with room to read past their end.
#[derive(Default)]
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
    /// Makes room for planes whose filters read from that many rows and columns, and for what tiles read beyond.
    fn make_room(&mut self, channels: usize, (rows, columns): (usize, usize)) {
        self.stride = columns.next_multiple_of(LANES) + LANES + SPARE_COLUMNS;
        self.plane = (rows + SPARE_ROWS) * self.stride;
        self.data.resize(channels * self.plane + LANES, F::zero());
    }

    /// Planes `(channels, height, width)` with room for these filters, continued past the rim by mirroring.
    pub fn mirrored(planes: ArrayView3<'_, F>, filters: &Filters<F>) -> Self {
        let (_, height, width) = planes.dim();
        let mut padded = Self::default();
        let whole = Place {
            rows: 0..height,
            columns: 0..width,
        };
        let all = Part {
            planes: &in_one_piece(planes),
            place: whole.clone(),
            size: (height, width),
        };
        padded.fill(&all, &whole, filters);
        padded
    }

    /// What the filters need for a part of their output.
    pub fn fill(&mut self, part: &Part<'_, F>, wanted: &Place, filters: &Filters<F>) {
        self.taps = filters.taps;
        (self.height, self.width) = (wanted.rows.len(), wanted.columns.len());
        let rows = self.height + self.taps.0 - 1;
        let columns = self.width + self.taps.1 - 1;
        self.make_room(filters.backward.len(), (rows, columns));
        let width = part.place.columns.len();
        // Where the first column of the part comes to lie, behind those that are mirrored.
        let inner = before(self.taps.1) + part.place.columns.start - wanted.columns.start;
        let to = |place: usize, first: usize, taps: usize, size: usize| {
            mirrored((first + place) as isize - before(taps) as isize, size)
        };
        let planes = part.planes.chunks_exact(part.place.pixels());
        for (source, out) in planes.zip(self.data.chunks_exact_mut(self.plane)) {
            for (row, out) in out.chunks_exact_mut(self.stride).take(rows).enumerate() {
                let row = to(row, wanted.rows.start, self.taps.0, part.size.0);
                let source = &source[(row - part.place.rows.start) * width..][..width];
                out[inner..inner + width].copy_from_slice(source);
                for column in (0..inner).chain(inner + width..columns) {
                    let from = to(column, wanted.columns.start, self.taps.1, part.size.1);
                    out[column] = source[from - part.place.columns.start];
                }
            }
        }
    }

    fn planes(&self) -> Planes<'_, F> {
        Planes {
            data: &self.data,
            plane: self.plane,
            stride: self.stride,
        }
    }

    /// (h * u), summed over the input channels, into the planes `(channels out, height, width)`.
    pub fn convolve(&self, filters: &Filters<F>, out: &mut [F]) {
        let live = 0..self.height + self.taps.0 - 1;
        let planes = out.chunks_exact_mut(self.height * self.width);
        for (taps, out) in filters.forward.iter().zip(planes) {
            taps.correlate(self.planes(), 0, live.clone(), self.width, out);
        }
    }

    /// The same in an array of its own.
    pub fn convolved(&self, filters: &Filters<F>) -> Array3<F> {
        let mut out = Array3::zeros((filters.forward.len(), self.height, self.width));
        if let Some(out) = out.as_slice_mut() {
            self.convolve(filters, out);
        }
        out
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
        let size = self.taps.0 * self.taps.1;
        let mut sums = vec![0.0; size];
        let mut rows = Vec::new();
        for output in 0..outputs {
            let gradient = gradient.index_axis(ndarray::Axis(0), output);
            let mut of_output = of_taps.index_axis_mut(ndarray::Axis(0), output);
            // In bands, so that no long sum is kept in few bits.
            for first in (0..height).step_by(BAND) {
                let band = first..(first + BAND).min(height);
                rows.clear();
                rows.resize((band.len() + 2 * SPARE_ROWS) * stride, F::zero());
                let inside = rows.chunks_exact_mut(stride).skip(SPARE_ROWS);
                for (row, out) in band.zip(inside) {
                    for (out, &value) in out.iter_mut().zip(gradient.row(row)) {
                        *out = value;
                    }
                }
                for (channel, mut of_taps) in of_output.outer_iter_mut().enumerate() {
                    sums.fill(0.0);
                    let source = &self.data[channel * self.plane + first * self.stride..];
                    correlate::gradient(source, self.stride, &rows, stride, self.taps, &mut sums);
                    for (of_tap, sum) in of_taps.iter_mut().zip(sums.iter().rev()) {
                        *of_tap += sum;
                    }
                }
            }
        }
    }
}

/// The adjoint of [`Padded::mirrored`] and [`Padded::convolve`]: from the gradient of the outputs to that of the planes.
pub(super) fn push_to_planes<F: Real>(
    filters: &Filters<F>,
    gradient: ArrayView3<'_, F>,
) -> Array3<F> {
    let (outputs, height, width) = gradient.dim();
    let (lines, columns) = filters.taps;
    // Every place of the padded planes gathers from the outputs that read it; past the rim there are none.
    let size = (height + lines - 1, width + columns - 1);
    let mut padded = Padded::default();
    padded.make_room(outputs, (size.0 + lines - 1, size.1 + columns - 1));
    let planes = padded.data.chunks_exact_mut(padded.plane);
    for (gradient, plane) in gradient.outer_iter().zip(planes) {
        let rows = plane.chunks_exact_mut(padded.stride).skip(lines - 1);
        for (gradient, row) in gradient.rows().into_iter().zip(rows) {
            for (out, &value) in row[columns - 1..].iter_mut().zip(gradient) {
                *out = value;
            }
        }
    }
    let columns_back: Vec<usize> = (0..size.1)
        .map(|column| mirrored(column as isize - before(columns) as isize, width))
        .collect();
    let mut planes = Array3::zeros((filters.backward.len(), height, width));
    let mut sums = vec![F::zero(); size.0 * size.1];
    for (taps, mut out) in filters.backward.iter().zip(planes.outer_iter_mut()) {
        let live = lines - 1..lines - 1 + height;
        taps.correlate(padded.planes(), 0, live, size.1, &mut sums);
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

/// Planes as a slice, copied only where they are not one.
pub(super) fn in_one_piece<T: Copy, D: Dimension>(planes: ArrayView<'_, T, D>) -> Cow<'_, [T]> {
    match planes.to_slice() {
        Some(planes) => Cow::Borrowed(planes),
        None => Cow::Owned(planes.iter().copied().collect()),
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
                let taps = some((3, 2, lines, columns));
                let filters = Filters::new(taps.view());
                let gradient = some((3, height, width)) * 2.0;
                let padded = Padded::mirrored(planes.view(), &filters);
                let direct = product(&padded.convolved(&filters), &gradient);

                let back = push_to_planes(&filters, gradient.view());
                assert!((product(&planes, &back) - direct).abs() < 1e-10);

                let mut of_taps = Array4::zeros(taps.dim());
                padded.push_to_taps(gradient.view(), of_taps.view_mut());
                assert!(((&of_taps * &taps).sum() - direct).abs() < 1e-10);
            }
        }
    }
}
