//! Hostile arguments: zero sizes, numbers near the maximum, and views of any layout.

use jotlight::bits::{PackedBits, add_block_counts};
use jotlight::error::{Error, Result};
use jotlight::likelihood::{Readings, Threshold};
use jotlight::mle::{
    JotCounts, JotResponse, JotResponses, PixelResponse, from_jots, from_probability,
};
use jotlight::network::{Layer, Splines, Wiring, forward, forward_bits, forward_counts};
use jotlight::sensing::{Image, Kernel, PerJot, Sensor, SpreadOperator, Window, expose, rate};
use jotlight::threads::install;
use jotlight::tv::{self, Norm};
use jotlight::values::Values;
use jotlight::vst::Anscombe;
use ndarray::{Array2, Array3, Array4, ArrayView2, ArrayView3, Axis, ShapeBuilder, s};

/// Return the name of the argument that an error names.
fn argument<T>(result: Result<T>) -> &'static str {
    match result {
        Err(Error::Shape { what, .. } | Error::Range { what, .. } | Error::Memory { what, .. }) => {
            what
        }
        _ => "no error of an argument",
    }
}

/// Return a huge image whose pixels share one value in memory.
fn huge<T>(value: &T, size: usize) -> Result<ArrayView2<'_, T>> {
    let view = ArrayView2::from_shape((size, size).strides((0, 0)), std::slice::from_ref(value));
    view.map_err(|error| Error::Shape {
        what: "test",
        expected: error.to_string(),
        received: String::new(),
    })
}

fn sensor<'a>(oversampling: usize, threshold: u32) -> Result<Sensor<'a>> {
    Ok(Sensor {
        kernel: Kernel::new(0, oversampling)?,
        gain_per_frame: (oversampling * oversampling) as f64,
        efficiency: PerJot::Same(1.0),
        dark_counts: PerJot::Same(0.0),
        dead: None,
        threshold: Threshold::new(threshold)?,
    })
}

/// Return a layer with filters of the shape `(1, frames, side, side)`.
fn layer(frames: usize, side: usize) -> Result<Layer<f32>> {
    let filters = Array4::from_elem((1, frames, side, side), 0.5);
    Layer::new(filters, None, 0.0, 1.0, Wiring::default())
}

fn response(max_intensity: f64) -> Result<PixelResponse> {
    Ok(PixelResponse {
        threshold: Threshold::new(3)?,
        light_per_intensity: 1.0,
        max_intensity,
    })
}

const JOT: JotResponse = JotResponse {
    efficiency: 1.0,
    dark_counts: 0.0,
};

#[test]
fn jots_with_the_highest_threshold_report_the_right_bits() -> Result<()> {
    let q = Threshold::MAX_PHOTONS;
    let threshold = Threshold::new(q)?;
    // Rates from far below q to far above it.
    let deviations = [-1000.0, -20.0, -4.0, -1.0, 0.0, 1.0, 4.0, 20.0, 1000.0];
    let rate = |column: usize| f64::from(q) + deviations[column] * f64::from(q).sqrt();
    let image = Array2::from_shape_fn((1000, deviations.len()), |(_, column)| {
        rate(column).max(0.0)
    });
    let all = Window {
        frames: 0..8,
        rows: 0..1000,
        columns: 0..deviations.len(),
    };
    let mut packed = Array3::zeros((8, 1000, 2));
    expose(
        &sensor(1, q)?,
        Image::F64(image.view()),
        [3; 32],
        0,
        &all,
        packed.view_mut(),
    )?;
    let mut counts = Array2::zeros((1000, deviations.len()));
    let bits = PackedBits::new(packed.view(), deviations.len())?;
    add_block_counts(&bits, 1, None, counts.view_mut())?;
    for (column, counts) in counts.axis_iter(Axis(1)).enumerate() {
        let (ones, p) = (
            f64::from(counts.sum()),
            threshold.detection_probability(image[[0, column]]),
        );
        let deviation = (8000.0 * p * (1.0 - p)).sqrt();
        assert!(
            (ones - 8000.0 * p).abs() <= 5.0 * deviation + 1e-6,
            "column {column}: {ones}"
        );
    }
    Ok(())
}

#[test]
fn sizes_beyond_those_of_any_sensor_are_errors() {
    assert_eq!(
        argument(Threshold::new(Threshold::MAX_PHOTONS + 1)),
        "threshold"
    );
    assert_eq!(argument(Threshold::new(u32::MAX)), "threshold");
    assert!(Kernel::new(3, Kernel::MAX_OVERSAMPLING).is_ok());
    for oversampling in [Kernel::MAX_OVERSAMPLING + 1, usize::MAX] {
        assert_eq!(argument(Kernel::new(3, oversampling)), "oversampling");
    }
    for threads in [0, 1025, usize::MAX] {
        assert_eq!(argument(install(Some(threads), || ())), "threads");
    }
}

