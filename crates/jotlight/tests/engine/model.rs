//! Networks of which the output is known: identity networks, and networks whose parameters are
//! interpolated by hand.

use jotlight::bits::{PackedBits, add_block_counts};
use jotlight::error::{Error, Result};
use jotlight::likelihood::Threshold;
use jotlight::mle::{JotResponse, PixelResponse};
use jotlight::network::{
    Layer, LayerParameters, Network, SensorModel, Served, Wiring, forward_counts,
};
use ndarray::{Array2, ArrayD, IxDyn, array};

use crate::random::{Random, random_bits};

/// Images of fewer than 32 rows have no squares.
const SIZE: (usize, usize) = (29, 41);

/// Return a sensor whose jots receive `light` photons per frame at intensity 1.
pub fn sensor(trials: u32, light: f64) -> Result<SensorModel> {
    Ok(SensorModel {
        trials,
        response: PixelResponse {
            threshold: Threshold::new(1)?,
            light_per_intensity: light,
            max_intensity: 1.0,
        },
        jot: JotResponse {
            efficiency: 0.8,
            dark_counts: 0.01,
        },
    })
}

fn filled(shape: &[usize], mut value: impl FnMut() -> f32) -> ArrayD<f32> {
    ArrayD::from_shape_simple_fn(IxDyn(shape), &mut value)
}

/// Return a layer of one filter that is the identity on [0, 1].
pub fn identity(taps: usize) -> LayerParameters {
    let mut filters = ArrayD::zeros(IxDyn(&[1, 1, taps, taps]));
    filters[[0, 0, taps / 2, taps / 2]] = 1.0;
    LayerParameters {
        filters,
        coefficients: Some(array![[-1.0, 0.0, 1.0, 2.0]].into_dyn()),
        start: 0.0,
        spacing: 1.0,
        wiring: Wiring::default(),
    }
}

fn identity_network() -> Result<Network> {
    Network::new(
        vec![identity(1), identity(5)],
        Served::Trials { min: 1, max: 256 },
    )
}

#[test]
fn the_halo_is_the_radius_of_the_receptive_field() -> Result<()> {
    let layer = |shape: &[usize], stride, upsampling, skip| LayerParameters {
        filters: filled(shape, || 0.1),
        coefficients: None,
        start: 0.0,
        spacing: 1.0,
        wiring: Wiring {
            stride,
            upsampling,
            input: None,
            skip,
        },
    };
    let served = Served::Sensor(sensor(16, 1.0)?);
    for (layers, halo) in [
        (vec![layer(&[1, 1, 1, 1], 1, 1, None)], 0),
        (
            vec![
                layer(&[1, 1, 1, 1], 1, 1, None),
                layer(&[1, 1, 5, 3], 1, 1, None),
            ],
            2,
        ),
        // 6 taps with stride 2 see 2 pixels on each side, and 3 taps at half the resolution 2.
        (
            vec![
                layer(&[1, 1, 1, 1], 1, 1, None),
                layer(&[12, 1, 6, 6], 2, 1, None),
                layer(&[4, 12, 3, 3], 1, 2, Some(0)),
            ],
            4,
        ),
    ] {
        assert_eq!(Network::new(layers, served)?.halo(), halo);
    }
    Ok(())
}

/// Return the maximum-likelihood intensity of a fraction of ones.
fn intensity(sensor: &SensorModel, fraction: f64) -> f64 {
    sensor.response.intensity(fraction, sensor.jot)
}

fn random_counts(trials: u32) -> Array2<i32> {
    let mut random = Random(trials);
    Array2::from_shape_simple_fn(SIZE, || random.below(trials + 1) as i32)
}

