//! Comparisons of the operator G with the rates of the sensor model, and of its adjoint and normal
//! operator with their definitions.

use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::sensing::{Image, Kernel, PerJot, Sensor, SpreadOperator, rate};
use ndarray::{Array2, Array3, ArrayView2, ArrayViewMut2, Axis};

/// Return an array of positive values without symmetry.
fn pattern(height: usize, width: usize) -> Array2<f64> {
    Array2::from_shape_fn((height, width), |(row, column)| {
        0.6 + 0.5 * (1.3 * row as f64 + 0.41 * (column * column) as f64).sin()
    })
}

/// Apply an operator to a stack of one image.
fn forward(
    operator: &SpreadOperator,
    gain: f64,
    image: ArrayView2<'_, f64>,
    out: ArrayViewMut2<'_, f64>,
) -> Result<()> {
    operator.forward(gain, image.insert_axis(Axis(0)), out.insert_axis(Axis(0)))
}

fn adjoint(
    operator: &SpreadOperator,
    gain: f64,
    jots: ArrayView2<'_, f64>,
    out: ArrayViewMut2<'_, f64>,
) -> Result<()> {
    operator.adjoint(gain, jots.insert_axis(Axis(0)), out.insert_axis(Axis(0)))
}

fn normal(
    operator: &SpreadOperator,
    gain: f64,
    [weights, image]: [ArrayView2<'_, f64>; 2],
    out: ArrayViewMut2<'_, f64>,
) -> Result<()> {
    let [weights, image] = [weights, image].map(|array| array.insert_axis(Axis(0)));
    operator.normal(gain, weights, image, out.insert_axis(Axis(0)))
}

#[test]
fn adjoint_and_normal_operators_are_exact() -> Result<()> {
    for degree in 0..=3 {
        for oversampling in 1..=4 {
            for (vertical, jot_rows) in [((degree, oversampling), 4 * oversampling), ((0, 1), 4)] {
                let vertical = Kernel::new(vertical.0, vertical.1)?;
                let horizontal = Kernel::new(degree, oversampling)?;
                let operator = SpreadOperator::new(vertical, horizontal);
                let jots = (jot_rows, 5 * oversampling);
                let (x, y) = (pattern(4, 5), pattern(jots.0, jots.1));
                let (mut light, mut pixels) = (Array2::zeros(jots), Array2::zeros((4, 5)));
                forward(&operator, 1.7, x.view(), light.view_mut())?;
                adjoint(&operator, 1.7, y.view(), pixels.view_mut())?;
                let (left, right) = ((&light * &y).sum(), (&x * &pixels).sum());
                assert!(
                    (left - right).abs() < 1e-12 * left,
                    "degree {degree}, K̂ {oversampling}"
                );

                let (mut found, mut expected) = (Array2::zeros((4, 5)), Array2::zeros((4, 5)));
                normal(&operator, 1.7, [y.view(), x.view()], found.view_mut())?;
                adjoint(&operator, 1.7, (&light * &y).view(), expected.view_mut())?;
                assert!((&found - &expected).iter().all(|error| error.abs() < 1e-12));
            }
        }
    }
    Ok(())
}

#[test]
fn the_operator_agrees_with_the_rates() -> Result<()> {
    for degree in 0..=3 {
        let sensor = Sensor {
            kernel: Kernel::new(degree, 3)?,
            gain_per_frame: 2.5,
            efficiency: PerJot::Same(1.0),
            dark_counts: PerJot::Same(0.0),
            dead: None,
            threshold: Threshold::new(1)?,
        };
        let image = pattern(4, 5);
        let (mut rates, mut light) = (Array2::zeros((12, 15)), Array2::zeros((12, 15)));
        rate(&sensor, Image::F64(image.view()), 0, rates.view_mut())?;
        let operator = SpreadOperator::new(sensor.kernel.clone(), sensor.kernel.clone());
        forward(&operator, 2.5, image.view(), light.view_mut())?;
        let errors = &rates.mapv(f64::from) - &light;
        assert!(
            errors.iter().all(|error| error.abs() < 1e-6),
            "degree {degree}"
        );
    }
    Ok(())
}

#[test]
fn arrays_of_the_wrong_shape_are_errors() -> Result<()> {
    let operator = SpreadOperator::new(Kernel::new(1, 2)?, Kernel::new(1, 2)?);
    let (image, jots) = (pattern(4, 5), pattern(8, 9));
    let mut out = Array2::zeros((8, 9));
    assert!(forward(&operator, 1.0, image.view(), out.view_mut()).is_err());
    let mut out = Array2::zeros((4, 5));
    assert!(adjoint(&operator, 1.0, jots.view(), out.view_mut()).is_err());
    let weights = pattern(8, 9);
    assert!(
        normal(
            &operator,
            1.0,
            [weights.view(), image.view()],
            out.view_mut()
        )
        .is_err()
    );
    let (images, mut jots) = (Array3::zeros((2, 4, 5)), Array3::zeros((3, 8, 10)));
    assert!(
        operator
            .forward(1.0, images.view(), jots.view_mut())
            .is_err()
    );
    Ok(())
}
