//! Comparisons of the gradients of the network with central differences.

use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::network::{Batch, Layer, Patch, Wiring};
use jotlight::sensing::{Kernel, PerJot, Sensor};
use ndarray::{Array1, Array2, Array4};

use crate::random::Random;

const START: f64 = -5.0;
const COEFFICIENTS: usize = 9;
const SPACING: f64 = 10.0 / (COEFFICIENTS - 3) as f64;

/// The shapes of a network's filters, and its parameters in the order of the gradient.
struct Parameters {
    shapes: Vec<(usize, usize, usize, usize)>,
    values: Array1<f64>,
}

impl Parameters {
    fn random(shapes: Vec<(usize, usize, usize, usize)>, random: &mut Random) -> Self {
        let mut values = Vec::new();
        for &(outputs, inputs, rows, columns) in &shapes {
            let taps = inputs * rows * columns;
            let scale = 2.0 / (taps as f64).sqrt();
            values.extend((0..outputs * taps).map(|_| scale * (random.fraction() - 0.5)));
            values.extend((0..outputs * COEFFICIENTS).map(|_| 3.0 * (random.fraction() - 0.5)));
        }
        let values = values.into();
        Self { shapes, values }
    }

    fn layers(&self) -> Result<Vec<Layer<f64>>> {
        let mut values = self.values.iter().copied();
        let layer = |&shape: &(usize, usize, usize, usize)| {
            let mut next = || values.next().unwrap_or(f64::NAN);
            let filters = Array4::from_shape_simple_fn(shape, &mut next);
            let coefficients = Array2::from_shape_simple_fn((shape.0, COEFFICIENTS), next);
            let wiring = Wiring::default();
            Layer::new(filters, Some(coefficients.view()), START, SPACING, wiring)
        };
        self.shapes.iter().map(layer).collect()
    }
}

fn batch<'a>(images: &'a [Array2<f32>], sensor: Sensor<'a>) -> Batch<'a> {
    let patch = |image, rows, columns| Patch {
        image,
        rows,
        columns,
    };
    Batch {
        sensor,
        frames: 2,
        images: images.iter().map(|image| image.view()).collect(),
        patches: vec![
            patch(0, 2..9, 0..8),
            patch(1, 0..6, 0..5),
            patch(0, 4..12, 3..13),
        ],
        border: 1,
        seed: [9; 32],
    }
}

fn sensor<'a>() -> Result<Sensor<'a>> {
    Ok(Sensor {
        kernel: Kernel::new(0, 2)?,
        gain_per_frame: 6.0,
        efficiency: PerJot::Same(1.0),
        dark_counts: PerJot::Same(0.0),
        dead: None,
        threshold: Threshold::new(1)?,
    })
}

#[test]
fn gradients_agree_with_central_differences() -> Result<()> {
    let mut random = Random(6);
    let images = [(12, 13), (6, 5)]
        .map(|shape| Array2::from_shape_simple_fn(shape, || random.fraction() as f32));
    let batch = batch(&images, sensor()?);
    for shapes in [
        vec![(1, 1, 1, 1)],
        vec![(2, 1, 1, 1), (1, 2, 3, 3)],
        vec![(3, 2, 2, 2), (2, 3, 2, 4), (1, 2, 3, 1)],
    ] {
        let mut parameters = Parameters::random(shapes, &mut random);
        let result = batch.gradient(&parameters.layers()?)?;
        let normal_equations = batch.normal_equations(&parameters.layers()?)?;
        assert_eq!(normal_equations.gradient.gradient, result.gradient);
        let cost = |parameters: &Parameters| -> Result<f64> {
            let (errors, pixels) = batch.squared_errors(&parameters.layers()?)?;
            assert_eq!(pixels, result.pixels);
            Ok(0.5 * errors.iter().sum::<f64>() / errors.len() as f64)
        };
        let step = 1e-5;
        for (index, found) in result.gradient.iter().enumerate() {
            let value = parameters.values[index];
            parameters.values[index] = value + step;
            let above = cost(&parameters)?;
            parameters.values[index] = value - step;
            let below = cost(&parameters)?;
            parameters.values[index] = value;
            let expected = (above - below) / (2.0 * step);
            assert!((found - expected).abs() < 1e-5 * (1.0 + expected.abs()));
        }
    }
    Ok(())
}
