//! Sensors and light that are NaN, infinite, or negative are errors.

use std::ops::Range;

use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::multibit::{self, Response};
use jotlight::sensing::{
    Image, Kernel, PerJot, Sensor, Window, draw_counts, expose, probability, rate,
};
use ndarray::{Array2, Array3, array};

use crate::parameters::assert_refused;

/// Call the functions that simulate a sensor, and return their common result.
fn see<'a>(gain_per_frame: f64, efficiency: PerJot<'a>, dark_counts: PerJot<'a>) -> Result<()> {
    let image = array![[0.5, 0.6]];
    let window = Window {
        frames: 0..1,
        rows: 0..1,
        columns: 0..2,
    };
    let response = Response::new(15, 0.0, 1)?;
    let sensor = Sensor {
        kernel: Kernel::new(0, 1)?,
        gain_per_frame,
        efficiency,
        dark_counts,
        dead: None,
        threshold: Threshold::new(1)?,
    };
    let (light, mut out) = (Image::F64(image.view()), Array2::zeros((1, 2)));
    let mut bits = Array3::zeros((1, 1, 1));
    let mut numbers = Array3::zeros((1, 1, 2));
    let results = [
        rate(&sensor, light, 0, out.view_mut()),
        probability(&sensor, light, 0, out.view_mut()),
        expose(&sensor, light, [0; 32], 0, &window, bits.view_mut()),
        multibit::draw(
            &sensor,
            &response,
            light,
            [0; 32],
            0,
            &window,
            numbers.view_mut(),
        ),
    ];
    assert!(results.iter().all(|result| *result == results[0]));
    if let (PerJot::Same(_), PerJot::Same(_)) = (efficiency, dark_counts) {
        let mut counts = Array2::zeros((1, 2));
        let result = draw_counts(&sensor, 1, light, [0; 32], 0, counts.view_mut());
        assert_eq!(result, results[0]);
    }
    results.into_iter().collect::<Result<()>>()
}

#[test]
fn impossible_light_is_refused() -> Result<()> {
    let own = |degree| -> Result<_> {
        Ok(Sensor {
            kernel: Kernel::new(degree, 2)?,
            gain_per_frame: 1.0,
            efficiency: known(),
            dark_counts: known(),
            dead: None,
            threshold: Threshold::new(1)?,
        })
    };
    let (flat, smooth) = (own(0)?, own(3)?);
    let (response, seed) = (Response::new(15, 0.0, 1)?, [0; 32]);
    let window = |rows| Window {
        frames: 0..1,
        rows,
        columns: 0..2,
    };
    let draw = |sensor: &Sensor<'_>, light: Image<'_>, rows: Range<usize>| {
        let jots = 2 * rows.len();
        let (mut bits, mut numbers) = (Array3::zeros((1, jots, 1)), Array3::zeros((1, jots, 4)));
        let (window, bits) = (window(rows), bits.view_mut());
        let numbers = numbers.view_mut();
        let results = [
            expose(sensor, light, seed, 0, &window, bits),
            multibit::draw(sensor, &response, light, seed, 0, &window, numbers),
        ];
        assert_eq!(results[0], results[1]);
        results.into_iter().collect::<Result<()>>()
    };
    assert_refused("image", true, |value| {
        let (double, single) = (array![[0.5, value]], array![[0.5, value as f32]]);
        for light in [Image::F64(double.view()), Image::F32(single.view())] {
            let (mut out, mut counts) = (Array2::zeros((2, 4)), Array2::zeros((1, 2)));
            let results = [
                draw(&flat, light, 0..1),
                draw(&smooth, light, 0..1),
                rate(&flat, light, 0, out.view_mut()),
                probability(&smooth, light, 0, out.view_mut()),
                draw_counts(&flat, 1, light, seed, 0, counts.view_mut()),
            ];
            assert!(results.iter().all(|result| *result == results[0]));
            results.into_iter().collect::<Result<()>>()?;
        }
        Ok(())
    });
    // Light that reaches no jot of the window is not looked at.
    let mut tall = Array2::from_elem((9, 2), 0.5);
    tall[[8, 0]] = -1.0;
    draw(&smooth, Image::F64(tall.view()), 0..5)?;
    assert!(draw(&smooth, Image::F64(tall.view()), 0..8).is_err());
    Ok(())
}

fn known<'a>() -> PerJot<'a> {
    PerJot::Same(0.5)
}

#[test]
fn impossible_sensors_see_nothing() {
    assert_refused("gain per frame", true, |gain| see(gain, known(), known()));
    assert_refused("efficiency", true, |value| {
        see(1.0, PerJot::Same(value), known())
    });
    assert_refused("dark counts", true, |value| {
        see(1.0, known(), PerJot::Same(value))
    });
    let map = |value: f64| array![[0.5, value as f32]];
    assert_refused("efficiency", true, |value| {
        see(1.0, PerJot::Map(map(value).view()), known())
    });
    assert_refused("dark counts", true, |value| {
        see(1.0, known(), PerJot::Map(map(value).view()))
    });
}
