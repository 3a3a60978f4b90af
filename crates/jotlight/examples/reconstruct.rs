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

use std::fs;
use std::process::ExitCode;
use std::str::FromStr;

use jotlight::bits::{PackedBits, packed_width};
use jotlight::likelihood::Threshold;
use jotlight::mle::{JotResponse, PixelResponse};
use jotlight::network::{Network, SensorModel};
use ndarray::{Array2, ArrayView3};

const USAGE: &str = "NETWORK BITS WIDTH HEIGHT FRAMES OVERSAMPLING IMAGE";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match reconstruct(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}

/// Write the image that the arguments describe, or return what is wrong with them.
fn reconstruct(arguments: &[String]) -> Result<(), String> {
    let [network, bits, width, height, frames, oversampling, image] = arguments else {
        let received = arguments.len();
        return Err(format!(
            "arguments: expected {USAGE}, got {received} of them"
        ));
    };
    let (width, height): (usize, usize) = (number("WIDTH", width)?, number("HEIGHT", height)?);
    let (frames, side): (u32, u32) = (
        number("FRAMES", frames)?,
        number("OVERSAMPLING", oversampling)?,
    );
    let jots = side.checked_mul(side);
    let trials = jots.and_then(|jots| jots.checked_mul(frames));
    let trials = trials.ok_or("FRAMES and OVERSAMPLING: expected less than 2^32 bits per pixel")?;
    let sensor = SensorModel {
        trials,
        response: PixelResponse {
            threshold: Threshold::new(1).map_err(text)?,
            light_per_intensity: 1.0,
            max_intensity: 1.0,
        },
        jot: JotResponse {
            efficiency: 1.0,
            dark_counts: 0.0,
        },
    };
    let network = Network::load(network).map_err(text)?;
    let reconstruction = network.prepare(sensor).map_err(text)?;

    let bytes = fs::read(bits).map_err(|error| format!("{bits}: {error}"))?;
    let shape = (frames as usize, height, packed_width(width));
    let packed = ArrayView3::from_shape(shape, &bytes).map_err(|_| {
        let (frames, rows, columns) = shape;
        let received = bytes.len();
        format!("{bits}: expected {frames} x {rows} x {columns} bytes, got {received}")
    })?;
    let packed = PackedBits::new(packed, width).map_err(text)?;
    let side = side as usize;
    let mut estimate = Array2::zeros((height / side, width / side));
    let result = reconstruction.bits(&packed, side, estimate.view_mut());
    result.map_err(text)?;

    // The tone curve of sRGB is close to a power of 1/2.2.
    let level = |&intensity: &f32| (255.0 * intensity.powf(1.0 / 2.2)).round() as u8;
    let mut file = format!("P5 {} {} 255\n", estimate.ncols(), estimate.nrows()).into_bytes();
    file.extend(estimate.iter().map(level));
    fs::write(image, file).map_err(|error| format!("{image}: {error}"))
}

/// Return a whole number above 0.
fn number<N: FromStr + Default + PartialEq>(name: &str, argument: &str) -> Result<N, String> {
    let number = argument
        .parse()
        .ok()
        .filter(|number| *number != N::default());
    let wrong = || format!("{name}: expected a whole number above 0, got {argument}");
    number.ok_or_else(wrong)
}

fn text(error: jotlight::error::Error) -> String {
    error.to_string()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const NETWORK: &str = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../python/jotlight/networks/weights/medium.safetensors"
    );

    /// Return the message for four frames of 3 × 8 jots, after a change of one of the arguments.
    fn message(folder: &Path, index: usize, argument: &str) -> String {
        let place = |name: &str| folder.join(name).display().to_string();
        let mut arguments = [
            NETWORK.into(),
            place("bits"),
            "8".into(),
            "3".into(),
            "4".into(),
            "1".into(),
            place("image.pgm"),
        ];
        if let Some(changed) = arguments.get_mut(index) {
            *changed = argument.into();
        }
        reconstruct(&arguments).err().unwrap_or_default()
    }

    #[test]
    fn wrong_arguments_have_clear_messages() -> std::io::Result<()> {
        // A published crate does not contain the networks.
        if !Path::new(NETWORK).exists() {
            return Ok(());
        }
        let name = format!("jotlight-reconstruct-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("bits"), [0b0110_1001; 12])?;
        let large = u32::MAX.to_string();
        for (index, argument, expected) in [
            (0, "missing.safetensors", "missing.safetensors: "),
            (1, "missing", "missing: "),
            (
                2,
                "eight",
                "WIDTH: expected a whole number above 0, got eight",
            ),
            (2, "9", "expected 4 x 3 x 2 bytes, got 12"),
            (2, "18446744073709551615", "bytes, got 12"),
            (3, "0", "HEIGHT: expected a whole number above 0, got 0"),
            (4, "-1", "FRAMES: expected a whole number above 0, got -1"),
            (
                5,
                "0",
                "OVERSAMPLING: expected a whole number above 0, got 0",
            ),
            (5, "3", "multiples of the oversampling 3, got 3 x 8"),
            (5, &large, "expected less than 2^32 bits per pixel"),
            (6, "/missing/image.pgm", "/missing/image.pgm: "),
        ] {
            let message = message(&folder, index, argument);
            assert!(message.contains(expected), "{argument}: {message}");
        }
        assert_eq!(message(&folder, usize::MAX, ""), "");
        let image = fs::read(folder.join("image.pgm"))?;
        assert_eq!(image.len(), b"P5 8 3 255\n".len() + 24);
        assert_eq!(
            reconstruct(&[]),
            Err(format!("arguments: expected {USAGE}, got 0 of them"))
        );
        fs::remove_dir_all(folder)
    }
}
