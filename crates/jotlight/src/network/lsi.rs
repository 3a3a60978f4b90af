//! The linear shift-invariant filters: equation (9), its adjoint, and its gradient with respect to the taps.

use std::borrow::Cow;
use std::ops::Range;

use ndarray::{Array3, ArrayView, ArrayView3, ArrayView4, ArrayViewMut4, Dimension};

use super::Real;
use super::bank::Bank;
use super::correlate::{self, Planes, SPARE_COLUMNS, SPARE_ROWS, Taps};
use super::place::{Part, Place};
use crate::cpu::LANES;
use crate::sensing::mirror_index as mirrored;

/// Rows of weights whose gradients are summed in few bits.
const BAND: usize = 64;

/// The taps of a filter bank `(channels out, channels in, lines, columns)` as loops take them, turned around, so that they run forward in
/// the taps and in what these read.
#[derive(Clone, Debug)]
pub(super) struct Filters<F> {
    order: Order<F>,
    inputs: usize,
    /// Lines and columns of a filter, and of what loops see of it: of planes in phases where there is a stride.
    size: (usize, usize),
    taps: (usize, usize),
    stride: usize,
}

#[derive(Clone, Debug)]
enum Order<F> {
    One(Taps<F>),
    Many(Bank<F>),
}

impl<F: Real> Filters<F> {
    pub fn new(filters: ArrayView4<'_, F>, stride: usize) -> Self {
        let (outputs, inputs, lines, columns) = filters.dim();
        let taps = (lines.div_ceil(stride), columns.div_ceil(stride));
        let order = if outputs == 1 && stride == 1 {
            Order::One(Taps::new(
                (inputs, lines, columns),
                |input, line, column| filters[[0, input, lines - 1 - line, columns - 1 - column]],
            ))
        } else {
            let phases = stride * stride;
            let shape = (outputs, inputs * phases, taps.0, taps.1);
            Order::Many(Bank::new(shape, |output, plane, line, column| {
                let phase = plane % phases;
                let (line, column) = (
                    line * stride + phase / stride,
                    column * stride + phase % stride,
                );
                if line < lines && column < columns {
                    filters[[
                        output,
                        plane / phases,
                        lines - 1 - line,
                        columns - 1 - column,
                    ]]
                } else {
                    F::zero()
                }
            }))
        };
        Self {
            order,
            inputs,
            size: (lines, columns),
            taps,
            stride,
        }
    }
}

/// The part of planes of a size that a part of the output needs, by filters of so many lines and columns.
pub(super) fn read(
    (lines, columns): (usize, usize),
    stride: usize,
    wanted: &Place,
    (height, width): (usize, usize),
) -> Place {
    let needed = |wanted: &Range<usize>, taps: usize, size: usize| {
        let before = before(taps, stride);
        // Loops read whole strides, with taps of 0 where the filter has none.
        let end = (wanted.end.max(1) - 1 + taps.div_ceil(stride)) * stride;
        (wanted.start * stride).saturating_sub(before)..end.saturating_sub(before).min(size)
    };
    Place {
        rows: needed(&wanted.rows, lines, height),
        columns: needed(&wanted.columns, columns, width),
    }
}

/// The taps of every input channel over the outputs, for the adjoint.
#[derive(Clone, Debug)]
pub(super) struct Turned<F> {
    inputs: Vec<Taps<F>>,
    taps: (usize, usize),
}

