//! Parameters that are NaN, infinite, or negative are errors.

use jotlight::admm::AdmmStep;
use jotlight::error::{Error, Result};
use jotlight::joint::{JointReadings, Term, TermCells};
use jotlight::likelihood::{Readings, Threshold};
use jotlight::mle::{
    JotCounts, JotResponse, JotResponses, PixelResponse, equivalent_counts, from_counts, from_jots,
    from_probability,
};
use jotlight::multibit::{Cells, Response, Sample};
use jotlight::network::{Network, SensorModel, Served, local_trials};
use jotlight::tv::{self, Norm};
use jotlight::values::Values;
use ndarray::{Array3, Array4, array};

use crate::model::{identity, sensor};

const NEVER: [f64; 4] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.5];

/// Check that a function refuses impossible values of a parameter, and 0 unless it is possible.
pub fn assert_refused<R>(
    name: &'static str,
    zero_is_possible: bool,
    function: impl Fn(f64) -> Result<R>,
) {
    let zero = (!zero_is_possible).then_some(0.0);
    for value in NEVER.into_iter().chain(zero) {
        let refused = function(value).err();
        let is_named = matches!(refused, Some(Error::Range { what, .. }) if what == name);
        assert!(is_named, "{name} = {value}: {refused:?}");
    }
    for value in [0.5].into_iter().chain(zero_is_possible.then_some(0.0)) {
        assert!(function(value).is_ok(), "{name} = {value}");
    }
}

/// Check that a function refuses NaN, and takes all numbers.
fn assert_nan_is_refused<R>(name: &'static str, function: impl Fn(f64) -> Result<R>) {
    let refused = function(f64::NAN).err();
    let is_named = matches!(refused, Some(Error::Range { what, .. }) if what == name);
    assert!(is_named, "{name}: {refused:?}");
    for value in [f64::NEG_INFINITY, -0.5, 0.0, 0.5, f64::INFINITY] {
        assert!(function(value).is_ok(), "{name} = {value}");
    }
}

/// Check that a function refuses impossible parameters of a pixel.
fn assert_response_is_checked(function: impl Fn(PixelResponse) -> Result<()>) -> Result<()> {
    let response = sensor(16, 1.0)?.response;
    assert_refused("light at intensity 1", false, |light_per_intensity| {
        function(PixelResponse {
            light_per_intensity,
            ..response
        })
    });
    assert_refused("maximum intensity", true, |max_intensity| {
        function(PixelResponse {
            max_intensity,
            ..response
        })
    });
    Ok(())
}

/// Check that a function refuses impossible parameters of the jot of a whole sensor.
fn assert_jot_is_checked(function: impl Fn(JotResponse) -> Result<()>) {
    let (efficiency, dark_counts) = (0.8, 0.1);
    assert_refused("efficiency", false, |efficiency| {
        function(JotResponse {
            efficiency,
            dark_counts,
        })
    });
    assert_refused("dark counts", true, |dark_counts| {
        function(JotResponse {
            efficiency,
            dark_counts,
        })
    });
}

/// Check that a function refuses impossible parameters of two jots, with one value or two of them.
fn assert_jots_are_checked(function: impl Fn(Values<'_, f64>, Values<'_, f64>) -> Result<()>) {
    let known = Values::Same(0.5);
    for is_second in [false, true] {
        let name = ["efficiency", "dark counts"][usize::from(is_second)];
        let call = |values: Values<'_, f64>| {
            if is_second {
                function(known, values)
            } else {
                function(values, known)
            }
        };
        assert_refused(name, true, |value| call(Values::Same(value)));
        assert_refused(name, true, |value| call(Values::Each(&[0.5, value])));
    }
}

