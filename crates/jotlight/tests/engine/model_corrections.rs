//! Images of dim scenes, of dark regions, and of few photons.

#![cfg(feature = "safetensors")]

use jotlight::bits::{PackedBits, add_block_counts, packed_width};
use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::mle::{JotResponse, JotResponses, PixelResponse};
use jotlight::network::{EquivalentCounts, LocalTrials, Network, Pixels, SensorModel};
use jotlight::threads::install;
use jotlight::values::Values;
use ndarray::{Array2, Array3};

use crate::random::Random;

const SIZE: (usize, usize) = (65, 70);

/// Return the network `small` of the Python package. A published crate does not contain it.
fn network() -> Option<Network> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../python/jotlight/networks/weights/small.safetensors"
    );
    Network::load(path).ok()
}

/// Return a sensor with `photons` per jot in all frames together.
fn sensor(frames: u32, photons: f64, threshold: u32) -> Result<SensorModel> {
    Ok(SensorModel {
        trials: frames,
        response: PixelResponse {
            threshold: Threshold::new(threshold)?,
            light_per_intensity: photons / f64::from(frames),
            max_intensity: 1.0,
        },
        jot: JotResponse {
            efficiency: 1.0,
            dark_counts: 0.0,
        },
    })
}

/// Return packed frames of a scene of intensity 0.5.
fn flat_scene(sensor: &SensorModel) -> Array3<u8> {
    let light = 0.5 * sensor.response.light_per_intensity;
    let p = sensor.response.threshold.detection_probability(light);
    let mut random = Random(7);
    let shape = (sensor.trials as usize, SIZE.0, packed_width(SIZE.1));
    Array3::from_shape_simple_fn(shape, || {
        (0..8).fold(0, |byte, _| byte << 1 | u8::from(random.fraction() < p))
    })
}

fn counts_of(bits: &PackedBits<'_>) -> Result<Array2<i32>> {
    let mut counts = Array2::zeros(SIZE);
    add_block_counts(bits, 1, None, counts.view_mut())?;
    Ok(counts)
}

#[test]
fn dim_images_are_as_bright_as_the_scene() -> Result<()> {
    let Some(network) = network() else {
        return Ok(());
    };
    // The first two errors are 0.3 and 0.15 without corrections.
    for (frames, photons, threshold, max_error) in [
        (64, 0.1, 1, 0.2),
        (256, 1.0, 1, 0.1),
        (1, 0.3, 1, 0.1),
        (64, 50.0, 3, 0.05),
    ] {
        let sensor = sensor(frames, photons, threshold)?;
        let packed = flat_scene(&sensor);
        let mut out = Array2::zeros(SIZE);
        let reconstruction = network.prepare(sensor)?;
        let bits = PackedBits::new(packed.view(), SIZE.1)?;
        reconstruction.bits(&bits, 1, out.view_mut())?;
        let ones = counts_of(&bits)?.sum();
        let tolerance = 0.05 + 3.0 / f64::from(ones).sqrt();
        let mean_of = |value: fn(f64) -> f64| {
            out.iter().map(|&c| value(f64::from(c))).sum::<f64>() / out.len() as f64
        };
        let mean = mean_of(|c| c);
        assert!((mean / 0.5 - 1.0).abs() < tolerance, "{frames}: {mean}");
        let error = mean_of(|c| (c - 0.5).powi(2)).sqrt();
        assert!(error < max_error, "{frames}: {error}");
    }
    Ok(())
}

#[test]
fn every_form_of_the_data_leads_to_the_same_image() -> Result<()> {
    let Some(network) = network() else {
        return Ok(());
    };
    for (frames, photons, threshold) in [(4, 0.5, 1), (100, 0.1, 1), (64, 50.0, 3)] {
        let sensor = sensor(frames, photons, threshold)?;
        let reconstruction = network.prepare(sensor)?;
        let packed = flat_scene(&sensor);
        let bits = PackedBits::new(packed.view(), SIZE.1)?;
        let counts = counts_of(&bits)?;
        let mut expected = Array2::zeros(SIZE);
        reconstruction.bits(&bits, 1, expected.view_mut())?;
        for threads in [1, 3] {
            let mut found = Array2::zeros(SIZE);
            let place = found.view_mut();
            install(Some(threads), || {
                reconstruction.counts(counts.view(), place)
            })??;
            assert_eq!(found, expected, "{threads} threads");
        }
        // The jots of all pixels are stated one by one.
        let (ones, zeros) = (vec![1.0; counts.len()], vec![0.0; counts.len()]);
        let pixels = Pixels {
            counts: counts.view(),
            trials: Values::Same(f64::from(frames)),
            jots: JotResponses {
                efficiency: Values::Each(&ones),
                dark_counts: Values::Each(&zeros),
            },
        };
        let mut found = Array2::zeros(SIZE);
        reconstruction.pixels(&pixels, found.view_mut())?;
        let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-5;
        assert!(found.iter().zip(&expected).all(close), "{frames} frames");
    }
    Ok(())
}

#[test]
fn squares_say_more_than_equivalent_counts() -> Result<()> {
    let Some(network) = network() else {
        return Ok(());
    };
    let sensor = sensor(4, 0.1, 1)?;
    let reconstruction = network.prepare(sensor)?;
    let packed = flat_scene(&sensor);
    let counts = counts_of(&PackedBits::new(packed.view(), SIZE.1)?)?;
    let (mut found, mut without) = (Array2::zeros(SIZE), Array2::zeros(SIZE));
    reconstruction.counts(counts.view(), found.view_mut())?;
    let real = counts.mapv(|count| count as f32);
    let equivalent = EquivalentCounts {
        counts: real.view(),
        of: 4,
        trials: LocalTrials::Same(4),
    };
    reconstruction.equivalent_counts(&[equivalent], vec![without.view_mut()])?;
    let error = |image: &Array2<f32>| image.mapv(|c| (c - 0.5).powi(2)).sum();
    assert!(error(&found) < 0.7 * error(&without));
    Ok(())
}
