//! The sensor model: bits, rates, probabilities, and the operator G.

use jotlight::bits::packed_width;
use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::sensing::{
    Image, Kernel, PerJot, Sensor, SpreadOperator, Window, expose, probability, rate,
};
use ndarray::Ix3;

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;

pub const CHECKS: &[(&str, Check)] = &[
    ("expose", check_expose),
    ("rate", check_rate),
    ("probability", check_probability),
    ("SpreadOperator_forward", check_spread_forward),
    ("SpreadOperator_adjoint", check_spread_adjoint),
    ("SpreadOperator_normal", check_spread_normal),
];

/// A scene: an image, and the parameters and maps of a sensor.
pub struct Scene {
    pub image: Grid<f64>,
    is_single: bool,
    pub shape: (usize, usize),
    kernel: (usize, usize),
    gain: f64,
    numbers: (f64, f64),
    maps: [Option<Grid<f32>>; 2],
    dead: Option<Grid<bool>>,
    threshold: u32,
}

impl Scene {
    pub fn new(input: &mut Input<'_>) -> Self {
        let shape = (input.size(), input.size());
        let degree = input.below(4);
        let side = input.size().min(6);
        let kernel = if input.rarely(32) {
            (input.number(), input.number())
        } else {
            (degree, side)
        };
        let jots = (shape.0 * side, shape.1 * side);
        let mut map = || {
            input.rarely(4).then(|| {
                let shape = (input.almost(jots.0), jots.1);
                Grid::floats(input, shape).to_f32()
            })
        };
        let maps = [map(), map()];
        let dead = input.rarely(4).then(|| {
            let shape = (input.almost(jots.0), jots.1);
            let values = input.random_bytes(shape.0 * shape.1);
            Grid::new(input, shape, values.iter().map(|x| x % 3 == 0).collect())
        });
        Self {
            image: Grid::floats(input, shape),
            is_single: input.rarely(2),
            shape,
            kernel,
            gain: input.float(),
            numbers: (input.float(), input.float()),
            maps,
            dead,
            threshold: input.threshold_and_length(0).0,
        }
    }

    pub fn side(&self) -> usize {
        self.kernel.1.min(16)
    }

    /// Call `compute` with the sensor and the image.
    pub fn with_sensor<R>(
        &self,
        is_standard: bool,
        compute: impl FnOnce(&Sensor<'_>, Image<'_>) -> Result<R>,
    ) -> Result<R> {
        let maps = self.maps.each_ref();
        let maps = maps.map(|map| map.as_ref().map(|map| map.arranged(is_standard)));
        let dead = self.dead.as_ref().map(|dead| dead.arranged(is_standard));
        let sensor = Sensor {
            kernel: Kernel::new(self.kernel.0, self.kernel.1)?,
            gain_per_frame: self.gain,
            efficiency: per_jot(&maps[0], self.numbers.0),
            dark_counts: per_jot(&maps[1], self.numbers.1),
            dead: dead.as_ref().map(Grid::view),
            threshold: Threshold::new(self.threshold)?,
        };
        let image = self.image.arranged(is_standard);
        let single = image.to_f32();
        if self.is_single {
            compute(&sensor, Image::F32(single.view()))
        } else {
            compute(&sensor, Image::F64(image.view()))
        }
    }
}

fn per_jot(map: &Option<Grid<f32>>, number: f64) -> PerJot<'_> {
    map.as_ref()
        .map_or(PerJot::Same(number), |map| PerJot::Map(map.view()))
}

fn check_expose(input: &mut Input<'_>) -> Option<()> {
    let scene = Scene::new(input);
    let side = scene.side();
    let mut range = |size: usize| match input.below(16) {
        0 => input.number()..input.number(),
        1 => size / 2..size / 2,
        start => start.min(size)..size,
    };
    let (rows, columns) = (range(scene.shape.0), range(scene.shape.1));
    let first = if input.rarely(16) {
        input.number()
    } else {
        input.size()
    };
    let frames = first..first.saturating_add(input.size().min(3));
    let small = |range: &std::ops::Range<usize>| range.len().min(20);
    let shape = (
        small(&frames),
        small(&rows) * side,
        packed_width(small(&columns) * side),
    );
    let shape = (shape.0, input.almost(shape.1), shape.2);
    let out = Grid::new(input, shape, vec![0xffu8; shape.0 * shape.1 * shape.2]);
    let (channel, seed) = (input.number(), input.seed());
    let padding = shape.2 * 8 - (small(&columns) * side).min(shape.2 * 8);
    let window = Window {
        frames,
        rows,
        columns,
    };
    let bytes = consistent(|is_standard| {
        let mut out = out.arranged(is_standard);
        scene.with_sensor(is_standard, |sensor, image| {
            expose(sensor, image, seed, channel, &window, out.view_mut::<Ix3>())
        })?;
        Ok(out.values())
    })?;
    for row in bytes.chunks_exact(shape.2.max(1)) {
        let last = row[shape.2 - 1];
        assert_eq!(u16::from(last) & ((1 << padding) - 1), 0, "padding bits");
    }
    Some(())
}

