//! The three transforms of Winograd's algorithm F(4, 3).
//!
//! They transform the filters, the input rows, and the products of both, which become output rows.
//! The matrices G, Bᵀ, and Aᵀ are those of Lavin and Gray, *Fast Algorithms for Convolutional
//! Neural Networks* (2016).

use super::winograd::{FILTER_ROWS, OUTPUT_ROWS, ROW_STRIDE};
use crate::cpu::{Simd, WithSimd};
use crate::network::tiling::strips::{PlaneRow, StripedPlanes};
use crate::numbers::{MAX_LANES, Real};
use crate::sensing::mirror_index;

/// The number of input rows that are transformed together, and the number of transformed rows.
pub(super) const TRANSFORMED_ROWS: usize = 6;

/// The matrix G of the filter transform.
const FILTER_TRANSFORM: [[f64; FILTER_ROWS]; TRANSFORMED_ROWS] = [
    [1.0 / 4.0, 0.0, 0.0],
    [-1.0 / 6.0, -1.0 / 6.0, -1.0 / 6.0],
    [-1.0 / 6.0, 1.0 / 6.0, -1.0 / 6.0],
    [1.0 / 24.0, 1.0 / 12.0, 1.0 / 6.0],
    [1.0 / 24.0, -1.0 / 12.0, 1.0 / 6.0],
    [0.0, 0.0, 1.0],
];

/// Return G·taps for one column of a filter.
pub(super) fn filter_rows<F: Real>(taps: impl Iterator<Item = F> + Clone) -> [F; TRANSFORMED_ROWS] {
    FILTER_TRANSFORM.map(|weights| {
        let terms = taps.clone().zip(weights);
        F::from_f64(terms.map(|(tap, weight)| tap.as_f64() * weight).sum())
    })
}

/// Return Bᵀ·rows: the input transform.
#[inline(always)]
fn transform_input<S: Simd, F: Real>(
    simd: S,
    [a, b, c, d, e, f]: [F::Vector<S>; TRANSFORMED_ROWS],
) -> [F::Vector<S>; TRANSFORMED_ROWS] {
    let add = |factor, x, y| F::multiply_add(simd, F::splat(simd, F::from_f64(factor)), x, y);
    // Two rows of Bᵀ differ only in the sign of the odd part, so they share a pair of parts.
    let (even, odd) = (add(-4.0, c, e), add(-4.0, b, d));
    let (even_2, odd_2) = (add(-1.0, c, e), add(-1.0, b, d));
    [
        add(4.0, a, add(-5.0, c, e)),
        add(1.0, odd, even),
        add(-1.0, odd, even),
        add(2.0, odd_2, even_2),
        add(-2.0, odd_2, even_2),
        add(4.0, b, add(-5.0, d, f)),
    ]
}

/// Return Aᵀ·products: the output transform.
#[inline(always)]
fn transform_output<S: Simd, F: Real>(
    simd: S,
    [a, b, c, d, e, f]: [F::Vector<S>; TRANSFORMED_ROWS],
) -> [F::Vector<S>; OUTPUT_ROWS] {
    let add = |factor, x, y| F::multiply_add(simd, F::splat(simd, F::from_f64(factor)), x, y);
    let (sum_1, sum_2) = (add(1.0, c, b), add(1.0, e, d));
    let (difference_1, difference_2) = (add(-1.0, c, b), add(-1.0, e, d));
    [
        add(1.0, sum_1, add(1.0, sum_2, a)),
        add(2.0, difference_2, difference_1),
        add(4.0, sum_2, sum_1),
        add(8.0, difference_2, add(1.0, difference_1, f)),
    ]
}

/// The transform of six input rows of every plane. The shape of the result is
/// `(TRANSFORMED_ROWS, planes, ROW_STRIDE)`.
pub(super) struct InputTransform<'a, F> {
    pub source: &'a StripedPlanes<'a, F>,
    /// The first row and column of the input. They may lie outside the planes.
    pub top: isize,
    pub left: isize,
    /// The number of rows that the output depends on. Zeros replace the other rows.
    pub rows: usize,
    /// The number of columns.
    pub length: usize,
    pub transformed: &'a mut [F],
}

