//! Comparisons of sums of values of the jots along a motion with counts of equal bits.

use jotlight::bits::{PackedBits, packed_width};
use jotlight::error::{Error, Result};
use jotlight::motion::{BLOCK, Displacements, ShiftedCounts, add_shifted_values, count_shifted};
use ndarray::{Array2, Array3, Array4};

use crate::random::Random;
use crate::{fields_of_other_sizes, on_every_level};

/// Two maps of zeros and ones, and the bits of frames that are equal to the first one.
fn equal_bits(random: &mut Random, (frames, rows, columns): (usize, usize, usize)) -> Case {
    let mut values = Array3::ones((2, rows, columns));
    let mut bytes = Array3::<u8>::zeros((frames, rows, packed_width(columns)));
    for row in 0..rows {
        for column in 0..columns {
            let bit = random.byte() & 1;
            values[[0, row, column]] = f32::from(bit);
            for frame in 0..frames {
                bytes[[frame, row, column / 8]] |= bit << (7 - column % 8);
            }
        }
    }
    Case { values, bytes }
}

struct Case {
    values: Array3<f32>,
    bytes: Array3<u8>,
}

#[test]
fn sums_of_values_are_counts_of_equal_bits() -> Result<()> {
    let mut random = Random(1);
    for ((rows, columns), tile, scale) in [
        ((20, 64), Some(16), 0.0),
        ((19, 130), Some(16), 3.0),
        ((33, 70), None, 2.0),
        ((5, 257), Some(8), 300.0),
    ] {
        let frames = 12;
        let Case { values, bytes } = equal_bits(&mut random, (frames, rows, columns));
        let tiles = |length: usize| tile.map_or(length, |tile| length.div_ceil(tile));
        let fields = Array4::from_shape_simple_fn((3, 2, tiles(rows), tiles(columns)), || {
            scale * random.number() as f32
        });
        let motion = Displacements::new(fields.view(), tile, rows, columns)?;
        let times: Vec<f64> = (0..frames).map(|frame| 0.2 * frame as f64 - 0.1).collect();
        let (mut ones, mut trials) = (
            Array2::zeros((rows, columns)),
            Array2::zeros((rows, columns)),
        );
        let mut remainders = Array3::zeros((rows, 2, columns.div_ceil(BLOCK)));
        let counts = ShiftedCounts {
            ones: ones.view_mut(),
            trials: trials.view_mut(),
            remainders: remainders.view_mut(),
        };
        let bits = PackedBits::new(bytes.view(), columns)?;
        count_shifted(&bits, &motion, &times, None, counts)?;
        on_every_level(|_| {
            let mut sums = Array3::zeros((2, rows, columns));
            add_shifted_values(values.view(), &motion, &times, sums.view_mut())?;
            let whole = sums.mapv(|value: f32| value as i32);
            assert_eq!(whole.index_axis(ndarray::Axis(0), 0), ones);
            assert_eq!(whole.index_axis(ndarray::Axis(0), 1), trials);
            // Other memory layouts have the same sums.
            let mut transposed = Array3::zeros((columns, rows, 2)).reversed_axes();
            let reversed = values.t().as_standard_layout().into_owned();
            add_shifted_values(reversed.t(), &motion, &times, transposed.view_mut())?;
            assert_eq!(transposed, sums);
            Ok(())
        })?;
    }
    Ok(())
}

#[test]
fn wrong_arguments_are_refused() -> Result<()> {
    let (values, fields) = (Array3::zeros((2, 20, 30)), Array4::zeros((2, 2, 2, 2)));
    let motion = Displacements::new(fields.view(), Some(16), 20, 30)?;
    let mut sums = Array3::zeros((2, 20, 30));
    for time in [-1.5, 2.5, f64::NAN] {
        let found = add_shifted_values(values.view(), &motion, &[time], sums.view_mut());
        assert!(found.is_err());
    }
    for (fields, tile, [rows, columns]) in fields_of_other_sizes() {
        let other = Displacements::new(fields.view(), tile, rows, columns)?;
        let found = add_shifted_values(values.view(), &other, &[0.0], sums.view_mut());
        assert!(matches!(found, Err(Error::Shape { .. })));
    }
    for shape in [(1, 20, 30), (2, 21, 30), (2, 20, 29)] {
        let mut sums = Array3::zeros(shape);
        let found = add_shifted_values(values.view(), &motion, &[0.0], sums.view_mut());
        assert!(found.is_err());
    }
    Ok(())
}
