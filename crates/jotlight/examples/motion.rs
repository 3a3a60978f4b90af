//! Find the velocity of a moving scene from its bits, and reconstruct the scene with a network file.
//!
//! ```text
//! cargo run --release --example motion -- NETWORK.safetensors
//! ```
//!
//! The example draws the bits itself. The conventions of the engine are:
//!
//! - Displacements and velocities are in pixels, first down and then to the right. They say where the
//!   scene moves: at +1, a scene point is in the next row.
//! - A displacement u(x, t) is relative to a reference time, at which it is 0. The scene point that
//!   pixel x shows at the reference time is at x + u(x, t) in frame t.
//! - Times of frames are in units of the fields of displacements: at time n, the frame has the
//!   displacements of field n, and between two fields, they change linearly.
//! - Scores are for displacements per block of frames.

use std::process::ExitCode;

use jotlight::bits::{Blocks, PackedBits, add_counts_of_blocks, packed_width};
use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::mle::{JotResponse, PixelResponse};
use jotlight::motion::{
    BLOCK, Displacements, ShiftedCounts, Windows, count_shifted, peak_of_shifted_scores,
    velocity_scores,
};
use jotlight::network::{Network, SensorModel};
use jotlight::sensing::{Image, Kernel, PerJot, Sensor, Window, expose};
use ndarray::{Array2, Array3, Array4, s};

/// The height and the width of the scene.
const SIZE: (usize, usize) = (64, 64);

const FRAMES: usize = 64;

/// The number of frames that are counted together to find the velocity.
const FRAMES_PER_BLOCK: usize = 8;

/// The largest velocity that is tried, and the distance between those, in pixels per block.
const MAX_VELOCITY: f64 = 2.0;
const VELOCITY_STEP: f64 = 0.25;

