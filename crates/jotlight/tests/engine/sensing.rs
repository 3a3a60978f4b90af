//! Comparisons of rates, probabilities, and bits of the sensor model with their definitions.

use jotlight::bits::packed_width;
use jotlight::error::{Error, Result};
use jotlight::likelihood::Threshold;
use jotlight::sensing::{Image, Kernel, PerJot, Sensor, Window, expose, probability, rate};
use jotlight::threads;
use ndarray::{Array2, Array3};

const SEED: [u8; 32] = [7; 32];

fn sensor<'a>(degree: usize, oversampling: usize, q: u32) -> Result<Sensor<'a>> {
    Ok(Sensor {
        kernel: Kernel::new(degree, oversampling)?,
        gain_per_frame: 1.3 * (oversampling * oversampling) as f64,
        efficiency: PerJot::Same(0.9),
        dark_counts: PerJot::Same(0.02),
        dead: None,
        threshold: Threshold::new(q)?,
    })
}

fn test_image(height: usize, width: usize) -> Array2<f64> {
    Array2::from_shape_fn((height, width), |(row, column)| {
        0.5 + 0.5 * (1.0 + row as f64 + 0.37 * (column * column) as f64).sin()
    })
}

fn whole(image: &Array2<f64>, frames: usize) -> Window {
    Window {
        frames: 0..frames,
        rows: 0..image.nrows(),
        columns: 0..image.ncols(),
    }
}

fn draw(sensor: &Sensor<'_>, image: &Array2<f64>, window: &Window) -> Result<Array3<u8>> {
    let oversampling = sensor.kernel.oversampling();
    let mut out = Array3::from_elem(
        (
            window.frames.len(),
            window.rows.len() * oversampling,
            packed_width(window.columns.len() * oversampling),
        ),
        0xff,
    );
    expose(
        sensor,
        Image::F64(image.view()),
        SEED,
        0,
        window,
        out.view_mut(),
    )?;
    Ok(out)
}

fn bit(bits: &Array3<u8>, frame: usize, row: usize, column: usize) -> u8 {
    bits[[frame, row, column / 8]] >> (7 - column % 8) & 1
}

#[test]
fn bits_are_the_same_for_any_number_of_threads() -> Result<()> {
    let image = test_image(23, 31);
    for degree in 0..=3 {
        let sensor = sensor(degree, 3, 2)?;
        let draw_with =
            |threads| threads::install(threads, || draw(&sensor, &image, &whole(&image, 3)))?;
        let one = draw_with(Some(1))?;
        for threads in [Some(2), Some(3), Some(7), None] {
            assert_eq!(
                draw_with(threads)?,
                one,
                "degree {degree}, threads {threads:?}"
            );
        }
    }
    Ok(())
}

#[test]
fn bits_do_not_depend_on_the_window() -> Result<()> {
    for (degree, oversampling, width) in [(0, 1, 5000), (0, 7, 700), (1, 3, 40), (3, 5, 900)] {
        let image = test_image(4, width);
        let sensor = sensor(degree, oversampling, 1)?;
        let all = draw(&sensor, &image, &whole(&image, 4))?;
        for (frames, rows, columns) in [
            (1..3, 1..4, 0..width),
            (0..1, 2..3, 1..2),
            (3..4, 0..4, 13..width - 9),
            (0..4, 3..4, width - 1..width),
        ] {
            let window = Window {
                frames,
                rows,
                columns,
            };
            let part = draw(&sensor, &image, &window)?;
            let (frames, rows, bytes) = part.dim();
            let jots = window.columns.len() * oversampling;
            for frame in 0..frames {
                for row in 0..rows {
                    for column in 0..8 * bytes {
                        let expected = if column < jots {
                            let column = window.columns.start * oversampling + column;
                            let row = window.rows.start * oversampling + row;
                            bit(&all, window.frames.start + frame, row, column)
                        } else {
                            0
                        };
                        assert_eq!(bit(&part, frame, row, column), expected, "{window:?}");
                    }
                }
            }
        }
    }
    Ok(())
}

#[test]
fn every_channel_frame_and_row_has_its_own_draws() -> Result<()> {
    let (sensor, image) = (sensor(0, 2, 1)?, Array2::from_elem((3, 40), 0.5));
    let mut rows = Vec::new();
    for channel in 0..3 {
        let mut out = Array3::zeros((4, 6, 10));
        let light = Image::F64(image.view());
        expose(
            &sensor,
            light,
            SEED,
            channel,
            &whole(&image, 4),
            out.view_mut(),
        )?;
        for row in out.rows() {
            assert!(!rows.contains(&row.to_vec()), "channel {channel}");
            rows.push(row.to_vec());
        }
    }
    Ok(())
}

#[test]
fn the_rate_of_a_jot_is_a_weighted_sum_of_pixels() -> Result<()> {
    let image = test_image(5, 6);
    for degree in 0..=3 {
        for oversampling in 1..=4 {
            let sensor = sensor(degree, oversampling, 1)?;
            let mut rates = Array2::zeros((5 * oversampling, 6 * oversampling));
            rate(&sensor, Image::F64(image.view()), 0, rates.view_mut())?;
            let taps = sensor.kernel.taps();
            let shift = (degree * oversampling / 2) as isize;
            // The weight of the light of a pixel at a jot.
            let weight = |jot: usize, pixel: isize| {
                let tap = jot as isize + shift - pixel * oversampling as isize;
                usize::try_from(tap)
                    .ok()
                    .and_then(|tap| taps.get(tap))
                    .unwrap_or(&0.0)
            };
            // The index of the pixel that continues the image beyond its border.
            let mirror = |pixel: isize, size: isize| match pixel {
                ..0 => (-1 - pixel) as usize,
                _ if pixel >= size => (2 * size - 1 - pixel) as usize,
                _ => pixel as usize,
            };
            for ((row, column), &value) in rates.indexed_iter() {
                let mut light = 0.0;
                for y in -3..8 {
                    for x in -3..9 {
                        light += weight(row, y)
                            * weight(column, x)
                            * image[[mirror(y, 5), mirror(x, 6)]];
                    }
                }
                let expected = 0.9 * sensor.gain_per_frame * light + 0.02;
                assert!(
                    (f64::from(value) - expected).abs() < 1e-6 * expected,
                    "degree {degree}, K̂ {oversampling}, ({row}, {column}): {value}, not {expected}"
                );
            }
        }
    }
    Ok(())
}