#[test]
fn identity_networks_return_the_most_likely_intensities() -> Result<()> {
    let network = identity_network()?;
    assert_eq!(network.halo(), 2);
    // The last sensor is bright, so that its network estimates P(b = 0).
    for (trials, light) in [(1, 1.0), (16, 0.5), (256, 1.0), (40, 9.0)] {
        let sensor = sensor(trials, light)?;
        let (counts, mut out) = (random_counts(trials), Array2::zeros(SIZE));
        network
            .prepare(sensor)?
            .counts(counts.view(), out.view_mut())?;
        for (&count, &found) in counts.iter().zip(&out) {
            let expected = intensity(&sensor, f64::from(count) / f64::from(trials));
            assert!(
                (f64::from(found) - expected).abs() < 2e-5,
                "{trials}: {found} {expected}"
            );
        }
    }
    Ok(())
}

#[test]
fn each_pixel_may_have_its_own_trials() -> Result<()> {
    let (network, mut random) = (identity_network()?, Random(3));
    for largest in [60, 250] {
        let trials = Array2::from_shape_fn(SIZE, |(row, _)| {
            if row < 15 {
                4.0
            } else {
                f64::from(10 + random.below(largest - 9))
            }
        });
        let counts = trials.mapv(|n| (n * random.fraction()) as i32);
        for light in [1.0, 9.0] {
            let (sensor, mut out) = (sensor(16, light)?, Array2::zeros(SIZE));
            let reconstruction = network.prepare(sensor)?;
            reconstruction.counts_of_trials(counts.view(), trials.view(), out.view_mut())?;
            for ((&count, &trials), &found) in counts.iter().zip(&trials).zip(&out) {
                let expected = intensity(&sensor, f64::from(count) / trials);
                assert!(
                    (f64::from(found) - expected).abs() < 2e-5,
                    "{found} {expected}"
                );
            }
        }
    }
    Ok(())
}

/// With a map of the same number everywhere, the result is that of the number.
#[test]
fn equal_trials_are_those_of_the_sensor() -> Result<()> {
    let network = random_network()?;
    for trials in [2, 90, 256, 5000] {
        let reconstruction = network.prepare(sensor(trials, 1.0)?)?;
        let counts = random_counts(trials);
        let (mut first, mut second) = (Array2::zeros(SIZE), Array2::zeros(SIZE));
        let map = Array2::from_elem(SIZE, f64::from(trials));
        reconstruction.counts(counts.view(), first.view_mut())?;
        reconstruction.counts_of_trials(counts.view(), map.view(), second.view_mut())?;
        let differences = first.iter().zip(&second).map(|(a, b)| (a - b).abs());
        assert!(differences.fold(0.0, f32::max) < 1e-5, "K = {trials}");
    }
    Ok(())
}

/// With many more trials than the network knows, the estimate approaches the data, because the
/// amplified differences become weak noise.
#[test]
fn many_trials_approach_the_data() -> Result<()> {
    let network = identity_network()?;
    for trials in [257, 3000, 70_000] {
        let sensor = sensor(trials, 1.0)?;
        let (counts, mut out) = (random_counts(trials), Array2::zeros(SIZE));
        network
            .prepare(sensor)?
            .counts(counts.view(), out.view_mut())?;
        for (&count, &found) in counts.iter().zip(&out) {
            let expected = intensity(&sensor, f64::from(count) / f64::from(trials));
            // The stabilization adds 3/8 of a one and of a zero.
            let bound = 3.0 / f64::from(trials).sqrt() / 16.0 + 1e-3;
            assert!(
                (f64::from(found) - expected).abs() < bound,
                "{trials}: {found} {expected}"
            );
        }
    }
    Ok(())
}

const SETS: usize = 5;

fn random_network() -> Result<Network> {
    let mut random = Random(11);
    let mut number = || random.number() as f32;
    let mut last = identity(1);
    last.filters = filled(&[SETS, 1, 3, 3, 3], || 0.1 + 0.02 * number());
    let mut first = identity(1);
    first.filters = filled(&[SETS, 3, 1, 1, 1], || 0.8 + 0.1 * number());
    first.coefficients = Some(filled(&[SETS, 3, 6], || 0.4 + 0.3 * number()));
    first.spacing = 0.4;
    Network::new(vec![first, last], Served::Trials { min: 1, max: 256 })
}