#[test]
fn networks_are_not_prepared_for_impossible_sensors() -> Result<()> {
    let own = sensor(16, 1.0)?;
    let many = Network::new(vec![identity(1)], Served::Trials { min: 4, max: 64 })?;
    let prepare = |sensor: SensorModel| {
        // A network for one sensor is made for it, and refuses it then.
        let single = Network::new(vec![identity(1)], Served::Sensor(sensor));
        let refused = single.map(|_| ());
        let result = many.prepare(sensor).map(|_| ());
        assert_eq!(format!("{refused:?}"), format!("{result:?}"));
        result
    };
    assert_response_is_checked(|response| prepare(SensorModel { response, ..own }))?;
    assert_jot_is_checked(|jot| prepare(SensorModel { jot, ..own }));
    let none = Served::Sensor(SensorModel { trials: 0, ..own });
    assert!(Network::new(vec![identity(1)], none).is_err());
    assert_refused("trials", false, |trials| {
        local_trials(array![[4.0, trials]].view())
    });
    Ok(())
}

fn jots<'a>(efficiency: Values<'a, f64>, dark_counts: Values<'a, f64>) -> JotResponses<'a> {
    JotResponses {
        efficiency,
        dark_counts,
    }
}

#[test]
fn estimates_of_impossible_sensors_are_errors() -> Result<()> {
    let own = sensor(16, 1.0)?;
    let (counts, known) = ([3, 4], Values::Same(0.5));
    let estimate = |response: &PixelResponse, jots: JotResponses<'_>| {
        from_counts(response, &counts, Values::Same(16.0), &jots, &mut [0.0; 2])?;
        let jots = JotCounts {
            ones: &counts,
            responses: jots,
            dead: None,
            frames: 16,
            oversampling: 1,
        };
        from_jots(response, &jots, (1, 2), &mut [0.0; 2])
    };
    assert_response_is_checked(|response| estimate(&response, jots(known, known)))?;
    assert_jots_are_checked(|first, second| estimate(&own.response, jots(first, second)));
    let from_half = |response, jot| from_probability(&response, &[0.5, 0.5], jot, &mut [0.0; 2]);
    assert_response_is_checked(|response| from_half(response, own.jot))?;
    assert_jot_is_checked(|jot| from_half(own.response, jot));
    let equivalent = |response, jots: JotResponses<'_>, trials, reference| {
        let all = Values::Same(16.0);
        equivalent_counts(
            &response,
            &counts,
            all,
            &jots,
            &[trials],
            reference,
            &mut [0.0; 2],
        )
    };
    let alike = jots(known, known);
    assert_response_is_checked(|response| equivalent(response, alike, 8.0, own.jot))?;
    assert_jot_is_checked(|jot| equivalent(own.response, alike, 8.0, jot));
    assert_jots_are_checked(|first, second| {
        equivalent(own.response, jots(first, second), 8.0, own.jot)
    });
    assert_refused("trials of equivalent pixels", true, |trials| {
        equivalent(own.response, alike, trials, own.jot)
    });
    Ok(())
}

#[test]
fn samples_have_as_many_readings_for_each_cell() -> Result<()> {
    let response = Response::new(3, 0.0, 1)?;
    let (one, none) = (Values::Same(1.0), Values::Same(0.0));
    let cells =
        |readings, number| Cells::new(&response, Sample::Readings(readings), number, one, none);
    assert!(cells(&[0; 10], 5).is_ok());
    // As bits, readings may be those of no cell.
    assert!(Readings::new(Threshold::new(1)?, &[], one, one, none)?.is_empty());
    let empty = cells(&[], 0)?;
    assert!(empty.is_empty());
    assert!(empty.value(&[])?.abs() < 1e-300);
    empty.gradient_and_curvature(&[], &mut [], &mut [])?;
    for (readings, number) in [(&[0; 7][..], 5), (&[0], 0)] {
        let message =
            cells(readings, number).map_or_else(|error| error.to_string(), |_| String::new());
        let received = readings.len();
        let expected =
            format!("sample: expected a multiple of {number}, the number of cells, got {received}");
        assert_eq!(message, expected);
    }
    Ok(())
}

