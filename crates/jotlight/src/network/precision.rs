//! The precision of the products of a network: `f32` or bfloat16.
//!
//! In bfloat16, a layer rounds its filters and the planes that it reads, if these are several planes
//! of a layer other than the first one. All sums, splines, and other values remain `f32`: the data,
//! the layers that read them or a single plane, and the planes that only a skip connection reads.
//! In the networks of this crate, these carry the smoothed data to the output.

use ndarray::Array4;

use crate::cpu::levels;
use crate::error::{Error, Result};
use crate::numbers::Real;

/// The precision of the products of a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// Numbers of 32 bits.
    #[default]
    F32,
    /// Filters and planes of bfloat16, numbers of 16 bits with 8 bits of precision.
    Bf16,
}

impl Precision {
    /// Return the precision with a name: `f32` or `bf16`.
    ///
    /// # Errors
    /// [`Error::Range`] for another name.
    pub fn named(name: &str) -> Result<Self> {
        match name {
            "f32" => Ok(Self::F32),
            "bf16" => Ok(Self::Bf16),
            _ => Err(Error::range("precision", "f32 or bf16", name)),
        }
    }
}

/// What a layer rounds to bfloat16.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rounding {
    /// Whether the filters are rounded. The planes that they read are, too.
    pub filters: bool,
    /// Whether the output is rounded.
    pub output: bool,
}

/// Return what each layer rounds in bfloat16, from the number of planes that each layer reads, and
/// the index of the layer whose output it reads.
pub(super) fn roundings(inputs: &[(usize, usize)]) -> Vec<Rounding> {
    let mut roundings = vec![Rounding::default(); inputs.len()];
    for (index, &(planes, input)) in inputs.iter().enumerate() {
        if planes > 1 && input > 0 {
            roundings[index].filters = true;
            roundings[input].output = true;
        }
    }
    roundings
}

/// Return the bfloat16 that is nearest to a finite number, and the even one of two.
#[inline(always)]
pub(super) fn round(x: f32) -> f32 {
    let bits = x.to_bits();
    let half = 0x7fff + (bits >> 16 & 1);
    f32::from_bits(bits.wrapping_add(half) & 0xffff_0000)
}

/// Round filters `(outputs, inputs, height, width)` to bfloat16.
///
/// The error of a tap is added to the next tap of its filter. So the sum of a filter, on which flat
/// regions depend, hardly changes.
pub(super) fn round_filters(filters: &mut Array4<f32>) {
    for mut bank in filters.outer_iter_mut() {
        for mut filter in bank.outer_iter_mut() {
            let mut error = 0.0;
            for tap in &mut filter {
                let exact = f64::from(*tap) + error;
                *tap = round(exact as f32);
                error = exact - f64::from(*tap);
            }
        }
    }
}

levels! {
    /// Round values of `f32` to bfloat16. Values of other types remain as they are.
    pub(super) fn round_all[F: Real](values: &mut [F]) = round_all_inlined;
}

#[inline(always)]
pub(super) fn round_all_inlined<F: Real>(values: &mut [F]) {
    if let Some(values) = F::as_f32_slice(values) {
        for value in values {
            *value = round(*value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_to_the_nearest_and_to_even() {
        // The last bit of bfloat16 near 1 is worth 2⁻⁷.
        let ulp = 1.0 / 128.0;
        for (x, expected) in [
            (0.0, 0.0),
            (1.0, 1.0),
            (1.0 + 0.49 * ulp, 1.0),
            (1.0 + 0.5 * ulp, 1.0),
            (1.0 + 0.51 * ulp, 1.0 + ulp),
            (1.0 + 1.5 * ulp, 1.0 + 2.0 * ulp),
            (-1.0 - 2.5 * ulp, -1.0 - 2.0 * ulp),
            (2.0 - 0.1 * ulp, 2.0),
        ] {
            let mut all = [x; 37];
            round_all(&mut all);
            for rounded in all {
                assert_eq!(f32::to_bits(rounded), f32::to_bits(expected), "{x}");
            }
        }
    }

    #[test]
    fn the_sums_of_filters_hardly_change() {
        let taps = Array4::from_shape_fn((3, 4, 3, 3), |(o, i, row, column)| {
            0.1 * ((7 * o + 5 * i + 3 * row + column) as f32 * 0.7).sin()
        });
        let mut rounded = taps.clone();
        round_filters(&mut rounded);
        // The last bit of a number below 1/8 is worth at most 2⁻¹¹.
        let ulp = 2f32.powi(-11);
        for (taps, rounded) in taps.outer_iter().zip(rounded.outer_iter()) {
            for (taps, rounded) in taps.outer_iter().zip(rounded.outer_iter()) {
                assert!((taps.sum() - rounded.sum()).abs() <= 0.51 * ulp);
                for (&tap, &rounded) in taps.iter().zip(&rounded) {
                    assert!((tap - rounded).abs() <= ulp);
                    assert_eq!(f32::to_bits(rounded), f32::to_bits(round(rounded)));
                }
            }
        }
    }

    #[test]
    fn layers_round_what_products_of_several_planes_read() {
        // The data, a plane that is added at the end, a filter of one plane, and two layers.
        let inputs = [(1, 0), (1, 0), (1, 0), (24, 2), (24, 3)];
        let roundings = roundings(&inputs);
        let filters: Vec<_> = roundings.iter().map(|each| each.filters).collect();
        let outputs: Vec<_> = roundings.iter().map(|each| each.output).collect();
        assert_eq!(filters, [false, false, false, true, true]);
        assert_eq!(outputs, [false, false, true, true, false]);
    }
}