fn rows_of_jots(
    input: &mut Input<'_>,
    function: impl Fn(&Sensor<'_>, Image<'_>, usize, ndarray::ArrayViewMut2<'_, f32>) -> Result<()>
    + Sync,
) -> Option<Vec<f32>> {
    let scene = Scene::new(input);
    let (height, width) = (scene.shape.0 * scene.side(), scene.shape.1 * scene.side());
    let first = if input.rarely(8) {
        input.number()
    } else {
        input.below(height + 1)
    };
    let shape = (height.saturating_sub(first), input.almost(width));
    let out = Grid::new(input, shape, vec![0.0f32; shape.0 * shape.1]);
    consistent(|is_standard| {
        let mut out = out.arranged(is_standard);
        scene.with_sensor(is_standard, |sensor, image| {
            function(sensor, image, first, out.view_mut())
        })?;
        Ok(out.values())
    })
}

fn check_rate(input: &mut Input<'_>) -> Option<()> {
    rows_of_jots(input, |sensor, image, first, out| {
        rate(sensor, image, first, out)
    })
    .map(|_| ())
}

fn check_probability(input: &mut Input<'_>) -> Option<()> {
    let values = rows_of_jots(input, |sensor, image, first, out| {
        probability(sensor, image, first, out)
    });
    values.map(|_| ())
}

/// The operator G with arrays over the pixels and over the jots.
struct Spread {
    kernels: [(usize, usize); 2],
    gain: f64,
    pixels: Grid<f64>,
    jots: [Grid<f64>; 2],
}

impl Spread {
    fn new(input: &mut Input<'_>) -> Self {
        let shape = (1 + input.below(3), input.size(), input.size());
        let mut kernel = || match input.below(32) {
            0 => (input.number(), input.number()),
            degree => (degree % 4, input.size().min(6)),
        };
        let kernels = [kernel(), kernel()];
        let jots = (
            shape.1 * kernels[0].1.min(16),
            shape.2 * kernels[1].1.min(16),
        );
        let jots = (input.almost(shape.0), input.almost(jots.0), jots.1);
        Self {
            kernels,
            gain: input.float(),
            pixels: Grid::floats(input, shape),
            jots: [Grid::floats(input, jots), Grid::floats(input, jots)],
        }
    }

    fn operator(&self) -> Result<SpreadOperator> {
        let [vertical, horizontal] = self.kernels.map(|(degree, side)| Kernel::new(degree, side));
        Ok(SpreadOperator::new(vertical?, horizontal?))
    }
}

fn check_spread_forward(input: &mut Input<'_>) -> Option<()> {
    let spread = Spread::new(input);
    consistent(|is_standard| {
        let (image, mut out) = (
            spread.pixels.arranged(is_standard),
            spread.jots[0].arranged(is_standard),
        );
        spread
            .operator()?
            .forward(spread.gain, image.view::<Ix3>(), out.view_mut::<Ix3>())?;
        Ok(out.values())
    })
    .map(|_| ())
}

fn check_spread_adjoint(input: &mut Input<'_>) -> Option<()> {
    let spread = Spread::new(input);
    consistent(|is_standard| {
        let (mut out, jots) = (
            spread.pixels.arranged(is_standard),
            spread.jots[0].arranged(is_standard),
        );
        spread
            .operator()?
            .adjoint(spread.gain, jots.view(), out.view_mut())?;
        Ok(out.values())
    })
    .map(|_| ())
}

fn check_spread_normal(input: &mut Input<'_>) -> Option<()> {
    let spread = Spread::new(input);
    consistent(|is_standard| {
        let image = spread.pixels.arranged(is_standard);
        let (weights, mut out) = (spread.jots[1].arranged(is_standard), image.clone());
        let operator = spread.operator()?;
        operator.normal(spread.gain, weights.view(), image.view(), out.view_mut())?;
        Ok(out.values())
    })
    .map(|_| ())
}
