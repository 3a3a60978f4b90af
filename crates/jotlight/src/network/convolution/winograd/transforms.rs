//! The three transforms of Winograd's algorithm F(4, 3), along one axis.
//!
//! They transform the filters, the input, and the products of both, which become the output. The
//! matrices G, Bᵀ, and Aᵀ are those of Lavin and Gray, *Fast Algorithms for Convolutional Neural
//! Networks* (2016). Along two axes, the transforms follow each other in any order.

use super::{FILTER_SIZE, TILE};
use crate::cpu::Simd;
use crate::numbers::Real;

/// The number of input values along an axis that a tile of the output depends on, and the number
/// of transformed values.
pub(super) const DEPTH: usize = TILE + FILTER_SIZE - 1;

/// The matrix G of the filter transform.
const FILTER_TRANSFORM: [[f64; FILTER_SIZE]; DEPTH] = [
    [1.0 / 4.0, 0.0, 0.0],
    [-1.0 / 6.0, -1.0 / 6.0, -1.0 / 6.0],
    [-1.0 / 6.0, 1.0 / 6.0, -1.0 / 6.0],
    [1.0 / 24.0, 1.0 / 12.0, 1.0 / 6.0],
    [1.0 / 24.0, -1.0 / 12.0, 1.0 / 6.0],
    [0.0, 0.0, 1.0],
];

/// Return G·taps·Gᵀ: the transform of a filter along both axes.
pub(super) fn transform_filter(taps: [[f64; FILTER_SIZE]; FILTER_SIZE]) -> [[f64; DEPTH]; DEPTH] {
    let dot = |a: [f64; FILTER_SIZE], b: [f64; FILTER_SIZE]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    };
    FILTER_TRANSFORM.map(|row_weights| {
        let row = std::array::from_fn(|column| dot(row_weights, taps.map(|row| row[column])));
        FILTER_TRANSFORM.map(|column_weights| dot(column_weights, row))
    })
}

/// Return Bᵀ·values: the input transform.
#[inline(always)]
pub(super) fn transform_input<S: Simd, F: Real>(
    simd: S,
    [a, b, c, d, e, f]: [F::Vector<S>; DEPTH],
) -> [F::Vector<S>; DEPTH] {
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
pub(super) fn transform_output<S: Simd, F: Real>(
    simd: S,
    [a, b, c, d, e, f]: [F::Vector<S>; DEPTH],
) -> [F::Vector<S>; TILE] {
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
