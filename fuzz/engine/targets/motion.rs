//! Counts along a motion.

use jotlight::bits::{PackedBits, packed_width};
use jotlight::motion::{BLOCK, Displacements, ShiftedCounts, count_shifted};
use ndarray::{Array3, ArrayView2, ArrayView3, Axis, Ix2, Ix3, Ix4};

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;

pub const CHECKS: &[(&str, Check)] = &[("count_shifted", check_count_shifted)];

fn check_count_shifted(input: &mut Input<'_>) -> Option<()> {
    let (frames, rows) = (input.size(), input.size());
    // Wide images have several blocks of pixels that are searched together.
    let columns = input.size() * if input.rarely(2) { 16 } else { 1 };
    let shape = (
        input.almost(frames),
        input.almost(rows),
        packed_width(input.almost(columns)),
    );
    let bytes = input.random_bytes(shape.0 * shape.1 * shape.2);
    let packed = Grid::new(input, shape, bytes);
    let valid = input.rarely(3).then(|| {
        let shape = (input.almost(rows), packed_width(columns));
        let bytes = input.random_bytes(shape.0 * shape.1);
        Grid::new(input, shape, bytes)
    });
    let tile = match input.below(4) {
        0 => None,
        1 => Some(16),
        2 => Some(input.size()),
        _ => Some(input.number()),
    };
    let number = input.almost(2);
    let fields = draw_fields(input, number, tile, rows, columns);
    let times: Vec<f64> = if input.rarely(8) {
        input.floats(frames)
    } else {
        (0..frames)
            .map(|_| (input.random() % (32 * number as u64 + 33)) as f64 / 32.0 - 1.0)
            .collect()
    };
    let counts_shape = (input.almost(rows), input.almost(columns));
    // Earlier values are replaced.
    let pixels = counts_shape.0 * counts_shape.1;
    let initial = input.counts(pixels, 5);
    let counts = Grid::new(input, counts_shape, initial);
    let blocks = (input.almost(rows), 2, input.almost(columns.div_ceil(BLOCK)));
    let remainders = Grid::new(input, blocks, vec![0.0f32; blocks.0 * 2 * blocks.2]);
    let result = consistent(|is_standard| {
        let packed = packed.arranged(is_standard);
        let valid = valid.as_ref().map(|mask| mask.arranged(is_standard));
        let fields = fields.arranged(is_standard);
        let [mut ones, mut trials] = [(); 2].map(|()| counts.arranged(is_standard));
        let mut remainders = remainders.arranged(is_standard);
        let bits = PackedBits::new(packed.view(), columns)?;
        let motion = Displacements::new(fields.view(), tile, rows, columns)?;
        let sums = ShiftedCounts {
            ones: ones.view_mut(),
            trials: trials.view_mut(),
            remainders: remainders.view_mut(),
        };
        count_shifted(&bits, &motion, &times, valid.as_ref().map(Grid::view), sums)?;
        Ok(((ones.values(), trials.values()), remainders.values()))
    });
    let ((ones, trials), remainders) = result?;
    let largest = 0.6 * frames as f32 + 1.0;
    assert!(
        remainders
            .iter()
            .all(|remainder| remainder.abs() <= largest)
    );
    if tile.is_none() {
        let fields = fields.view::<Ix4>();
        let displacements = |time: f64| {
            let index = (time.max(0.0) as usize).min(number.saturating_sub(2));
            let [first, last] = [index, (index + 1).min(number - 1)]
                .map(|field| fields.index_axis(Axis(0), field).to_owned());
            let change = last - &first;
            first + change * (time - index as f64) as f32
        };
        let mask = valid.as_ref().map(|mask| mask.view::<Ix2>());
        let mut expected = [(); 2].map(|()| vec![0; pixels]);
        for (&time, frame) in times.iter().zip(packed.view::<Ix3>().outer_iter()) {
            add_slowly(frame, mask, &displacements(time), &mut expected);
        }
        assert_eq!([ones, trials], expected);
    }
    Some(())
}

/// Draw fields of one kind: small displacements, which may be smooth, or any ones.
fn draw_fields(
    input: &mut Input<'_>,
    number: usize,
    tile: Option<usize>,
    rows: usize,
    columns: usize,
) -> Grid<f32> {
    let tiles = |length: usize| tile.map_or(length, |tile| length.div_ceil(tile.max(1)));
    let (rows, columns) = (input.almost(tiles(rows)), input.almost(tiles(columns)));
    let shape = (number, 2, rows, columns);
    let length = number * 2 * rows * columns;
    let values: Vec<f32> = match input.below(8) {
        0 => input.floats(length).into_iter().map(|x| x as f32).collect(),
        1 => (0..length)
            .map(|_| (input.random() % 200_001) as f32 - 1e5)
            .collect(),
        2 | 3 => (0..length)
            .map(|_| (input.random() % 65) as f32 / 4.0 - 8.0)
            .collect(),
        _ => {
            let slopes =
                [input.below(17), input.below(17)].map(|slope| slope as f32 / 64.0 - 0.125);
            let start = input.below(33) as f32 / 4.0 - 4.0;
            // Each field is a multiple of the first one.
            let value = |(field, _, row, column)| {
                (1 + field) as f32 * (start + slopes[0] * row as f32 + slopes[1] * column as f32)
            };
            ndarray::indices(shape).into_iter().map(value).collect()
        }
    };
    Grid::new(input, shape, values)
}

/// Count the bits of a frame one after the other, given the displacements of all pixels.
fn add_slowly(
    frame: ArrayView2<'_, u8>,
    mask: Option<ArrayView2<'_, u8>>,
    displacements: &Array3<f32>,
    sums: &mut [Vec<i32>; 2],
) {
    let view: ArrayView3<'_, f32> = displacements.view();
    let (_, rows, columns) = view.dim();
    let bit = |bytes: ArrayView2<'_, u8>, row: usize, column: usize| {
        i32::from(bytes[[row, column / 8]] >> (7 - column % 8) & 1)
    };
    for row in 0..rows {
        for column in 0..columns {
            let from = |direction, position: usize| {
                let shift = view[[direction, row, column]].round_ties_even();
                usize::try_from(position as i64 + shift as i64).ok()
            };
            let (Some(y), Some(x)) = (from(0, row), from(1, column)) else {
                continue;
            };
            if y < rows && x < columns {
                let counted = mask.map_or(1, |mask| bit(mask, y, x));
                sums[0][row * columns + column] += counted * bit(frame, y, x);
                sums[1][row * columns + column] += counted;
            }
        }
    }
}