impl<F: Real> WithSimd for InputTransform<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let StripedPlanes { columns, size, .. } = self.source;
        let lanes = F::lanes::<S>();
        let length = self.length.next_multiple_of(lanes);
        let start = self.left - columns.start as isize;
        let rows: [_; TRANSFORMED_ROWS] = std::array::from_fn(|row| {
            let row = row.min(self.rows - 1) as isize;
            self.source.row(mirror_index(self.top + row, size.0))
        });
        // The columns of the input that lie inside the source.
        let end = self.length.min((columns.len() as isize - start) as usize);
        let inside = (-start).max(0) as usize..end;
        let row_length = self.transformed.len() / TRANSFORMED_ROWS;
        let planes = row_length / ROW_STRIDE;
        // The loops read the source in place, unless whole registers would exceed the strip.
        let fits =
            |row: &PlaneRow<'_, F>| row.plane(planes - 1).len() >= start.max(0) as usize + length;
        let in_place =
            inside == (0..self.length) && self.rows == TRANSFORMED_ROWS && rows.iter().all(fits);
        let mut copies = [[F::zero(); ROW_STRIDE]; TRANSFORMED_ROWS];
        for plane in 0..planes {
            let rows: [&[F]; TRANSFORMED_ROWS] = if in_place {
                rows.map(|row| &row.plane(plane)[start as usize..][..length])
            } else {
                for (copy, row) in copies.iter_mut().zip(rows).take(self.rows) {
                    let row = row.plane(plane);
                    let from = (start + inside.start as isize) as usize;
                    copy[inside.clone()].copy_from_slice(&row[from..][..inside.len()]);
                    for column in (0..inside.start).chain(inside.end..self.length) {
                        let source = mirror_index(self.left + column as isize, size.1);
                        copy[column] = row[source - columns.start];
                    }
                }
                std::array::from_fn(|row| &copies[row][..length])
            };
            let rows = rows.map(F::vectors::<S>);
            let mut parts = self.transformed.chunks_exact_mut(row_length);
            let out: [_; TRANSFORMED_ROWS] = std::array::from_fn(|_| {
                let part = parts.next().unwrap_or_default();
                F::vectors_mut::<S>(&mut part[plane * ROW_STRIDE..][..length])
            });
            for column in 0..length / lanes {
                // This loop uses indices, because methods of arrays may pass registers through
                // memory.
                let column_rows = std::array::from_fn(|row| rows[row][column]);
                let transformed = transform_input::<S, F>(simd, column_rows);
                for row in 0..TRANSFORMED_ROWS {
                    out[row][column] = transformed[row];
                }
            }
        }
    }
}

/// The transform of products into four output rows. The shape of the products is
/// `(TRANSFORMED_ROWS, outputs, padded_length)`.
pub(super) struct OutputTransform<'a, F> {
    pub products: &'a [F],
    pub padded_length: usize,
    /// The first row and column of the output.
    pub row: usize,
    pub column: usize,
    /// The number of columns.
    pub length: usize,
    /// The numbers of rows and columns of `out`.
    pub size: (usize, usize),
    pub out: &'a mut [F],
}

impl<F: Real> WithSimd for OutputTransform<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            padded_length,
            length,
            ..
        } = self;
        let (height, width) = self.size;
        let lanes = F::lanes::<S>();
        let planes = self.out.chunks_exact_mut(height * width);
        for (output, plane) in planes.enumerate() {
            let mut parts = self
                .products
                .chunks_exact(self.products.len() / TRANSFORMED_ROWS);
            let products: [_; TRANSFORMED_ROWS] = std::array::from_fn(|_| {
                let part = parts.next().unwrap_or_default();
                F::vectors::<S>(&part[output * padded_length..][..padded_length])
            });
            // The last group of an output may have fewer than four rows. The missing ones are
            // empty.
            let rows = plane.chunks_exact_mut(width).skip(self.row);
            let mut rows = rows.map(|row| &mut row[self.column..][..length]);
            let rows: [_; OUTPUT_ROWS] = std::array::from_fn(|_| rows.next().unwrap_or_default());
            for column in 0..length.div_ceil(lanes) {
                let column_products = std::array::from_fn(|row| products[row][column]);
                let values = transform_output::<S, F>(simd, column_products);
                for row in 0..OUTPUT_ROWS {
                    let (value, row) = (values[row], &mut *rows[row]);
                    let first = column * lanes;
                    let last = (first + lanes).min(row.len());
                    if first + lanes <= row.len() {
                        F::vectors_mut::<S>(&mut row[first..last])[0] = value;
                    } else if first < last {
                        // The rest of a row is shorter than a register.
                        let mut whole = [F::zero(); MAX_LANES];
                        F::vectors_mut::<S>(&mut whole)[0] = value;
                        row[first..last].copy_from_slice(&whole[..last - first]);
                    }
                }
            }
        }
    }
}
