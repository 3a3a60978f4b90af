//! Comparisons of counts along a motion with counts of one bit after the other.

use jotlight::bits::{PackedBits, packed_width};
use jotlight::error::{Error, Result};
use jotlight::motion::{BLOCK, Displacements, ShiftedCounts, count_shifted};
use ndarray::{Array2, Array3, ArrayView2, Axis, stack};

use crate::random::Random;
use crate::{fields_of_other_sizes, on_every_level};

/// The sums along a motion.
struct Sums {
    ones: Array2<i32>,
    trials: Array2<i32>,
    remainders: Array3<f32>,
}

impl Sums {
    fn new(rows: usize, columns: usize) -> Self {
        Self {
            ones: Array2::zeros((rows, columns)),
            trials: Array2::zeros((rows, columns)),
            remainders: Array3::zeros((rows, 2, columns.div_ceil(BLOCK))),
        }
    }

    fn add(
        &mut self,
        bytes: &Array3<u8>,
        fields: &[&Array3<f32>],
        tile: Option<usize>,
        times: &[f64],
        valid: Option<ArrayView2<'_, u8>>,
    ) -> Result<()> {
        let (rows, columns) = self.ones.dim();
        let views: Vec<_> = fields.iter().map(|field| field.view()).collect();
        let Ok(fields) = stack(Axis(0), &views) else {
            unreachable!("fields of several shapes");
        };
        let sums = ShiftedCounts {
            ones: self.ones.view_mut(),
            trials: self.trials.view_mut(),
            remainders: self.remainders.view_mut(),
        };
        let bits = PackedBits::new(bytes.view(), columns)?;
        let motion = Displacements::new(fields.view(), tile, rows, columns)?;
        count_shifted(&bits, &motion, times, valid, sums)
    }
}

fn bit(bytes: &[u8], column: usize) -> i32 {
    i32::from(bytes[column / 8] >> (7 - column % 8) & 1)
}

/// Return the ones and the trials of displacements that are the same in all frames.
fn naive(
    bytes: &Array3<u8>,
    displacements: &Array3<f32>,
    valid: Option<&Array2<u8>>,
) -> [Array2<i32>; 2] {
    let (frames, height, _) = bytes.dim();
    let (_, rows, columns) = displacements.dim();
    let mut sums = [(); 2].map(|()| Array2::zeros((rows, columns)));
    for frame in 0..frames {
        for row in 0..rows {
            for column in 0..columns {
                let shift = |direction| displacements[[direction, row, column]].round_ties_even();
                let y = row as i64 + shift(0) as i64;
                let x = column as i64 + shift(1) as i64;
                if y < 0 || x < 0 || y >= height as i64 || x >= columns as i64 {
                    continue;
                }
                let (y, x) = (y as usize, x as usize);
                let counted = valid.map_or(1, |valid| bit(&valid.row(y).to_vec(), x));
                let source: Vec<u8> = bytes.slice(ndarray::s![frame, y, ..]).to_vec();
                sums[0][[row, column]] += counted * bit(&source, x);
                sums[1][[row, column]] += counted;
            }
        }
    }
    sums
}

#[test]
fn counts_are_those_of_single_bits_on_every_level() -> Result<()> {
    let mut random = Random(1);
    for (frames, rows, columns, scale) in [
        (1, 3, 5, 2.0),
        (9, 20, 64, 0.4),
        (17, 33, 130, 30.0),
        (8, 5, 257, 200.0),
    ] {
        let bytes =
            Array3::from_shape_simple_fn((frames, rows, packed_width(columns)), || random.byte());
        let valid = Array2::from_shape_simple_fn((rows, packed_width(columns)), || random.byte());
        let smooth = [random.number() as f32, random.number() as f32];
        let displacements = Array3::from_shape_fn((2, rows, columns), |(direction, _, column)| {
            scale * (smooth[direction] + 0.01 * column as f32) + 0.6 * random.number() as f32
        });
        let times = vec![0.25; frames];
        let fields = &[&displacements; 2];
        for mask in [None, Some(&valid)] {
            let expected = naive(&bytes, &displacements, mask);
            on_every_level(|_| {
                let mut sums = Sums::new(rows, columns);
                sums.add(&bytes, fields, None, &times, mask.map(|mask| mask.view()))?;
                assert_eq!(sums.ones, expected[0]);
                assert_eq!(sums.trials, expected[1]);
                Ok(())
            })?;
        }
    }
    Ok(())
}