#[test]
fn counts_that_could_exceed_their_type_are_errors() -> Result<()> {
    let byte = 0xff;
    let frames = |number: usize, rows: usize| -> Result<_> {
        let view = ArrayView3::from_shape(
            (number, rows, 1).strides((0, 0, 0)),
            std::slice::from_ref(&byte),
        );
        PackedBits::new(view.map_err(|_| Error::Interrupted)?, rows)
    };
    let mut one = Array2::from_elem((1, 1), 0);
    for (number, rows) in [(1 << 31, 1), (1 << 60, 1), (1 << 29, 2)] {
        let result = add_block_counts(&frames(number, rows)?, rows, None, one.view_mut());
        assert_eq!(argument(result), "trials per pixel", "{number} frames");
    }
    let mut counts = Array2::from_elem((1, 1), i32::MAX - 3);
    add_block_counts(&frames(3, 1)?, 1, None, counts.view_mut())?;
    assert_eq!(counts[[0, 0]], i32::MAX);
    let result = add_block_counts(&frames(1, 1)?, 1, None, counts.view_mut());
    assert_eq!(argument(result), "counts");
    assert_eq!(counts[[0, 0]], i32::MAX);
    Ok(())
}

#[test]
fn empty_arrays_are_errors_or_lead_to_empty_results() -> Result<()> {
    let (packed, mut counts) = (Array3::zeros((3, 0, 0)), Array2::zeros((0, 0)));
    let bits = PackedBits::new(packed.view(), 0)?;
    add_block_counts(&bits, 2, None, counts.view_mut())?;
    for oversampling in [0, usize::MAX] {
        let result = add_block_counts(&bits, oversampling, None, counts.view_mut());
        assert_eq!(result.is_ok(), oversampling > 0);
    }
    let layers = [layer(3, 2)?, layer(1, 1)?];
    let layers: Vec<_> = layers.iter().collect();
    let planes = "planes of the first layer";
    let mut out = Array2::zeros((2, 2));
    let result = forward_bits(&layers, &bits, out.view_mut());
    assert_eq!(argument(result), planes);
    for shape in [(1, 0, 3), (1, 3, 0), (0, 3, 3)] {
        let sums = Array3::zeros(shape);
        let result = forward(&layers[1..], sums.view(), out.view_mut());
        assert_eq!(argument(result), planes);
    }
    let sums = Array2::zeros((1, 0));
    let counts = Array2::zeros((2, 2));
    let result = forward_counts(&layers[1..], counts.view(), sums.view(), out.view_mut());
    assert_eq!(argument(result), "counts");

    let counts = |oversampling| JotCounts {
        ones: &[1],
        responses: JotResponses {
            efficiency: Values::Same(1.0),
            dark_counts: Values::Same(0.0),
        },
        dead: None,
        frames: 1,
        oversampling,
    };
    let mut out = [0.0];
    for (oversampling, size, expected) in [
        (1, (1, 0), "size"),
        (0, (1, 1), "oversampling"),
        (usize::MAX, (1, 1), "ones"),
        (1, (1, usize::MAX), "size"),
        (1, (2, usize::MAX), "size"),
    ] {
        let result = from_jots(&response(1.0)?, &counts(oversampling), size, &mut out);
        assert_eq!(argument(result), expected);
    }
    let result = from_jots(&response(1.0)?, &counts(2), (1, 1), &mut out);
    let message = result.map_or_else(|error| error.to_string(), |()| String::new());
    assert_eq!(message, "ones: expected 1 x 2 x 2, got 1");
    Ok(())
}

#[test]
fn numbers_that_are_not_intervals_are_errors() -> Result<()> {
    let readings = Readings::new(
        Threshold::new(2)?,
        &[0],
        Values::Same(0.0),
        Values::Same(1.0),
        Values::Same(0.0),
    )?;
    for max in [-1.0, f64::NAN, f64::MAX] {
        let proximal = readings.proximal(1.0, max, &[0.0], &mut [0.0]);
        assert_eq!(argument(proximal), "maximum of the light");
        if max > 0.0 {
            continue;
        }
        let estimate = from_probability(&response(max)?, &[0.5], JOT, &mut [0.0]);
        assert_eq!(argument(estimate), "maximum intensity");
        assert!(response(max)?.intensity(0.5, JOT).is_finite());
    }
    // A bisection stays within the interval, however large or small its numbers are.
    for (threshold, max) in [(1, 1e300), (2, 1e300), (1, 3e-322), (2, 3e-322)] {
        let (threshold, trials) = (Threshold::new(threshold)?, Values::Same(3.0));
        let readings = Readings::new(
            threshold,
            &[3],
            trials,
            Values::Same(1.0),
            Values::Same(0.0),
        )?;
        for penalty in [1e-300, 1.0, 1e300] {
            let mut point = [max];
            readings.proximal(penalty, max, &[max], &mut point)?;
            assert!((0.0..=max).contains(&point[0]));
        }
    }
    let anscombe = Anscombe::new(100)?;
    let ends = [anscombe.expectation(0.0), anscombe.expectation(1.0)];
    for (probability, end) in [(-1e18, ends[0]), (1e18, ends[1])] {
        assert!((anscombe.expectation(probability) - end).abs() < 1e-12);
    }
    Ok(())
}

