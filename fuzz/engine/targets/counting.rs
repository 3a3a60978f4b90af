//! Counts of packed bits.

use jotlight::bits::{PackedBits, add_block_counts, packed_width};
use ndarray::Ix3;

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;

pub const CHECKS: &[(&str, Check)] = &[
    ("PackedBits", check_packed_bits),
    ("add_block_counts", check_add_block_counts),
];

fn check_packed_bits(input: &mut Input<'_>) -> Option<()> {
    let shape = (input.size(), input.size(), input.size());
    let bytes = input.random_bytes(shape.0 * shape.1 * shape.2);
    let bytes = Grid::new(input, shape, bytes);
    let width = if input.rarely(2) {
        8 * shape.2
    } else {
        input.number()
    };
    let bits = PackedBits::new(bytes.view(), width);
    assert_eq!(bits.is_ok(), width.div_ceil(8) == shape.2);
    assert_eq!(bits.ok()?.shape(), (shape.0, shape.1, width));
    Some(())
}

fn check_add_block_counts(input: &mut Input<'_>) -> Option<()> {
    let side = input.size().min(9);
    let (height, width) = (input.size(), input.size());
    let frames = if input.rarely(4) {
        3 * input.size()
    } else {
        input.size().min(3)
    };
    let (rows, columns) = (height * side, width * side);
    let shape = (
        frames,
        input.almost(rows),
        packed_width(input.almost(columns)),
    );
    let bytes = input.random_bytes(shape.0 * shape.1 * shape.2);
    let packed = Grid::new(input, shape, bytes);
    let mask = input.rarely(3).then(|| {
        let shape = (rows, packed_width(columns));
        let bytes = input.random_bytes(shape.0 * shape.1);
        Grid::new(input, shape, bytes)
    });
    let oversampling = if input.rarely(16) {
        input.number()
    } else {
        side
    };
    let counts_shape = (input.almost(height), input.almost(width));
    let initial = input.counts(counts_shape.0 * counts_shape.1, 5);
    let counts = Grid::new(input, counts_shape, initial.clone());
    let result = consistent(|is_standard| {
        let (packed, mut counts) = (packed.arranged(is_standard), counts.arranged(is_standard));
        let mask = mask.as_ref().map(|mask| mask.arranged(is_standard));
        let bits = PackedBits::new(packed.view(), columns)?;
        let valid = mask.as_ref().map(Grid::view);
        add_block_counts(&bits, oversampling, valid, counts.view_mut())?;
        Ok(counts.values())
    });
    // The sizes of a valid call may differ from those that were chosen first.
    let (side, width) = (oversampling, counts_shape.1);
    let bytes = packed.view::<Ix3>();
    let expected = |pixel: usize| {
        let (row, column) = (pixel / width, pixel % width);
        let jots =
            (0..side * side).map(|jot| (row * side + jot / side, column * side + jot % side));
        let is_one = |bytes: u8, column: usize| i32::from(bytes >> (7 - column % 8) & 1);
        let ones = jots.map(|(row, column)| {
            let valid = mask.as_ref().map_or(1, |mask| {
                is_one(mask.view::<ndarray::Ix2>()[[row, column / 8]], column)
            });
            let frames = (0..frames).map(|frame| is_one(bytes[[frame, row, column / 8]], column));
            valid * frames.sum::<i32>()
        });
        initial[pixel] + ones.sum::<i32>()
    };
    for (pixel, count) in result?.into_iter().enumerate() {
        assert_eq!(count, expected(pixel), "pixel {pixel}");
    }
    Some(())
}
