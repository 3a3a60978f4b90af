//! Data that networks refuse, and the network files of the Python package.

use jotlight::error::{Error, Result};
#[cfg(feature = "safetensors")]
use jotlight::mle::JotResponse;
use jotlight::network::{Network, Served};
use ndarray::{Array2, Array3, ArrayD, IxDyn, array};

use crate::model::{identity, sensor};
#[cfg(feature = "safetensors")]
use crate::random::Random;

#[test]
fn data_that_a_network_does_not_serve_are_refused() -> Result<()> {
    let own = sensor(16, 1.0)?;
    let single = Network::new(vec![identity(1)], Served::Sensor(own))?;
    let many = Network::new(vec![identity(1)], Served::Trials { min: 4, max: 8 })?;
    assert!(single.prepare(own).is_ok());
    assert!(single.prepare(sensor(17, 1.0)?).is_err());
    assert!(single.prepare(sensor(16, 1.1)?).is_err());
    assert!(many.prepare(sensor(3, 1.0)?).is_err());
    let (mut out, reconstruction) = (Array2::zeros((2, 2)), many.prepare(sensor(8, 1.0)?)?);
    for counts in [array![[0, 9], [0, 0]], array![[-1, 0], [0, 0]]] {
        assert!(
            reconstruction
                .counts(counts.view(), out.view_mut())
                .is_err()
        );
        let trials = Array2::from_elem((2, 2), 8.0);
        let result = reconstruction.counts_of_trials(counts.view(), trials.view(), out.view_mut());
        assert!(result.is_err());
    }
    let counts = Array2::zeros((2, 2));
    for trials in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let trials = Array2::from_elem((2, 2), trials);
        let result = reconstruction.counts_of_trials(counts.view(), trials.view(), out.view_mut());
        assert!(matches!(result, Err(Error::Range { what: "trials", .. })));
    }
    let mut small = Array2::zeros((2, 1));
    assert!(
        reconstruction
            .counts(counts.view(), small.view_mut())
            .is_err()
    );
    for range in [(0, 4), (4, 4), (5, 4)] {
        let served = Served::Trials {
            min: range.0,
            max: range.1,
        };
        assert!(Network::new(vec![identity(1)], served).is_err());
    }
    let none = Network::new(Vec::new(), Served::Trials { min: 1, max: 2 });
    let message = none.map_or_else(|error| error.to_string(), |_| String::new());
    assert_eq!(message, "layers: expected at least 1, got 0");
    let mut sets = identity(1);
    sets.filters = ArrayD::ones(IxDyn(&[4, 1, 1, 1, 1]));
    assert!(Network::new(vec![sets], Served::Sensor(own)).is_err());
    assert!(Network::new(vec![identity(3)], Served::Trials { min: 1, max: 2 }).is_err());
    Ok(())
}

/// The networks of the Python package reconstruct a flat image from simulated counts.
#[cfg(feature = "safetensors")]
#[test]
fn network_files_reconstruct_a_flat_image() -> Result<()> {
    let folder = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../python/jotlight/networks/weights"
    );
    // A published crate does not contain the networks.
    let Ok(files) = std::fs::read_dir(folder) else {
        return Ok(());
    };
    let paths = files.filter_map(|file| file.ok().map(|file| file.path()));
    let networks = paths.filter(|path| path.extension().is_some_and(|end| end == "safetensors"));
    for path in networks {
        let network = Network::load(&path)?;
        if let Served::Planes { .. } = network.served() {
            let one = Array3::zeros((1, 8, 8));
            assert!(network.improve(one.view(), 16.0).is_err(), "one plane");
            continue;
        }
        let mut sensor = sensor(16, 1.0)?;
        sensor.jot = JotResponse {
            efficiency: 1.0,
            dark_counts: 0.0,
        };
        if let Served::Sensor(own) = network.served() {
            sensor = own;
        }
        let mut random = Random(5);
        let p = 1.0 - (-0.5 * sensor.response.light_per_intensity).exp();
        let counts = Array2::from_shape_simple_fn((64, 64), || {
            (0..sensor.trials)
                .map(|_| i32::from(random.fraction() < p))
                .sum()
        });
        let mut out = Array2::zeros((64, 64));
        network
            .prepare(sensor)?
            .counts(counts.view(), out.view_mut())?;
        let inner = out.slice(ndarray::s![16..48, 16..48]);
        let errors = inner.mapv(|c| (f64::from(c) - 0.5).powi(2));
        let root_mean_square = errors.mean().unwrap_or(f64::NAN).sqrt();
        let raw = ((p / (1.0 - p)) / f64::from(sensor.trials)).sqrt();
        // Every network removes most of the noise of single pixels.
        assert!(
            root_mean_square < 0.5 * raw,
            "{}: {root_mean_square}",
            path.display()
        );
    }
    Ok(())
}
