//! Reconstruct an image from packed bits with a network file, and write it as a PGM file.
//!
//! ```text
//! cargo run --release --example reconstruct -- \
//!     NETWORK.safetensors BITS WIDTH HEIGHT FRAMES OVERSAMPLING IMAGE.pgm
//! ```
//!
//! BITS holds the bytes of the frames: for each row of WIDTH jots ⌈WIDTH/8⌉ bytes, with the first
//! jot in the most significant bit. In Python, `bits.packed.tofile("BITS")` writes such a file. The
//! network must serve the sensor, whose jots receive one photon per frame at intensity 1.

use std::error::Error;
use std::fs;

use jotlight::bits::{PackedBits, packed_width};
use jotlight::likelihood::Threshold;
use jotlight::mle::{JotResponse, PixelResponse};
use jotlight::network::{Network, SensorModel};
use ndarray::{Array2, ArrayView3};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [network, bits, width, height, frames, oversampling, image] = &arguments[..] else {
        return Err("expected NETWORK BITS WIDTH HEIGHT FRAMES OVERSAMPLING IMAGE".into());
    };
    let (width, height): (usize, usize) = (width.parse()?, height.parse()?);
    let (frames, oversampling): (u32, u32) = (frames.parse()?, oversampling.parse()?);

    let bytes = fs::read(bits)?;
    let shape = (frames as usize, height, packed_width(width));
    let packed = PackedBits::new(ArrayView3::from_shape(shape, &bytes)?, width)?;
    let sensor = SensorModel {
        trials: frames * oversampling * oversampling,
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

    let side = oversampling as usize;
    let mut estimate = Array2::zeros((height / side, width / side));
    let network = Network::load(network)?;
    let reconstruction = network.prepare(sensor)?;
    reconstruction.bits(&packed, side, estimate.view_mut())?;

    // The tone curve of sRGB is close to a power of 1/2.2.
    let level = |&intensity: &f32| (255.0 * intensity.powf(1.0 / 2.2)).round() as u8;
    let mut file = format!("P5 {} {} 255\n", estimate.ncols(), estimate.nrows()).into_bytes();
    file.extend(estimate.iter().map(level));
    fs::write(image, file)?;
    Ok(())
}
