//! Total variation.

use jotlight::admm::AdmmStep;
use jotlight::tv::{self, Norm};
use ndarray::{Ix2, Ix3};

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
    image: Grid<f64>,
    differences: Grid<f64>,
    dual: Grid<f64>,
    weight: OneOrEach<f64>,
    norm: Norm,
}

impl Field {
    fn new(input: &mut Input<'_>) -> Self {
        let shape = (input.size(), input.size());
        let stack = (input.almost(2), input.almost(shape.0), shape.1);
        Self {
            image: Grid::floats(input, shape),
            differences: Grid::floats(input, stack),
            dual: Grid::floats(input, stack),
            weight: one_or_each(input, shape.0 * shape.1),
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
        let (image, mut out) = (
            field.image.arranged(is_standard),
            field.differences.arranged(is_standard),
        );
        tv::differences(image.view::<Ix2>(), out.view_mut::<Ix3>())?;
        Ok(out.values())
    })
    .map(|_| ())
}

fn check_adjoint(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    consistent(|is_standard| {
        let (mut out, differences) = (
            field.image.arranged(is_standard),
            field.differences.arranged(is_standard),
        );
        tv::adjoint(differences.view::<Ix3>(), out.view_mut::<Ix2>())?;
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
            differences.view_mut::<Ix3>(),
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
    let value = consistent(|is_standard| {
        let differences = field.differences.arranged(is_standard);
        let differences = differences.view::<Ix3>();
        Ok(vec![tv::total_variation(
            differences,
            field.weight.get(),
            field.norm,
        )?])
    })?;
    assert!(value[0] >= 0.0 || value[0].is_nan());
    Some(())
}

fn check_admm_update(input: &mut Input<'_>) -> Option<()> {
    let field = Field::new(input);
    let step = AdmmStep {
        penalty: input.float(),
        relaxation: input.float(),
    };
    consistent(|is_standard| {
        let image = field.image.arranged(is_standard);
        let (mut x, mut dual) = (
            field.differences.arranged(is_standard),
            field.dual.arranged(is_standard),
        );
        let residual = tv::admm_update(
            &step,
            field.weight.get(),
            field.norm,
            image.view::<Ix2>(),
            x.view_mut::<Ix3>(),
            dual.view_mut::<Ix3>(),
        )?;
        Ok((vec![residual], (x.values(), dual.values())))
    })
    .map(|_| ())
}