/// Return the cubic B-spline β3 by its definition as a sum of truncated powers.
fn cubic_b_spline(x: f64) -> f64 {
    let power = |x: f64| x.max(0.0).powi(3);
    [1.0, -4.0, 6.0, -4.0, 1.0]
        .iter()
        .enumerate()
        .map(|(index, factor)| factor * power(x + 2.0 - index as f64) / 6.0)
        .sum()
}

#[test]
fn parameters_are_interpolated_over_the_logarithm_of_the_trials() -> Result<()> {
    let mut random = Random(11);
    let mut number = || random.number() as f32;
    let last = filled(&[SETS, 1, 3, 3, 3], || 0.1 + 0.02 * number());
    let first = filled(&[SETS, 3, 1, 1, 1], || 0.8 + 0.1 * number());
    let coefficients = filled(&[SETS, 3, 6], || 0.4 + 0.3 * number());
    for trials in [1u32, 3, 16, 100, 256] {
        let place = f64::from(trials).log2() / 8.0 * (SETS - 3) as f64;
        let sum = |sets: &ArrayD<f32>| {
            let mut sum = ArrayD::<f64>::zeros(&sets.shape()[1..]);
            for (set, values) in sets.outer_iter().enumerate() {
                let weight = cubic_b_spline(place - (set as f64 - 1.0));
                sum += &(weight * values.mapv(f64::from));
            }
            sum.mapv(|value| value as f32)
        };
        let shape = |_| Error::Interrupted;
        let rows = sum(&coefficients).into_dimensionality().map_err(shape)?;
        let filters = sum(&last).into_dimensionality().map_err(shape)?;
        let taps = sum(&first).into_dimensionality().map_err(shape)?;
        let line = array![[-1.0, 0.0, 1.0, 2.0]];
        let layers = [
            Layer::new(taps, Some(rows.view()), 0.0, 0.4, Wiring::default())?,
            Layer::new(filters, Some(line.view()), 0.0, 1.0, Wiring::default())?,
        ];
        let sums = Array2::from_shape_fn((3, trials as usize + 1), |(channel, count)| {
            layers[0].filters()[[channel, 0, 0, 0]] * count as f32 / trials as f32
        });
        let (counts, mut p, mut found) = (
            random_counts(trials),
            Array2::zeros(SIZE),
            Array2::zeros(SIZE),
        );
        forward_counts(&layers.each_ref(), counts.view(), sums.view(), p.view_mut())?;
        let sensor = sensor(trials, 1.0)?;
        random_network()?
            .prepare(sensor)?
            .counts(counts.view(), found.view_mut())?;
        for (&p, &found) in p.iter().zip(&found) {
            let expected = intensity(&sensor, f64::from(p));
            assert!((f64::from(found) - expected).abs() < 2e-5, "K = {trials}");
        }
    }
    Ok(())
}

#[test]
fn bits_and_their_counts_lead_to_the_same_image() -> Result<()> {
    let network = random_network()?;
    for (frames, side) in [(2, 3), (1, 4), (300, 1)] {
        let packed = random_bits(frames, SIZE.0 * side, SIZE.1 * side);
        let bits = PackedBits::new(packed.view(), SIZE.1 * side)?;
        let mut counts = Array2::zeros(SIZE);
        add_block_counts(&bits, side, None, counts.view_mut())?;
        let reconstruction = network.prepare(sensor((frames * side * side) as u32, 1.0)?)?;
        let (mut first, mut second) = (Array2::zeros(SIZE), Array2::ones(SIZE));
        reconstruction.counts(counts.view(), first.view_mut())?;
        reconstruction.bits(&bits, side, second.view_mut())?;
        assert_eq!(first, second);
    }
    Ok(())
}