impl<F: Real> Turned<F> {
    pub fn new(filters: ArrayView4<'_, F>) -> Self {
        let (outputs, inputs, lines, columns) = filters.dim();
        let inputs = (0..inputs).map(|input| {
            Taps::new((outputs, lines, columns), |output, line, column| {
                filters[[output, input, line, column]]
            })
        });
        Self {
            inputs: inputs.collect(),
            taps: (lines, columns),
        }
    }
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
        let planes = in_one_piece(planes);
        let all = Part::whole(&planes, whole.clone(), (height, width));
        padded.fill(&all, &whole, filters);
        padded
    }

    /// What the filters need for a part of their output.
    pub fn fill(&mut self, part: &Part<'_, F>, wanted: &Place, filters: &Filters<F>) {
        let stride = filters.stride;
        self.taps = filters.taps;
        (self.height, self.width) = (wanted.rows.len(), wanted.columns.len());
        let rows = self.height + self.taps.0 - 1;
        let columns = self.width + self.taps.1 - 1;
        self.make_room(filters.inputs * stride * stride, (rows, columns));
        // Where what is read of the planes begins, past the rim for some.
        let first =
            |wanted: usize, taps: usize| (wanted * stride) as isize - before(taps, stride) as isize;
        let (top, left) = (
            first(wanted.rows.start, filters.size.0),
            first(wanted.columns.start, filters.size.1),
        );
        let phases = (0..stride).flat_map(|line| (0..stride).map(move |column| (line, column)));
        let planes = 0..filters.inputs;
        let sources = planes.flat_map(|plane| phases.clone().map(move |phase| (plane, phase)));
        for ((plane, phase), out) in sources.zip(self.data.chunks_exact_mut(self.plane)) {
            let left = left + phase.1 as isize;
            // The columns of the output that lie in the part.
            let from = part.columns.start as isize - left;
            let inner = (from.max(0) as usize).div_ceil(stride).min(columns);
            let to = (part.columns.end as isize - left).max(0) as usize;
            let inside = inner..to.div_ceil(stride).clamp(inner, columns);
            let place = |column: usize| {
                mirrored(left + (column * stride) as isize, part.size.1) - part.columns.start
            };
            for (row, out) in out.chunks_exact_mut(self.stride).take(rows).enumerate() {
                let row = mirrored(top + (row * stride + phase.0) as isize, part.size.0);
                let source = &part.row(row).of(plane)[..part.columns.len()];
                if stride == 1 {
                    let start = (left + inside.start as isize - part.columns.start as isize).max(0)
                        as usize;
                    out[inside.clone()].copy_from_slice(&source[start..][..inside.len()]);
                } else if !inside.is_empty() {
                    let source = source[place(inside.start)..].iter().step_by(stride);
                    for (out, &value) in out[inside.clone()].iter_mut().zip(source) {
                        *out = value;
                    }
                }
                for column in (0..inside.start).chain(inside.end..columns) {
                    out[column] = source[place(column)];
                }
            }
        }
    }

    /// Room for so many numbers, of no use to filters.
    pub fn room(&mut self, length: usize) -> &mut [F] {
        self.data.resize(self.data.len().max(length), F::zero());
        &mut self.data[..length]
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
        match &filters.order {
            Order::One(taps) => {
                let live = 0..self.height + self.taps.0 - 1;
                taps.correlate(self.planes(), 0, live, self.width, out);
            }
            Order::Many(bank) => bank.correlate(self.planes(), (self.height, self.width), out),
        }
    }

    /// The same in an array of its own.
    pub fn convolved(&self, filters: &Filters<F>) -> Array3<F> {
        let outputs = match &filters.order {
            Order::One(_) => 1,
            Order::Many(bank) => bank.outputs(),
        };
        let mut out = Array3::zeros((outputs, self.height, self.width));
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
    turned: &Turned<F>,
    gradient: ArrayView3<'_, F>,
) -> Array3<F> {
    let (outputs, height, width) = gradient.dim();
    let (lines, columns) = turned.taps;
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
        .map(|column| mirrored(column as isize - before(columns, 1) as isize, width))
        .collect();
    let mut planes = Array3::zeros((turned.inputs.len(), height, width));
    let mut sums = vec![F::zero(); size.0 * size.1];
    for (taps, mut out) in turned.inputs.iter().zip(planes.outer_iter_mut()) {
        let live = lines - 1..lines - 1 + height;
        taps.correlate(padded.planes(), 0, live, size.1, &mut sums);
        for (row, sums) in sums.chunks_exact(size.1).enumerate() {
            let mut out = out.row_mut(mirrored(row as isize - before(lines, 1) as isize, height));
            for (&column, &sum) in columns_back.iter().zip(sums) {
                out[column] += sum;
            }
        }
    }
    planes
}

/// Rows before the first one that an output would read if it read `stride` alone: it reads from stride·m − before on, as many as there are
/// taps.
pub(super) fn before(taps: usize, stride: usize) -> usize {
    (taps - stride) / 2
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
                let filters = Filters::new(taps.view(), 1);
                let gradient = some((3, height, width)) * 2.0;
                let padded = Padded::mirrored(planes.view(), &filters);
                let direct = product(&padded.convolved(&filters), &gradient);

                let back = push_to_planes(&Turned::new(taps.view()), gradient.view());
                assert!((product(&planes, &back) - direct).abs() < 1e-10);

                let mut of_taps = Array4::zeros(taps.dim());
                padded.push_to_taps(gradient.view(), of_taps.view_mut());
                assert!(((&of_taps * &taps).sum() - direct).abs() < 1e-10);
            }
        }
    }
}
