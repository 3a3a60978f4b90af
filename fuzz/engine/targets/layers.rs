//! Layers of networks, and splines without filters.

use jotlight::error::Result;
use jotlight::network::{Layer, Spline, Splines, Wiring};
use jotlight::numbers::Real;
use ndarray::{Array4, Ix2, Ix3, Ix4};

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;

pub const CHECKS: &[(&str, Check)] = &[
    ("Layer", check_layer),
    ("Spline", check_spline),
    ("Splines_activate", check_activate),
    ("Splines_pull_back", check_pull_back),
];

/// The arguments of a layer. Calls turn them into layers, because each level of instructions has its
/// own order of the filters.
#[derive(Clone)]
pub struct LayerArguments {
    filters: Grid<f64>,
    coefficients: Option<Grid<f64>>,
    knots: (f64, f64),
    wiring: Wiring,
}

impl LayerArguments {
    /// Return a layer with filters of the shape `(outputs, inputs, rows, columns)`.
    pub fn new(
        input: &mut Input<'_>,
        (outputs, inputs, rows, columns): (usize, usize, usize, usize),
        wiring: Wiring,
        has_splines: bool,
    ) -> Self {
        let shape = (outputs, input.almost(inputs), rows, columns);
        let channels = outputs.checked_div(wiring.upsampling * wiring.upsampling);
        let coefficients = has_splines.then(|| {
            let number = if input.rarely(8) {
                input.size() * 20
            } else {
                4 + input.size()
            };
            let shape = (input.almost(channels.unwrap_or(1)), number);
            Grid::floats(input, shape)
        });
        let knots = match input.below(4) {
            0 => (input.float(), input.float()),
            spacing => (-2.0, spacing as f64 / 2.0),
        };
        let mut wiring = wiring;
        for number in [&mut wiring.stride, &mut wiring.upsampling] {
            if input.rarely(64) {
                *number = input.number();
            }
        }
        for index in [&mut wiring.input, &mut wiring.skip] {
            if input.rarely(64) {
                *index = Some(input.number());
            }
        }
        Self {
            filters: Grid::floats(input, shape),
            coefficients,
            knots,
            wiring,
        }
    }

    pub fn build(&self, is_standard: bool) -> Result<Layer<f32>> {
        let filters: Array4<f32> = self
            .filters
            .arranged(is_standard)
            .to_f32()
            .view::<Ix4>()
            .to_owned();
        let coefficients = self.coefficients.as_ref();
        let coefficients = coefficients.map(|grid| grid.arranged(is_standard).to_f32());
        let (start, spacing) = (self.knots.0 as f32, self.knots.1 as f32);
        Layer::new(
            filters,
            coefficients.as_ref().map(Grid::view),
            start,
            spacing,
            self.wiring,
        )
    }

    pub fn build_f64(&self, is_standard: bool) -> Result<Layer<f64>> {
        let filters: Array4<f64> = self.filters.arranged(is_standard).view::<Ix4>().to_owned();
        let coefficients = self
            .coefficients
            .as_ref()
            .map(|grid| grid.arranged(is_standard));
        let (start, spacing) = self.knots;
        Layer::new(
            filters,
            coefficients.as_ref().map(Grid::view),
            start,
            spacing,
            self.wiring,
        )
    }

    /// Return the smallest and the largest coefficient of the splines.
    pub fn bounds(&self) -> Option<(f32, f32)> {
        let coefficients = self.coefficients.as_ref()?.to_f32().values();
        let low = coefficients.iter().copied().fold(f32::INFINITY, f32::min);
        Some((
            low,
            coefficients
                .iter()
                .copied()
                .fold(f32::NEG_INFINITY, f32::max),
        ))
    }
}

fn check_layer(input: &mut Input<'_>) -> Option<()> {
    let shape = (input.size(), input.size(), input.size(), input.size());
    let (stride, upsampling) = (1 + input.below(3), 1 + input.below(3));
    let wiring = Wiring {
        stride,
        upsampling,
        ..Wiring::default()
    };
    let has_splines = input.rarely(2);
    let arguments = LayerArguments::new(input, shape, wiring, has_splines);
    let layer = arguments.build(false);
    assert_eq!(layer.is_ok(), arguments.build(true).is_ok());
    let layer = layer.ok()?;
    assert!(layer.channels() * upsampling.pow(2) == shape.0 || layer.channels() > 0);
    assert_eq!(
        layer.splines().len(),
        if has_splines { layer.channels() } else { 0 }
    );
    let coefficients: usize = layer.splines().iter().map(Spline::len).sum();
    assert_eq!(layer.parameters(), layer.filters().len() + coefficients);
    Some(())
}

