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

/// The maximum number of bytes of the sums of a batch of outputs. With the transformed input, they
/// fit into a second-level cache of 512 KiB.
const MAX_BATCH_BYTES: usize = 192 << 10;

/// Transformed filters. The outputs are divided into groups. The values are ordered by product,
/// group, input, and output of the group. Values of 0 fill the last group.
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
        let groups = outputs.div_ceil(group);
        let mut values = vec![F::zero(); groups * group * inputs * PRODUCTS];
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
                    let row = (product * groups + output / group) * inputs + input;
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

    /// Return the number of outputs in a batch, for blocks of `tiles` tiles. A batch holds whole
    /// groups.
    pub fn batch(&self, tiles: usize) -> usize {
        let groups = MAX_BATCH_BYTES / (PRODUCTS * self.group * tiles * size_of::<F>());
        groups.clamp(1, self.outputs.div_ceil(self.group)) * self.group
    }

    /// Write the sums of products of a batch of outputs, which begins at the output `first`.
    ///
    /// The shape of `transformed` is `(PRODUCTS, inputs, N)`, and the shape of `sums` is
    /// `(PRODUCTS, batch, N)`, with distances of `strides` values between products. Their elements
    /// are registers.
    #[inline(always)]
    pub fn multiply<S: Simd, const N: usize>(
        &self,
        simd: S,
        first: usize,
        (transformed, sums): (&[F], &mut [F]),
        strides: (usize, usize),
    ) {
        let (length, groups) = (self.inputs * self.group, self.outputs.div_ceil(self.group));
        let batch = self.batch(N * F::lanes::<S>());
        let batch = first / self.group..((first + batch) / self.group).min(groups);
        // The input of a product stays in the first-level cache for all groups of the batch.
        for product in 0..PRODUCTS {
            let filters = &self.values[product * groups * length..][..groups * length];
            let work = Multiplication::<S, F, N> {
                simd,
                inputs: self.inputs,
                filters: &filters[batch.start * length..batch.end * length],
                transformed: &transformed[product * strides.0..]
                    [..self.inputs * N * F::lanes::<S>()],
                sums: F::vectors_mut::<S>(&mut sums[product * strides.1..]),
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
}

/// The multiplications of one product of groups of filters with `N` registers of tiles.
struct Multiplication<'a, S: Simd, F: Real, const N: usize> {
    simd: S,
    inputs: usize,
    filters: &'a [F],
    transformed: &'a [F],
    sums: &'a mut [F::Vector<S>],
}

impl<S: Simd, F: Real, const N: usize> Multiplication<'_, S, F, N> {
    /// Compute the sums of groups of `O` outputs.
    #[inline(always)]
    fn run<const O: usize>(self) {
        let simd = self.simd;
        let transformed = F::vectors::<S>(self.transformed).as_chunks::<N>().0;
        let filters = self.filters.as_chunks::<O>().0;
        let (out, _) = self.sums.as_chunks_mut::<N>();
        for (filters, out) in filters
            .chunks_exact(self.inputs)
            .zip(out.chunks_exact_mut(O))
        {
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
            out.copy_from_slice(&sums);
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
        // A group takes the time of its outputs, and of 0.7 outputs more for its inputs.
        let tenths = |&&size: &&usize| self.0.div_ceil(size) * (10 * size + 7);
        sizes.iter().min_by_key(tenths).copied().unwrap_or(4)
    }
}