#[test]
fn frequencies_of_ones_agree_with_the_probabilities() -> Result<()> {
    let image = test_image(6, 9);
    let dead = Array2::from_shape_fn((18, 27), |(row, column)| (row + column) % 5 == 0);
    let dark = Array2::from_shape_fn((18, 27), |(row, _)| 0.01 * row as f32);
    for (degree, q) in [(0, 1), (0, 3), (2, 2)] {
        let sensor = Sensor {
            dead: Some(dead.view()),
            dark_counts: PerJot::Map(dark.view()),
            ..sensor(degree, 3, q)?
        };
        let mut probabilities = Array2::zeros((18, 27));
        probability(
            &sensor,
            Image::F64(image.view()),
            0,
            probabilities.view_mut(),
        )?;
        let frames = 4000;
        let bits = draw(&sensor, &image, &whole(&image, frames))?;
        for ((row, column), &expected) in probabilities.indexed_iter() {
            let ones: i32 = (0..frames)
                .map(|frame| i32::from(bit(&bits, frame, row, column)))
                .sum();
            if dead[[row, column]] {
                assert_eq!((ones, expected.to_bits()), (0, 0));
            } else {
                // The bound is 6.5 standard deviations, plus 6 because the distribution is skewed.
                // Fewer than one in 10⁶ seeds exceed it.
                let (mean, frames) = (frames as f64 * f64::from(expected), frames as f64);
                let deviation = (mean * (1.0 - mean / frames)).sqrt();
                assert!((f64::from(ones) - mean).abs() < 6.5 * deviation + 6.0);
            }
        }
    }
    Ok(())
}

/// Return the name of the argument that an error names.
fn argument(result: Result<()>) -> &'static str {
    match result {
        Err(Error::Shape { what, .. } | Error::Range { what, .. }) => what,
        _ => "no error of shape or range",
    }
}

#[test]
fn invalid_windows_are_errors() -> Result<()> {
    let image = test_image(4, 5);
    let sensor = sensor(1, 2, 1)?;
    let refused = |shape, channel, window: &Window| {
        let (light, mut out) = (Image::F64(image.view()), Array3::zeros(shape));
        argument(expose(
            &sensor,
            light,
            SEED,
            channel,
            window,
            out.view_mut(),
        ))
    };
    let all = whole(&image, 1);
    for shape in [(1, 8, 1), (1, 4, 2), (2, 8, 2)] {
        assert_eq!(refused(shape, 0, &all), "out");
    }
    assert_eq!(refused((1, 8, 2), 128, &all), "channel");
    for (frames, rows, columns, expected) in [
        (0..1, 0..5, 0..5, "window rows"),
        (0..1, 0..4, 4..6, "window columns"),
        (1 << 32..(1 << 32) + 1, 0..4, 0..5, "frames"),
    ] {
        let window = Window {
            frames,
            rows,
            columns,
        };
        assert_eq!(refused((1, 8, 2), 0, &window), expected);
    }
    Ok(())
}

#[test]
fn maps_of_the_wrong_shape_are_errors() -> Result<()> {
    let (dead, dark) = (Array2::from_elem((8, 9), false), Array2::zeros((4, 5)));
    let image = test_image(4, 5);
    let light = Image::F64(image.view());
    let plain = sensor(1, 2, 1)?;
    let masked = Sensor {
        dead: Some(dead.view()),
        ..plain.clone()
    };
    let with_dark_counts = Sensor {
        dark_counts: PerJot::Map(dark.view()),
        ..plain.clone()
    };
    let all = whole(&image, 1);
    let mut out = Array2::zeros((8, 10));
    for (sensor, expected) in [(&masked, "mask"), (&with_dark_counts, "dark counts")] {
        let mut bits = Array3::zeros((1, 8, 2));
        let exposed = expose(sensor, light, SEED, 0, &all, bits.view_mut());
        assert_eq!(argument(exposed), expected);
        assert_eq!(argument(rate(sensor, light, 0, out.view_mut())), expected);
        let probabilities = probability(sensor, light, 0, out.view_mut());
        assert_eq!(argument(probabilities), expected);
    }
    let mut small = Array2::zeros((4, 5));
    assert_eq!(argument(rate(&plain, light, 0, small.view_mut())), "out");
    let empty = Array2::<f32>::zeros((0, 5));
    let light = Image::F32(empty.view());
    assert_eq!(argument(rate(&plain, light, 0, out.view_mut())), "image");
    Ok(())
}

#[test]
fn invalid_kernels_are_errors() {
    for (degree, oversampling, expected) in [(4, 2, "kernel degree"), (0, 0, "oversampling")] {
        let kernel = Kernel::new(degree, oversampling);
        assert_eq!(argument(kernel.map(|_| ())), expected);
    }
}