struct Planes {
    coefficients: Grid<f64>,
    knots: (f64, f64),
    planes: Grid<f64>,
    gradient: Grid<f64>,
}

impl Planes {
    fn new(input: &mut Input<'_>) -> Self {
        let (number, channels, pixels) = (input.size(), input.size(), input.size());
        let coefficients = if input.rarely(8) {
            input.size() * 20
        } else {
            4 + input.size()
        };
        let shape = (number, input.almost(channels), pixels);
        let gradient_shape = (input.almost(number), shape.1, pixels);
        Self {
            coefficients: Grid::floats(input, (channels, coefficients)),
            knots: (input.float(), input.float()),
            planes: Grid::floats(input, shape),
            gradient: Grid::floats(input, gradient_shape),
        }
    }

    fn splines<F: Real>(&self, coefficients: &Grid<F>) -> Result<Splines<F>>
    where
        F: Default,
    {
        let (start, spacing) = (F::from_f64(self.knots.0), F::from_f64(self.knots.1));
        Splines::new(coefficients.view::<Ix2>(), start, spacing)
    }
}

fn check_activate(input: &mut Input<'_>) -> Option<()> {
    let planes = Planes::new(input);
    let single = consistent(|is_standard| {
        let coefficients = planes.coefficients.arranged(is_standard).to_f32();
        let values = planes.planes.arranged(is_standard).to_f32();
        let out = planes
            .splines(&coefficients)?
            .activate(values.view::<Ix3>())?;
        Ok(out.iter().copied().collect::<Vec<f32>>())
    })?;
    let coefficients = planes.coefficients.to_f32().values();
    assert!(single.iter().all(|x| {
        coefficients.iter().any(|low| low <= x) && coefficients.iter().any(|high| high >= x)
    }));
    consistent(|is_standard| {
        let coefficients = planes.coefficients.arranged(is_standard);
        let values = planes.planes.arranged(is_standard);
        let out = planes
            .splines(&coefficients)?
            .activate(values.view::<Ix3>())?;
        Ok(out.iter().copied().collect::<Vec<f64>>())
    })
    .map(|_| ())
}

fn check_pull_back(input: &mut Input<'_>) -> Option<()> {
    let planes = Planes::new(input);
    consistent(|is_standard| {
        let coefficients = planes.coefficients.arranged(is_standard).to_f32();
        let values = planes.planes.arranged(is_standard).to_f32();
        let gradient = planes.gradient.arranged(is_standard).to_f32();
        let splines = planes.splines(&coefficients)?;
        let (out, sums) = splines.pull_back(values.view::<Ix3>(), gradient.view::<Ix3>())?;
        Ok((
            out.iter().copied().collect::<Vec<f32>>(),
            sums.iter().copied().collect::<Vec<f64>>(),
        ))
    })
    .map(|_| ())
}

fn check_spline(input: &mut Input<'_>) -> Option<()> {
    let number = 4 + if input.rarely(4) {
        input.size() * 20
    } else {
        input.size()
    };
    let arguments = LayerArguments {
        filters: Grid::new(input, (1, 1, 1, 1), vec![1.0]),
        coefficients: Some(Grid::floats(input, (1, number))),
        knots: (input.float(), input.float()),
        wiring: Wiring::default(),
    };
    let layer = arguments.build(false).ok()?;
    let [spline] = layer.splines() else {
        panic!("one spline");
    };
    assert!(spline.len() == number && !spline.is_empty());
    let length = 3 * input.size();
    let mut plane: Vec<f32> = input.floats(length).into_iter().map(|x| x as f32).collect();
    let expected: Vec<f32> = plane.iter().map(|&z| spline.value(z)).collect();
    for &z in &plane {
        let (first, weights) = spline.weights(z);
        assert!(first + weights.len() <= number);
        let _ = spline.slope(z);
    }
    spline.apply(&mut plane);
    let (low, high) = arguments.bounds()?;
    assert!(plane.iter().all(|x| (low..=high).contains(x)));
    // The vectorized code rounds differently if the processor multiplies and adds at once.
    assert!(expected.iter().all(|x| (low..=high).contains(x)));
    Some(())
}
