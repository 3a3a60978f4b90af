//! Total variation.

use jotlight::admm::AdmmStep;
use jotlight::tv::{self, Norm};
use ndarray::{Ix3, Ix4};

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;
use crate::likelihood::{OneOrEach, one_or_each};

pub const CHECKS: &[(&str, Check)] = &[
    ("tv_differences", check_differences),
    ("tv_adjoint", check_adjoint),
    ("tv_shrink", check_shrink),
    ("tv_total_variation", check_total_variation),
    ("tv_admm_update", check_admm_update),
];

struct Field {
    number: usize,
    images: Grid<f64>,
    differences: Grid<f64>,
    dual: Grid<f64>,
    weight: OneOrEach<f64>,
    norm: Norm,
}

impl Field {
    fn new(input: &mut Input<'_>) -> Self {
        let (number, height, width) = (1 + input.below(3), input.size(), input.size());
        let stack = (
            input.almost(number),
            input.almost(2),
            input.almost(height),
            width,
        );
        Self {
            number,
            images: Grid::floats(input, (number, height, width)),
            differences: Grid::floats(input, stack),
            dual: Grid::floats(input, stack),
            weight: one_or_each(input, number * height * width),
            norm: if input.rarely(2) {
                Norm::Isotropic
            } else {
                Norm::Anisotropic
            },
        }
    }
}

fn check_differences(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    consistent(|is_standard| {
        let (images, mut out) = (
            field.images.arranged(is_standard),
            field.differences.arranged(is_standard),
        );
        tv::differences(images.view::<Ix3>(), out.view_mut::<Ix4>())?;
        Ok(out.values())
    })
    .map(|_| ())
}

fn check_adjoint(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    consistent(|is_standard| {
        let (mut out, differences) = (
            field.images.arranged(is_standard),
            field.differences.arranged(is_standard),
        );
        tv::adjoint(differences.view::<Ix4>(), out.view_mut::<Ix3>())?;
        Ok(out.values())
    })
    .map(|_| ())
}

fn check_shrink(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    let before = field.differences.values();
    let shrunk = consistent(|is_standard| {
        let mut differences = field.differences.arranged(is_standard);
        tv::shrink(
            differences.view_mut::<Ix4>(),
            field.weight.get(),
            field.norm,
        )?;
        Ok(differences.values())
    })?;
    for (after, before) in shrunk.iter().zip(before) {
        assert!(after.abs() <= before.abs() || before.is_nan() || after.is_nan());
    }
    Some(())
}

fn check_total_variation(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    let values = consistent(|is_standard| {
        let differences = field.differences.arranged(is_standard);
        let differences = differences.view::<Ix4>();
        tv::total_variation(differences, field.weight.get(), field.norm)
    })?;
    assert!(values.iter().all(|&value| value >= 0.0 || value.is_nan()));
    Some(())
}

fn check_admm_update(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    let step = AdmmStep {
        penalty: input.float(),
        relaxation: input.float(),
    };
    let steps = vec![step; input.almost(field.number)];
    consistent(|is_standard| {
        let images = field.images.arranged(is_standard);
        let (mut x, mut dual) = (
            field.differences.arranged(is_standard),
            field.dual.arranged(is_standard),
        );
        let residuals = tv::admm_update(
            &steps,
            field.weight.get(),
            field.norm,
            images.view::<Ix3>(),
            x.view_mut::<Ix4>(),
            dual.view_mut::<Ix4>(),
        )?;
        Ok((residuals, (x.values(), dual.values())))
    })
    .map(|_| ())
}