#[test]
fn smooth_displacements_are_those_of_single_bits_on_every_level() -> Result<()> {
    let mut random = Random(3);
    for (frames, columns, slope) in [
        (1, 16, 0.05),
        (7, 127, 0.05),
        (8, 128, 0.003),
        (9, 129, -0.2),
        (16, 256, 0.06),
        (17, 300, 0.02),
    ] {
        let rows = 19;
        let bytes =
            Array3::from_shape_simple_fn((frames, rows, packed_width(columns)), || random.byte());
        let start = [random.number() as f32, random.number() as f32];
        // Rows and columns change at different pixels, and at the same ones in the last row.
        let displacements =
            Array3::from_shape_fn((2, rows, columns), |(direction, row, column)| {
                let slope = if row == rows - 1 || direction == 0 {
                    slope
                } else {
                    -0.7 * slope
                };
                5.0 * start[direction] + slope * column as f32 + 0.1 * row as f32
            });
        let expected = naive(&bytes, &displacements, None);
        on_every_level(|_| {
            let mut sums = Sums::new(rows, columns);
            sums.add(&bytes, &[&displacements; 2], None, &vec![0.5; frames], None)?;
            assert_eq!(sums.ones, expected[0]);
            assert_eq!(sums.trials, expected[1]);
            Ok(())
        })?;
    }
    Ok(())
}

#[test]
fn tiles_are_interpolated_and_remainders_are_means() -> Result<()> {
    // Displacements rise by 1/8 pixel per column, and do not depend on the row.
    let (rows, columns, tile) = (6, 32, 16);
    let nodes = Array3::from_shape_fn((2, 1, 2), |(direction, _, column)| {
        if direction == 1 {
            (7.5 + 16.0 * column as f32) / 8.0
        } else {
            0.0
        }
    });
    let pixels = Array3::from_shape_fn((2, rows, columns), |(direction, _, column)| {
        if direction == 1 {
            column as f32 / 8.0
        } else {
            0.0
        }
    });
    let mut random = Random(2);
    let bytes = Array3::from_shape_simple_fn((10, rows, 4), || random.byte());
    let expected = naive(&bytes, &pixels, None);
    on_every_level(|_| {
        let mut sums = Sums::new(rows, columns);
        sums.add(&bytes, &[&nodes; 2], Some(tile), &[0.0; 10], None)?;
        assert_eq!(sums.ones, expected[0]);
        assert_eq!(sums.trials, expected[1]);
        for block in 0..2 {
            let remainder = |column: usize| {
                let displacement = column as f32 / 8.0;
                displacement.round_ties_even() - displacement
            };
            let mean: f32 = (16 * block..16 * block + 16).map(remainder).sum::<f32>() / 16.0;
            assert!((sums.remainders[[3, 1, block]] - 10.0 * mean).abs() < 1e-4);
            assert!(sums.remainders[[3, 0, block]].abs() < 1e-4);
        }
        Ok(())
    })
}

#[test]
fn empty_bursts_and_images_change_nothing() -> Result<()> {
    for (frames, rows, columns) in [(0, 3, 5), (2, 0, 5), (2, 3, 0)] {
        let bytes = Array3::zeros((frames, rows, packed_width(columns)));
        let field = Array3::zeros((2, rows, columns));
        let mut sums = Sums::new(rows, columns);
        sums.add(&bytes, &[&field; 2], None, &vec![0.0; frames], None)?;
        assert_eq!(sums.trials.sum(), 0);
    }
    Ok(())
}

#[test]
fn displacements_of_images_of_another_size_are_errors() -> Result<()> {
    let bytes = Array3::zeros((2, 20, packed_width(30)));
    let bits = PackedBits::new(bytes.view(), 30)?;
    for (fields, tile, [rows, columns]) in fields_of_other_sizes() {
        let motion = Displacements::new(fields.view(), tile, rows, columns)?;
        let mut sums = Sums::new(20, 30);
        let counts = ShiftedCounts {
            ones: sums.ones.view_mut(),
            trials: sums.trials.view_mut(),
            remainders: sums.remainders.view_mut(),
        };
        let found = count_shifted(&bits, &motion, &[0.0; 2], None, counts);
        assert!(matches!(found, Err(Error::Shape { .. })));
    }
    Ok(())
}

#[test]
fn fields_and_times_that_do_not_fit_are_errors() {
    let bytes = Array3::zeros((2, 3, 1));
    let mut sums = Sums::new(3, 5);
    let field = Array3::zeros((2, 3, 5));
    let mut add =
        |fields: &[&Array3<f32>], tile, times: &[f64]| sums.add(&bytes, fields, tile, times, None);
    let (small, infinite) = (
        Array3::zeros((2, 3, 4)),
        Array3::from_elem((2, 3, 5), f32::INFINITY),
    );
    for (result, is_shape) in [
        (add(&[&field; 2], None, &[0.0]), true),
        (add(&[&small; 2], None, &[0.0; 2]), true),
        (add(&[&field; 2], Some(1), &[0.0, f64::NAN]), false),
        (add(&[&infinite, &field], None, &[0.0; 2]), false),
        (add(&[&field; 2], Some(0), &[0.0; 2]), false),
    ] {
        match result {
            Err(Error::Shape { .. }) => assert!(is_shape),
            Err(Error::Range { .. }) => assert!(!is_shape),
            Err(other) => unreachable!("{other}"),
            Ok(()) => unreachable!("no error"),
        }
    }
}
