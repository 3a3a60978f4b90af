//! The forward pass of networks.

use jotlight::bits::{PackedBits, packed_width};
use jotlight::error::Result;
use jotlight::network::{Layer, Wiring, forward, forward_bits, forward_counts, masked_sums};
use ndarray::{Array2, Ix3};

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;
use crate::layers::LayerArguments;

pub const CHECKS: &[(&str, Check)] = &[
    ("forward", check_forward),
    ("forward_counts", check_forward_counts),
    ("forward_bits", check_forward_bits),
    ("masked_sums", check_masked_sums),
];

/// Return a network whose first layer has filters of the shape `(C, frames, side, side)`.
fn network(
    input: &mut Input<'_>,
    channels: usize,
    (frames, side): (usize, usize),
) -> Vec<LayerArguments> {
    let plain = Wiring::default();
    let mut layers = vec![LayerArguments::new(
        input,
        (channels, frames, side, side),
        plain,
        true,
    )];
    let mut last = channels;
    for _ in 0..input.below(3) {
        let (outputs, rows, columns) = match input.below(4) {
            0 => (16 + input.below(3), 3, 3),
            _ => (1 + input.below(3), 1 + input.below(5), 1 + input.below(5)),
        };
        let has_splines = !input.rarely(8);
        match input.below(4) {
            // A coarse layer, and a layer that restores the resolution.
            0 => {
                let stride = 2.min(rows).min(columns);
                let down = Wiring { stride, ..plain };
                let up = Wiring {
                    upsampling: stride,
                    ..plain
                };
                let up_outputs = outputs * stride * stride;
                layers.push(LayerArguments::new(
                    input,
                    (outputs, last, rows, columns),
                    down,
                    true,
                ));
                let shape = (up_outputs, outputs, 3, 3);
                layers.push(LayerArguments::new(input, shape, up, has_splines));
            }
            // A skip connection.
            1 if last == outputs => {
                let skip = Wiring {
                    skip: Some(layers.len() - 1),
                    ..plain
                };
                let shape = (outputs, last, rows, columns);
                layers.push(LayerArguments::new(input, shape, skip, has_splines));
            }
            _ => {
                let shape = (outputs, last, rows, columns);
                layers.push(LayerArguments::new(input, shape, plain, has_splines));
            }
        }
        last = outputs;
    }
    let shape = (1, last, 1 + input.below(4), 1 + input.below(4));
    layers.push(LayerArguments::new(input, shape, plain, true));
    layers
}

/// Run `compute` with the layers, and check that the image lies between the coefficients of the
/// last spline.
fn check_network(
    layers: &[LayerArguments],
    compute: impl Fn(bool, &[&Layer<f32>]) -> Result<Vec<f32>> + Sync,
) -> Option<()> {
    let image = consistent(|is_standard| {
        let layers: Result<Vec<_>> = layers
            .iter()
            .map(|layer| layer.build(is_standard))
            .collect();
        let layers = layers?;
        compute(is_standard, &layers.iter().collect::<Vec<_>>())
    })?;
    let (low, high) = layers.last()?.bounds()?;
    assert!(
        image.iter().all(|x| (low..=high).contains(x)),
        "{image:?} of [{low}, {high}]"
    );
    Some(())
}

fn check_forward(input: &mut Input<'_>) -> Option<()> {
    let channels = 1 + input.below(4);
    let layers = network(input, channels, (1, 1));
    let shape = (input.almost(channels), input.size(), input.size());
    let sums = Grid::floats(input, shape);
    check_network(&layers, |is_standard, layers| {
        let sums = sums.arranged(is_standard).to_f32();
        let mut out = Array2::zeros((sums.shape()[1], sums.shape()[2]));
        forward(layers, sums.view::<Ix3>(), out.view_mut())?;
        Ok(out.into_iter().collect())
    })
}

fn check_forward_counts(input: &mut Input<'_>) -> Option<()> {
    let channels = 1 + input.below(4);
    let layers = network(input, channels, (1, 1));
    let max = if input.rarely(8) {
        300
    } else {
        input.size() as i32
    };
    let shape = (input.size(), input.size());
    let counts = input.counts(shape.0 * shape.1, max);
    let counts = Grid::new(input, shape, counts);
    let sums_shape = (input.almost(channels), input.almost(max as usize + 1));
    let sums = Grid::floats(input, sums_shape);
    check_network(&layers, |is_standard, layers| {
        let (counts, sums) = (
            counts.arranged(is_standard),
            sums.arranged(is_standard).to_f32(),
        );
        let counts = counts.view();
        let mut out = Array2::zeros(counts.dim());
        forward_counts(layers, counts, sums.view(), out.view_mut())?;
        Ok(out.into_iter().collect())
    })
}

struct Jots {
    packed: Grid<u8>,
    valid: Grid<u8>,
    width: usize,
    channels: usize,
    frames: usize,
    side: usize,
}

impl Jots {
    fn new(input: &mut Input<'_>) -> Self {
        let (channels, frames) = (1 + input.below(4), input.size().min(6));
        let (side, height, width) = (input.size().min(9), input.size(), input.size());
        let (rows, width) = (height * side, width * side);
        let shape = (
            input.almost(frames),
            input.almost(rows),
            packed_width(width),
        );
        let bytes = input.random_bytes(shape.0 * shape.1 * shape.2);
        let valid_shape = (input.almost(rows), shape.2);
        let valid_bytes = input.random_bytes(valid_shape.0 * valid_shape.1);
        Self {
            packed: Grid::new(input, shape, bytes),
            valid: Grid::new(input, valid_shape, valid_bytes),
            width,
            channels,
            frames,
            side,
        }
    }
}

fn check_forward_bits(input: &mut Input<'_>) -> Option<()> {
    let jots = Jots::new(input);
    let layers = network(input, jots.channels, (jots.frames, jots.side));
    check_network(&layers, |is_standard, layers| {
        let packed = jots.packed.arranged(is_standard);
        let bits = PackedBits::new(packed.view(), jots.width)?;
        let side = jots.side.max(1);
        let (_, rows, columns) = bits.shape();
        let mut out = Array2::zeros((rows / side, columns / side));
        forward_bits(layers, &bits, out.view_mut())?;
        Ok(out.into_iter().collect())
    })
}

fn check_masked_sums(input: &mut Input<'_>) -> Option<()> {
    let jots = Jots::new(input);
    let shape = (
        jots.channels,
        jots.frames,
        jots.side,
        input.almost(jots.side),
    );
    let layer = LayerArguments::new(input, shape, Wiring::default(), false);
    consistent(|is_standard| {
        let (packed, valid) = (
            jots.packed.arranged(is_standard),
            jots.valid.arranged(is_standard),
        );
        let bits = PackedBits::new(packed.view(), jots.width)?;
        let sums = masked_sums(&layer.build(is_standard)?, &bits, valid.view())?;
        Ok(sums.iter().copied().collect::<Vec<f32>>())
    })
    .map(|_| ())
}
