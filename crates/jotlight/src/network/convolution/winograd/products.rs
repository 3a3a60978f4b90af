//! The products of transformed filters and transformed inputs, summed over the inputs.

use ndarray::ArrayView4;

use super::FILTER_SIZE;
use super::transforms::{DEPTH, transform_filter};
use crate::cpu::{self, Simd, WithSimd};
use crate::numbers::Real;

/// The number of products per tile.
pub(super) const PRODUCTS: usize = DEPTH * DEPTH;

/// The numbers of outputs that can be computed together on a processor with 32 vector registers
/// or more. The sums of a group for two registers of tiles stay in registers.
const LARGE_GROUPS: &[usize] = &[13, 12, 10, 8, 4];
/// The same for processors with fewer registers.
const SMALL_GROUPS: &[usize] = &[6, 5, 4];

/// The maximum number of outputs in a group.
pub(super) const MAX_GROUP: usize = 13;

/// Transformed filters. The outputs are divided into groups. The values of a group are ordered by
/// product, input, and output. Values of 0 fill the last group.
#[derive(Clone, Debug)]
pub(super) struct TransformedFilters<F> {
    values: Vec<F>,
    /// The number of outputs in a group.
    pub group: usize,
    pub inputs: usize,
    pub outputs: usize,
}

impl<F: Real> TransformedFilters<F> {
    /// Return the transform of filters `(outputs, inputs, 3, 3)`.
    pub fn new(filters: ArrayView4<'_, F>) -> Self {
        let (outputs, inputs, _, _) = filters.dim();
        let group = cpu::run(GroupSize(outputs));
        let mut values = vec![F::zero(); outputs.next_multiple_of(group) * inputs * PRODUCTS];
        for output in 0..outputs {
            for input in 0..inputs {
                // The taps are reversed, so that the loops read their input forward.
                let taps = std::array::from_fn(|row| {
                    std::array::from_fn(|column| {
                        let (row, column) = (FILTER_SIZE - 1 - row, FILTER_SIZE - 1 - column);
                        filters[[output, input, row, column]].as_f64()
                    })
                });
                let transformed = transform_filter(taps);
                for (product, value) in transformed.into_iter().flatten().enumerate() {
                    let row = (output / group * PRODUCTS + product) * inputs + input;
                    values[row * group + output % group] = F::from_f64(value);
                }
            }
        }
        Self {
            values,
            group,
            inputs,
            outputs,
        }
    }

    /// Write the sums of products of a group of outputs.
    ///
    /// The shape of `transformed` is `(PRODUCTS, inputs, N)` with a distance of `stride` values
    /// between products, and the shape of `sums` is `(group, N, PRODUCTS)`. Their elements are
    /// registers.
    #[inline(always)]
    pub fn multiply<S: Simd, const N: usize>(
        &self,
        simd: S,
        group: usize,
        (transformed, stride): (&[F], usize),
        sums: &mut [F],
    ) {
        let length = PRODUCTS * self.inputs * self.group;
        let work = Multiplication::<S, F, N> {
            simd,
            inputs: self.inputs,
            filters: &self.values[group * length..][..length],
            transformed,
            stride,
            sums: F::vectors_mut::<S>(sums),
        };
        match self.group {
            13 => work.run::<13>(),
            12 => work.run::<12>(),
            10 => work.run::<10>(),
            8 => work.run::<8>(),
            6 => work.run::<6>(),
            5 => work.run::<5>(),
            _ => work.run::<4>(),
        }
    }
}

/// The multiplication of one group of filters with `N` registers of tiles.
struct Multiplication<'a, S: Simd, F: Real, const N: usize> {
    simd: S,
    inputs: usize,
    filters: &'a [F],
    transformed: &'a [F],
    stride: usize,
    sums: &'a mut [F::Vector<S>],
}

impl<S: Simd, F: Real, const N: usize> Multiplication<'_, S, F, N> {
    /// Compute the sums of `O` outputs.
    #[inline(always)]
    fn run<const O: usize>(self) {
        let simd = self.simd;
        let filters = self.filters.as_chunks::<O>().0;
        let inputs = filters.chunks_exact(self.inputs);
        let transformed = self.transformed.chunks_exact(self.stride);
        let (tiles, _) = self.sums[..O * N * PRODUCTS].as_chunks_mut::<PRODUCTS>();
        for (product, (filters, transformed)) in inputs.zip(transformed).enumerate() {
            let transformed = F::vectors::<S>(transformed).as_chunks::<N>().0;
            let mut sums = [[F::splat(simd, F::zero()); N]; O];
            for (values, filters) in transformed.iter().zip(filters) {
                for output in 0..O {
                    let factor = F::splat(simd, filters[output]);
                    for register in 0..N {
                        let sum = &mut sums[output][register];
                        *sum = F::multiply_add(simd, values[register], factor, *sum);
                    }
                }
            }
            for output in 0..O {
                for register in 0..N {
                    tiles[output * N + register][product] = sums[output][register];
                }
            }
        }
    }
}

/// The number of outputs in a group, for a number of outputs.
struct GroupSize(usize);

impl WithSimd for GroupSize {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        let sizes = if S::REGISTER_COUNT < 32 {
            SMALL_GROUPS
        } else {
            LARGE_GROUPS
        };
        // The group that wastes the fewest outputs. Among equal ones, the first is the largest.
        let best = sizes
            .iter()
            .min_by_key(|&&size| self.0.next_multiple_of(size));
        best.copied().unwrap_or(4)
    }
}
