//! Comparisons of transposed, reversed, and listed bits with one jot after the other.

use std::collections::BTreeSet;

use jotlight::bits::{PackedBits, packed_width, reverse_bytes, set_positions, transpose};
use jotlight::error::{Error, Result};
use jotlight::threads;
use ndarray::{Array2, Array3, s};

use crate::on_every_level;
use crate::random::random_bits;

fn naive_transpose(bytes: &Array3<u8>, width: usize) -> Array3<u8> {
    let (frames, rows, _) = bytes.dim();
    let mut transposed = Array3::zeros((frames, width, packed_width(rows)));
    for frame in 0..frames {
        for row in 0..rows {
            for column in 0..width {
                let bit = bytes[[frame, row, column / 8]] >> (7 - column % 8) & 1;
                transposed[[frame, column, row / 8]] |= bit << (7 - row % 8);
            }
        }
    }
    transposed
}

#[test]
fn bits_of_any_size_are_transposed() -> Result<()> {
    on_every_level(|_| {
        for (frames, rows, width) in [
            (1, 1, 1),
            (2, 5, 13),
            (3, 64, 64),
            (1, 65, 63),
            (2, 7, 300),
            (1, 300, 7),
            (1, 257, 129),
            (2, 0, 9),
            (2, 9, 0),
            (0, 3, 3),
        ] {
            let bytes = random_bits(frames, rows, width);
            let bits = PackedBits::new(bytes.view(), width)?;
            // The old content does not matter.
            let mut transposed = Array3::from_elem((frames, width, packed_width(rows)), 0xa5);
            transpose(&bits, transposed.view_mut())?;
            assert_eq!(
                transposed,
                naive_transpose(&bytes, width),
                "{rows} x {width}"
            );
        }
        Ok(())
    })
}

#[test]
fn transposing_does_not_depend_on_threads_or_on_the_order_in_memory() -> Result<()> {
    let bytes = random_bits(10, 40, 100);
    let strided = bytes.slice(s![..;2, ..;-1, ..]);
    let expected = naive_transpose(&strided.to_owned(), 100);
    for threads in [1, 2, 5] {
        let mut storage = Array3::zeros((5, 100, 10));
        let view = storage.slice_mut(s![.., ..;-1, ..;2]);
        threads::install(Some(threads), || {
            transpose(&PackedBits::new(strided, 100)?, view)
        })??;
        assert_eq!(storage.slice(s![.., ..;-1, ..;2]), expected);
    }
    Ok(())
}

#[test]
fn a_wrong_shape_is_refused() -> Result<()> {
    let bytes = random_bits(2, 5, 13);
    let bits = PackedBits::new(bytes.view(), 13)?;
    let mut transposed = Array3::zeros((2, 13, 2));
    let result = transpose(&bits, transposed.view_mut());
    assert!(matches!(result, Err(Error::Shape { .. })));
    Ok(())
}

#[test]
fn the_bits_of_each_byte_are_reversed() {
    let bytes = random_bits(1, 3, 1 << 19).flatten().to_owned();
    let expected =
        bytes.map(|byte| (0..8).fold(0, |sum, bit| sum | (byte >> bit & 1) << (7 - bit)));
    let mut reversed = bytes.clone();
    reverse_bytes(reversed.view_mut());
    assert_eq!(reversed, expected);
    let mut strided = bytes.clone();
    reverse_bytes(strided.slice_mut(s![..;-3]));
    for (index, (&byte, &before)) in strided.iter().zip(&bytes).enumerate() {
        let is_reversed = (bytes.len() - 1 - index).is_multiple_of(3);
        assert_eq!(byte, if is_reversed { expected[index] } else { before });
    }
}

#[test]
fn listed_positions_become_bits_of_their_frames() -> Result<()> {
    let end = 24;
    let listed = [&[23, 0, 5][..], &[], &[7, 7], &[1, 22]];
    let list: Vec<u32> = listed
        .iter()
        .flat_map(|frame| frame.iter().copied().chain([end]))
        .collect();
    for first in [-3, -1, 0, 2, 9] {
        // The parts of a list have the same result as the list.
        for cut in 0..=list.len() {
            let mut packed = Array2::zeros((2, 3));
            let next = set_positions(&list[..cut], first, packed.view_mut())?;
            assert_eq!(
                set_positions(&list[cut..], next, packed.view_mut())?,
                first + 4
            );
            for row in 0..2_i64 {
                let frame = usize::try_from(row - first).ok();
                let wanted = frame.and_then(|frame| listed.get(frame)).copied();
                let wanted: BTreeSet<u32> = wanted.unwrap_or_default().iter().copied().collect();
                let bits: BTreeSet<u32> = (0..end)
                    .filter(|&bit| {
                        packed[[row as usize, bit as usize / 8]] >> (7 - bit % 8) & 1 == 1
                    })
                    .collect();
                assert_eq!(bits, wanted);
            }
        }
    }
    Ok(())
}

#[test]
fn a_position_outside_of_the_frame_is_refused() {
    let mut packed = Array2::zeros((2, 3));
    for list in [&[25][..], &[3, 24, u32::MAX, 24]] {
        let result = set_positions(list, 0, packed.view_mut());
        assert!(matches!(result, Err(Error::Range { .. })));
    }
    let nothing = set_positions(&[], 7, Array2::zeros((0, 0)).view_mut());
    assert_eq!(nothing, Ok(7));
}