#[test]
fn likelihoods_of_impossible_sensors_are_errors() -> Result<()> {
    let (q, ones, all) = (Threshold::new(1)?, [3, 4], Values::Same(16.0));
    assert_jots_are_checked(|first, second| {
        Readings::new(q, &ones, all, first, second).map(|_| ())
    });
    let response = Response::new(15, 0.0, 1)?;
    assert_jots_are_checked(|first, second| {
        Cells::new(&response, Sample::Readings(&ones), 2, first, second).map(|_| ())
    });
    let readings = Readings::new(q, &ones, all, Values::Same(1.0), Values::Same(0.0))?;
    let term = |light| Term {
        cells: TermCells::Bits(readings),
        light,
        side: 1,
        places: None,
    };
    assert_refused("light", true, |light| {
        JointReadings::new(vec![term(light)], 1, 2)
    });
    for (height, width) in [(usize::MAX, 2), (1 << 63, 1 << 63)] {
        let result = JointReadings::new(vec![term(1.0)], height, width);
        assert!(matches!(result, Err(Error::Shape { what: "cells", .. })));
    }
    let joint = JointReadings::new(vec![term(1.0)], 1, 2)?;
    assert_nan_is_refused("total", |total| {
        joint.solve_total(&[1.0, total], 1.0, 0.0, &mut [0.1; 2])
    });
    let start = || [0.1; 2];
    for search in [
        |joint: &JointReadings<'_>, highest, offset, start: &mut [f64]| {
            joint.maximize(highest, offset, start)
        },
        |joint: &JointReadings<'_>, highest, offset, start: &mut [f64]| {
            joint.solve_total(&[1.0; 2], highest, offset, start)
        },
    ] {
        assert_refused("highest intensity", false, |highest| {
            search(&joint, highest, 0.0, &mut start())
        });
        assert_refused("offset", true, |offset| {
            search(&joint, 1.0, offset, &mut start())
        });
    }
    Ok(())
}

#[test]
fn impossible_parameters_of_iterations_are_errors() -> Result<()> {
    let (q, all) = (Threshold::new(1)?, Values::Same(16.0));
    let readings = Readings::new(q, &[3, 4], all, Values::Same(1.0), Values::Same(0.0))?;
    let weigh = |weight: Values<'_, f64>| {
        let mut planes = Array4::from_elem((1, 2, 1, 2), 0.5);
        tv::total_variation(planes.view(), weight, Norm::Isotropic)?;
        let step = AdmmStep {
            penalty: 1.0,
            relaxation: 1.5,
        };
        let (image, mut x, mut dual) = (Array3::zeros((1, 1, 2)), planes.clone(), planes.clone());
        let (x, dual) = (x.view_mut(), dual.view_mut());
        tv::admm_update(&[step], weight, Norm::Isotropic, image.view(), x, dual)?;
        tv::shrink(planes.view_mut(), Values::Same(0.0), Norm::Isotropic)
    };
    assert_refused("weight", true, |weight| weigh(Values::Same(weight)));
    assert_refused("weight", true, |weight| weigh(Values::Each(&[1.0, weight])));
    assert_refused("threshold", true, |threshold| {
        let mut planes = Array4::zeros((1, 2, 1, 2));
        tv::shrink(
            planes.view_mut(),
            Values::Same(threshold),
            Norm::Anisotropic,
        )
    });
    let update = |penalty, relaxation| {
        let step = AdmmStep {
            penalty,
            relaxation,
        };
        let (mut x, mut dual) = ([0.1; 2], [0.0; 2]);
        readings.admm_update(&[step], 1.0, &[0.1; 2], &mut x, &mut dual)
    };
    assert_refused("penalty", false, |penalty| update(penalty, 1.5));
    assert_refused("relaxation", false, |relaxation| update(1.0, relaxation));
    assert_refused("penalty", false, |penalty| {
        readings.proximal(penalty, 1.0, &[0.1; 2], &mut [0.1; 2])
    });
    assert_nan_is_refused("point", |point| {
        readings.proximal(1.0, 1.0, &[0.1; 2], &mut [0.1, point])
    });
    let update = |light, dual| {
        let step = AdmmStep {
            penalty: 1.0,
            relaxation: 1.5,
        };
        readings.admm_update(&[step], 1.0, &[0.1, light], &mut [0.1; 2], &mut [0.0, dual])
    };
    assert_nan_is_refused("light", |light| update(light, 0.0));
    assert_nan_is_refused("dual", |dual| update(0.1, dual));
    Ok(())
}
