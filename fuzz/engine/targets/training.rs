//! The cost of networks, its gradient, and the normal equations.

use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::network::{Batch, Layer, Patch, Wiring};
use jotlight::sensing::{Kernel, PerJot, Sensor};
use ndarray::{Array2, Ix2};

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;
use crate::layers::LayerArguments;

pub const CHECKS: &[(&str, Check)] = &[
    ("Batch_squared_errors", check_squared_errors),
    ("Batch_gradient", check_gradient),
    ("Batch_normal_equations", check_normal_equations),
];

struct Course {
    layers: Vec<LayerArguments>,
    images: Vec<Grid<f32>>,
    patches: Vec<Patch>,
    kernel: (usize, usize),
    frames: usize,
    threshold: u32,
    numbers: [f64; 3],
    map: Option<Array2<f32>>,
    border: usize,
    seed: [u8; 32],
}

impl Course {
    fn new(input: &mut Input<'_>) -> Self {
        let (side, frames) = (1 + input.below(3), input.size().min(4));
        let tied = input.rarely(2);
        let taps = if tied { (1, 1) } else { (frames, side) };
        let channels = 1 + input.below(3);
        let plain = Wiring::default();
        let first = (channels, taps.0, taps.1, taps.1);
        let mut layers = vec![LayerArguments::new(input, first, plain, true)];
        let mut last = channels;
        for outputs in [1 + input.below(3), 1] {
            let shape = (outputs, last, 1 + input.below(4), 1 + input.below(4));
            layers.push(LayerArguments::new(input, shape, plain, true));
            last = outputs;
        }
        let images = (0..1 + input.below(2)).map(|_| {
            let shape = (input.size(), input.size());
            Grid::floats(input, shape).to_f32()
        });
        let images: Vec<_> = images.collect();
        let patches = (0..input.size().min(4)).map(|_| random_patch(input, &images));
        let patches = patches.collect();
        Self {
            layers,
            images,
            patches,
            kernel: (input.below(4), side),
            frames,
            threshold: 1 + input.below(3) as u32,
            numbers: [input.float(), input.float(), input.float()],
            map: input.rarely(32).then(|| Array2::zeros((2, 2))),
            border: if input.rarely(16) {
                input.number()
            } else {
                input.below(3)
            },
            seed: input.seed(),
        }
    }

    fn with_batch<R>(
        &self,
        is_standard: bool,
        compute: impl FnOnce(&Batch<'_>) -> Result<R>,
    ) -> Result<R> {
        let images: Vec<_> = self
            .images
            .iter()
            .map(|image| image.arranged(is_standard))
            .collect();
        let [gain_per_frame, efficiency, dark_counts] = self.numbers;
        let map = self.map.as_ref();
        compute(&Batch {
            sensor: Sensor {
                kernel: Kernel::new(self.kernel.0, self.kernel.1)?,
                gain_per_frame,
                efficiency: map.map_or(PerJot::Same(efficiency), |map| PerJot::Map(map.view())),
                dark_counts: PerJot::Same(dark_counts),
                dead: None,
                threshold: Threshold::new(self.threshold)?,
            },
            frames: self.frames,
            images: images.iter().map(Grid::view::<Ix2>).collect(),
            patches: self.patches.clone(),
            border: self.border,
            seed: self.seed,
        })
    }

    fn layers(&self) -> Result<Vec<Layer<f32>>> {
        self.layers.iter().map(|layer| layer.build(true)).collect()
    }

    fn layers_f64(&self) -> Result<Vec<Layer<f64>>> {
        self.layers
            .iter()
            .map(|layer| layer.build_f64(true))
            .collect()
    }
}

fn random_patch(input: &mut Input<'_>, images: &[Grid<f32>]) -> Patch {
    let image = if input.rarely(32) {
        input.number()
    } else {
        input.below(images.len())
    };
    let size = images
        .get(image)
        .map_or((3, 3), |image| image.view::<Ix2>().dim());
    let mut range = |size: usize| match input.below(16) {
        0 => input.number()..input.number(),
        start => start.min(size.saturating_sub(1))..size,
    };
    Patch {
        image,
        rows: range(size.0),
        columns: range(size.1),
    }
}

fn check_squared_errors(input: &mut Input<'_>) -> Option<()> {
    let course = Course::new(input);
    consistent(|is_standard| {
        let layers = course.layers()?;
        let (errors, pixels) =
            course.with_batch(is_standard, |batch| batch.squared_errors(&layers))?;
        assert_eq!(errors.len(), pixels.len());
        Ok(errors)
    })
    .map(|_| ())
}

fn check_gradient(input: &mut Input<'_>) -> Option<()> {
    let course = Course::new(input);
    consistent(|is_standard| {
        let layers = course.layers()?;
        let result = course.with_batch(is_standard, |batch| batch.gradient(&layers))?;
        let parameters: usize = layers.iter().map(Layer::parameters).sum();
        assert_eq!(result.gradient.len(), parameters);
        Ok((result.squared_errors, result.gradient))
    })
    .map(|_| ())
}

fn check_normal_equations(input: &mut Input<'_>) -> Option<()> {
    let course = Course::new(input);
    consistent(|is_standard| {
        let layers = course.layers_f64()?;
        let result = course.with_batch(is_standard, |batch| batch.normal_equations(&layers))?;
        let parameters: usize = layers.iter().map(Layer::parameters).sum();
        assert_eq!(result.matrix.dim(), (parameters, parameters));
        let matrix: Vec<f64> = result.matrix.iter().copied().collect();
        Ok((result.gradient.gradient, matrix))
    })
    .map(|_| ())
}