#[test]
fn numbers_near_the_maximum_are_errors() -> Result<()> {
    let image = Array2::from_elem((2, 2), 0.5);
    let light = Image::F64(image.view());
    let all = Window {
        frames: 0..1,
        rows: 0..2,
        columns: 0..2,
    };
    let mut bits = Array3::zeros((1, 2, 1));
    let result = expose(
        &sensor(1, 1)?,
        light,
        [0; 32],
        usize::MAX,
        &all,
        bits.view_mut(),
    );
    assert_eq!(argument(result), "channel");
    let mut out = Array2::zeros((2, 2));
    for first in [1, usize::MAX - 1, usize::MAX] {
        assert_eq!(
            argument(rate(&sensor(1, 1)?, light, first, out.view_mut())),
            "out"
        );
    }
    for upsampling in [0, 2, 1 << 32, usize::MAX] {
        let wiring = Wiring {
            upsampling,
            ..Wiring::default()
        };
        let layer = Layer::new(Array4::from_elem((1, 1, 1, 1), 0.5), None, 0.0, 1.0, wiring);
        assert_eq!(argument(layer), "upsampling");
    }
    Ok(())
}

#[test]
fn images_beyond_the_memory_are_errors() -> Result<()> {
    let (zero, count, size) = (0.0, 0, 1 << 30);
    let layers = [layer(1, 1)?];
    let layers: Vec<_> = layers.iter().collect();
    let counts = huge(&count, size)?;
    let sums = Array2::zeros((1, 1));
    let mut image = Array2::zeros((2, 2));
    let result = forward_counts(&layers, counts, sums.view(), image.view_mut());
    assert_eq!(argument(result), "out");
    let coefficients = huge(&0.0f32, size)?;
    assert_eq!(
        argument(Splines::new(coefficients, 0.0, 1.0)),
        "spline coefficients"
    );
    let image = huge(&zero, size)?;
    let differences = image.insert_axis(Axis(0));
    let differences = differences
        .broadcast((1, 2, size, size))
        .ok_or(Error::Interrupted)?;
    let columns = differences.slice(s![.., .., .., ..0]);
    let total = tv::total_variation(columns, Values::Same(1.0), Norm::Isotropic);
    assert_eq!(argument(total), "image");
    let box_kernel = Kernel::new(0, 4096)?;
    let spread = SpreadOperator::new(box_kernel.clone(), box_kernel);
    let mut out = Array3::zeros((1, 1 << 14, 1 << 14));
    let jots = huge(&zero, 1 << 26)?.insert_axis(Axis(0));
    assert_eq!(
        argument(spread.adjoint(1.0, jots, out.view_mut())),
        "rows of jots"
    );
    Ok(())
}

#[test]
fn splines_of_planes_do_not_depend_on_the_memory_layout() -> Result<()> {
    let coefficients = Array2::from_shape_fn((2, 6), |(row, column)| (row * 7 + column * 3) as f64);
    let splines = Splines::new(coefficients.view(), 0.0, 1.0)?;
    let value =
        |(item, channel, pixel): (usize, usize, usize)| 0.1 * (item + 2 * channel + pixel) as f64;
    let standard = Array3::from_shape_fn((3, 2, 4), value);
    let fortran = Array3::from_shape_fn((3, 2, 4).f(), value);
    let mut reversed = Array3::from_shape_fn((3, 2, 4), |(i, c, p)| value((i, c, 3 - p)));
    reversed.invert_axis(Axis(2));
    let (expected, gradients) = (
        splines.activate(standard.view())?,
        splines.pull_back(standard.view(), standard.view())?,
    );
    assert_ne!(expected, standard);
    for other in [fortran, reversed] {
        assert_eq!(splines.activate(other.view())?, expected);
        assert_eq!(splines.pull_back(other.view(), other.view())?, gradients);
    }
    Ok(())
}