fn main() -> ExitCode {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("error: expected the path of a network file");
        return ExitCode::FAILURE;
    };
    let result = Network::load(path).and_then(|network| reconstruct(&network, [1.0, -0.5]));
    match result {
        Ok((found, estimate)) => {
            let error = root_mean_squared_error(&estimate);
            println!("velocity: {found:?} pixels per block; error of the image: {error:.3}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Draw the bits of a scene with a velocity in pixels per block, and return the velocity that they
/// show and the estimate of the scene.
fn reconstruct(network: &Network, velocity: [f64; 2]) -> Result<([f64; 2], Array2<f32>)> {
    let bytes = draw(velocity)?;
    let bits = PackedBits::new(bytes.view(), SIZE.1)?;
    let found = find_velocity(&bits)?;
    let (ones, trials) = count(&bits, found)?;
    let mut estimate = Array2::zeros(SIZE);
    let sensor = SensorModel {
        trials: FRAMES as u32,
        response: PixelResponse {
            threshold: Threshold::new(1)?,
            light_per_intensity: 1.0,
            max_intensity: 1.0,
        },
        jot: JotResponse {
            efficiency: 1.0,
            dark_counts: 0.0,
        },
    };
    // Pixels that leave the frame have fewer trials than the others.
    let trials = trials.mapv(f64::from);
    let reconstruction = network.prepare(sensor)?;
    reconstruction.counts_of_trials(ones.view(), trials.view(), estimate.view_mut())?;
    Ok((found, estimate))
}

/// Return the intensity of a scene point.
fn scene(row: f64, column: f64) -> f64 {
    let waves = (0.31 * row + 0.12 * column).sin() + (0.45 * column - 0.23 * row).sin();
    0.5 + 0.15 * waves + 0.15 * (0.9 * row).sin() * (0.7 * column).sin()
}

/// Return how far the scene has moved in a frame since the reference time, the middle of all frames.
fn displacement(velocity: [f64; 2], frame: usize) -> [f64; 2] {
    let middle = (FRAMES - 1) as f64 / 2.0;
    velocity.map(|velocity| velocity * (frame as f64 - middle) / FRAMES_PER_BLOCK as f64)
}

/// Draw the packed bits of a moving scene, one photon per jot and frame at intensity 1.
fn draw(velocity: [f64; 2]) -> Result<Array3<u8>> {
    let sensor = Sensor {
        kernel: Kernel::new(0, 1)?,
        gain_per_frame: 1.0,
        efficiency: PerJot::Same(1.0),
        dark_counts: PerJot::Same(0.0),
        dead: None,
        threshold: Threshold::new(1)?,
    };
    let mut bytes = Array3::zeros((FRAMES, SIZE.0, packed_width(SIZE.1)));
    for frame in 0..FRAMES {
        let [down, right] = displacement(velocity, frame);
        let image = Array2::from_shape_fn(SIZE, |(row, column)| {
            scene(row as f64 - down, column as f64 - right)
        });
        let window = Window {
            frames: frame..frame + 1,
            rows: 0..SIZE.0,
            columns: 0..SIZE.1,
        };
        let out = bytes.slice_mut(s![frame..=frame, .., ..]);
        expose(&sensor, Image::F64(image.view()), [7; 32], 0, &window, out)?;
    }
    Ok(bytes)
}

/// Return the velocity of the whole scene in pixels per block.
fn find_velocity(bits: &PackedBits<'_>) -> Result<[f64; 2]> {
    let mut counts = Array3::zeros((FRAMES / FRAMES_PER_BLOCK, SIZE.0, SIZE.1));
    let blocks = Blocks {
        before: 0,
        length: FRAMES_PER_BLOCK,
        weight: 1,
    };
    add_counts_of_blocks(bits, 1, blocks, counts.view_mut())?;
    let number = (MAX_VELOCITY / VELOCITY_STEP) as i32;
    let line: Vec<f64> = (-number..=number)
        .map(|index| VELOCITY_STEP * f64::from(index))
        .collect();
    // Several windows with the shifts of a hypothesis would find scenes that rotate or zoom.
    let corners = [(0, 0)];
    let windows = Windows {
        corners: &corners,
        size: SIZE,
        filters: (0.5, 6.0),
    };
    let scores = velocity_scores(counts.view(), windows, &[1, 2, 4], &line)?;
    let no_shifts = Array3::zeros((1, corners.len(), 2));
    let peak = peak_of_shifted_scores(scores.view(), no_shifts.view())?;
    Ok([line[peak[0].place.0], line[peak[0].place.1]])
}

/// Return the numbers of ones and of trials of each pixel along a motion.
fn count(bits: &PackedBits<'_>, velocity: [f64; 2]) -> Result<(Array2<i32>, Array2<i32>)> {
    // Field 0 belongs to the first frame, and field 1 to the last one. One tile covers the image.
    let ends = [0, FRAMES - 1].map(|frame| displacement(velocity, frame));
    let fields = Array4::from_shape_fn((2, 2, 1, 1), |(field, direction, ..)| {
        ends[field][direction] as f32
    });
    let tile = SIZE.0.max(SIZE.1);
    let motion = Displacements::new(fields.view(), Some(tile), SIZE.0, SIZE.1)?;
    let times: Vec<f64> = (0..FRAMES)
        .map(|frame| frame as f64 / (FRAMES - 1) as f64)
        .collect();
    let (mut ones, mut trials) = (Array2::zeros(SIZE), Array2::zeros(SIZE));
    let mut remainders = Array3::zeros((SIZE.0, 2, SIZE.1.div_ceil(BLOCK)));
    let sums = ShiftedCounts {
        ones: ones.view_mut(),
        trials: trials.view_mut(),
        remainders: remainders.view_mut(),
    };
    count_shifted(bits, &motion, &times, None, sums)?;
    Ok((ones, trials))
}

/// Return the error of an estimate of the scene at the reference time.
fn root_mean_squared_error(estimate: &Array2<f32>) -> f64 {
    let squares = estimate.indexed_iter().map(|((row, column), &intensity)| {
        (f64::from(intensity) - scene(row as f64, column as f64)).powi(2)
    });
    (squares.sum::<f64>() / estimate.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_have_the_sign_of_the_motion() -> Result<()> {
        for velocity in [[1.0, -0.5], [-0.75, 1.5]] {
            let bytes = draw(velocity)?;
            let bits = PackedBits::new(bytes.view(), SIZE.1)?;
            let found = find_velocity(&bits)?.map(f64::to_bits);
            assert_eq!(found, velocity.map(f64::to_bits));
        }
        Ok(())
    }

    #[test]
    fn counts_along_the_motion_show_the_scene() -> Result<()> {
        let velocity = [1.0, -0.5];
        let bytes = draw(velocity)?;
        let bits = PackedBits::new(bytes.view(), SIZE.1)?;
        let errors = [velocity, [0.0; 2], velocity.map(|value| -value)].map(|velocity| {
            let (ones, trials) = count(&bits, velocity)?;
            let estimate = Array2::from_shape_fn(SIZE, |place| {
                let share = f64::from(ones[place]) / f64::from(trials[place]);
                -(-share).ln_1p() as f32
            });
            Ok(root_mean_squared_error(&estimate))
        });
        let [along, still, opposite] = errors;
        let (along, still, opposite) = (along?, still?, opposite?);
        assert!(along < 0.95 * still, "{along} {still}");
        assert!(still < 0.95 * opposite, "{still} {opposite}");
        Ok(())
    }

    #[test]
    fn the_network_removes_the_noise() -> Result<()> {
        let network = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../python/jotlight/networks/weights/medium.safetensors"
        );
        // A published crate does not contain the networks.
        if std::path::Path::new(network).exists() {
            let (_, estimate) = reconstruct(&Network::load(network)?, [1.0, -0.5])?;
            let error = root_mean_squared_error(&estimate);
            assert!(error < 0.06, "{error}");
        }
        Ok(())
    }
}
