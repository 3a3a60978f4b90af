//! From light to bits, without Python.

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

fn scene(height: usize, width: usize) -> Array2<f64> {
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
    let side = sensor.kernel.oversampling();
    let mut out = Array3::from_elem(
        (
            window.frames.len(),
            window.rows.len() * side,
            packed_width(window.columns.len() * side),
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
    let image = scene(23, 31);
    for degree in 0..=3 {
        let sensor = sensor(degree, 3, 2)?;
        let on = |threads| threads::install(threads, || draw(&sensor, &image, &whole(&image, 3)))?;
        let one = on(Some(1))?;
        for threads in [Some(2), Some(3), Some(7), None] {
            assert_eq!(on(threads)?, one, "degree {degree}, threads {threads:?}");
        }
    }
    Ok(())
}

#[test]
fn a_window_holds_what_the_whole_holds_there() -> Result<()> {
    for (degree, side, width) in [(0, 1, 5000), (0, 7, 700), (1, 3, 40), (3, 5, 900)] {
        let image = scene(4, width);
        let sensor = sensor(degree, side, 1)?;
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
            let jots = window.columns.len() * side;
            for frame in 0..frames {
                for row in 0..rows {
                    for column in 0..8 * bytes {
                        let expected = if column < jots {
                            let column = window.columns.start * side + column;
                            let row = window.rows.start * side + row;
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
fn every_channel_frame_and_row_has_draws_of_its_own() -> Result<()> {
    let (sensor, image) = (sensor(0, 2, 1)?, Array2::from_elem((3, 40), 0.5));
    let mut seen = Vec::new();
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
            assert!(!seen.contains(&row.to_vec()), "channel {channel}");
            seen.push(row.to_vec());
        }
    }
    Ok(())
}

#[test]
fn the_rate_of_a_jot_is_the_light_of_the_pixels_around() -> Result<()> {
    let image = scene(5, 6);
    for degree in 0..=3 {
        for side in 1..=4 {
            let sensor = sensor(degree, side, 1)?;
            let mut rates = Array2::zeros((5 * side, 6 * side));
            rate(&sensor, Image::F64(image.view()), 0, rates.view_mut())?;
            let taps = sensor.kernel.taps();
            let reach = (degree * side / 2) as isize;
            // How much of pixel `pixel` falls on jot `jot`, and where the scene goes on past the
            // rim.
            let share = |jot: usize, pixel: isize| {
                let place = jot as isize + reach - pixel * side as isize;
                usize::try_from(place)
                    .ok()
                    .and_then(|place| taps.get(place))
                    .unwrap_or(&0.0)
            };
            let inside = |pixel: isize, size: isize| match pixel {
                ..0 => (-1 - pixel) as usize,
                _ if pixel >= size => (2 * size - 1 - pixel) as usize,
                _ => pixel as usize,
            };
            for ((row, column), &value) in rates.indexed_iter() {
                let mut light = 0.0;
                for y in -3..8 {
                    for x in -3..9 {
                        light +=
                            share(row, y) * share(column, x) * image[[inside(y, 5), inside(x, 6)]];
                    }
                }
                let expected = 0.9 * sensor.gain_per_frame * light + 0.02;
                assert!(
                    (f64::from(value) - expected).abs() < 1e-6 * expected,
                    "degree {degree}, side {side}, jot {row}, {column}: {value} for {expected}"
                );
            }
        }
    }
    Ok(())
}

#[test]
fn jots_fire_as_often_as_their_probability_and_dead_ones_never() -> Result<()> {
    let image = scene(6, 9);
    let dead = Array2::from_shape_fn((18, 27), |(row, column)| (row + column) % 5 == 0);
    let dark = Array2::from_shape_fn((18, 27), |(row, _)| 0.01 * row as f32);
    for (degree, q) in [(0, 1), (0, 3), (2, 2)] {
        let sensor = Sensor {
            dead: Some(dead.view()),
            dark_counts: PerJot::Map(dark.view()),
            ..sensor(degree, 3, q)?
        };
        let mut chance = Array2::zeros((18, 27));
        probability(&sensor, Image::F64(image.view()), 0, chance.view_mut())?;
        let frames = 4000;
        let bits = draw(&sensor, &image, &whole(&image, frames))?;
        for ((row, column), &chance) in chance.indexed_iter() {
            let fired: i32 = (0..frames)
                .map(|frame| i32::from(bit(&bits, frame, row, column)))
                .sum();
            if dead[[row, column]] {
                assert_eq!((fired, chance.to_bits()), (0, 0));
            } else {
                // Past 6.5 standard deviations and a bit for the skew: less than once in 10⁶ seeds.
                let (mean, frames) = (frames as f64 * f64::from(chance), frames as f64);
                let deviation = (mean * (1.0 - mean / frames)).sqrt();
                assert!((f64::from(fired) - mean).abs() < 6.5 * deviation + 6.0);
            }
        }
    }
    Ok(())
}

fn what(result: Result<()>) -> &'static str {
    match result {
        Err(Error::Shape { what, .. } | Error::Range { what, .. }) => what,
        _ => "no error of shape or range",
    }
}

#[test]
fn what_does_not_fit_is_an_error() -> Result<()> {
    let (dead, dark) = (Array2::from_elem((8, 9), false), Array2::zeros((4, 5)));
    let image = scene(4, 5);
    let light = Image::F64(image.view());
    let plain = sensor(1, 2, 1)?;
    let try_out = |sensor: &Sensor<'_>, shape, channel, window: &Window| {
        let mut out = Array3::zeros(shape);
        what(expose(sensor, light, SEED, channel, window, out.view_mut()))
    };
    let all = whole(&image, 1);
    for shape in [(1, 8, 1), (1, 4, 2), (2, 8, 2)] {
        assert_eq!(try_out(&plain, shape, 0, &all), "out");
    }
    assert_eq!(try_out(&plain, (1, 8, 2), 128, &all), "channel");
    for (window, expected) in [
        (
            Window {
                rows: 0..5,
                ..all.clone()
            },
            "window rows",
        ),
        (
            Window {
                columns: 4..6,
                ..all.clone()
            },
            "window columns",
        ),
        (
            Window {
                frames: 1 << 32..(1 << 32) + 1,
                ..all.clone()
            },
            "frames",
        ),
    ] {
        assert_eq!(try_out(&plain, (1, 8, 2), 0, &window), expected);
    }

    let mut out = Array2::zeros((8, 10));
    let masked = Sensor {
        dead: Some(dead.view()),
        ..plain.clone()
    };
    let dim = Sensor {
        dark_counts: PerJot::Map(dark.view()),
        ..plain.clone()
    };
    assert_eq!(try_out(&masked, (1, 8, 2), 0, &all), "mask");
    assert_eq!(try_out(&dim, (1, 8, 2), 0, &all), "dark counts");
    assert_eq!(what(rate(&masked, light, 0, out.view_mut())), "mask");
    assert_eq!(
        what(probability(&dim, light, 0, out.view_mut())),
        "dark counts"
    );
    let mut small = Array2::zeros((4, 5));
    assert_eq!(what(rate(&plain, light, 0, small.view_mut())), "out");
    let empty = Array2::<f32>::zeros((0, 5));
    assert_eq!(
        what(rate(&plain, Image::F32(empty.view()), 0, out.view_mut())),
        "image"
    );
    assert_eq!(what(Kernel::new(4, 2).map(|_| ())), "kernel degree");
    assert_eq!(what(Kernel::new(0, 0).map(|_| ())), "oversampling");
    Ok(())
}
