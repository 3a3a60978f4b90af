//! Comparisons of counts of packed bits with counts of one jot after the other.

use jotlight::bits::{PackedBits, add_block_counts, packed_width};
use jotlight::error::{Error, Result};
use jotlight::threads;
use ndarray::{Array2, Array3, Axis, s};

use crate::on_every_level;
use crate::random::random_bits;

fn naive_counts(
    bytes: &Array3<u8>,
    width: usize,
    oversampling: usize,
    valid: impl Fn(usize, usize) -> bool,
) -> Array2<i32> {
    let (frames, rows, _) = bytes.dim();
    let mut counts = Array2::zeros((rows / oversampling, width / oversampling));
    for frame in 0..frames {
        for row in 0..rows {
            for column in 0..width {
                let bit = bytes[[frame, row, column / 8]] >> (7 - column % 8) & 1;
                if valid(row, column) {
                    counts[[row / oversampling, column / oversampling]] += i32::from(bit);
                }
            }
        }
    }
    counts
}

#[test]
fn counts_are_right_for_any_number_of_frames() -> Result<()> {
    for frames in (1..=40).chain([63, 64, 65, 255, 256, 257, 1000]) {
        for (oversampling, rows, width) in
            [(1, 5, 77), (1, 3, 64), (2, 4, 22), (3, 9, 33), (8, 8, 72)]
        {
            let bytes = random_bits(frames, rows, width);
            let bits = PackedBits::new(bytes.view(), width)?;
            let mut counts = Array2::zeros((rows / oversampling, width / oversampling));
            add_block_counts(&bits, oversampling, None, counts.view_mut())?;
            let expected = naive_counts(&bytes, width, oversampling, |_, _| true);
            assert_eq!(
                counts, expected,
                "{frames} frames, oversampling {oversampling}"
            );

            // These frames are not contiguous in memory.
            let strided = PackedBits::new(bytes.slice(s![..;2, .., ..]), width)?;
            let half = bytes.slice(s![..;2, .., ..]).to_owned();
            counts.fill(0);
            add_block_counts(&strided, oversampling, None, counts.view_mut())?;
            assert_eq!(
                counts,
                naive_counts(&half, width, oversampling, |_, _| true)
            );
        }
    }
    Ok(())
}

#[test]
fn counts_are_right_for_any_oversampling_and_mask() -> Result<()> {
    for oversampling in [1, 2, 3, 7, 8, 9, 57, 58, 64, 70, 120] {
        let (rows, width) = (2 * oversampling, 3 * oversampling);
        let bytes = random_bits(3, rows, width);
        let bits = PackedBits::new(bytes.view(), width)?;
        let mut counts = Array2::zeros((2, 3));
        add_block_counts(&bits, oversampling, None, counts.view_mut())?;
        assert_eq!(
            counts,
            naive_counts(&bytes, width, oversampling, |_, _| true),
            "oversampling {oversampling}"
        );

        let mask = random_bits(1, rows, width + 1);
        let mask = mask.slice(s![0, .., ..packed_width(width)]);
        let is_valid =
            |row: usize, column: usize| mask[[row, column / 8]] >> (7 - column % 8) & 1 == 1;
        counts.fill(0);
        add_block_counts(&bits, oversampling, Some(mask), counts.view_mut())?;
        assert_eq!(
            counts,
            naive_counts(&bytes, width, oversampling, is_valid),
            "oversampling {oversampling}, masked"
        );
    }
    Ok(())
}

#[test]
fn pixels_of_many_jots_are_counted_in_parts() -> Result<()> {
    let bytes = random_bits(17, 96, 19_200);
    let bits = PackedBits::new(bytes.view(), 19_200)?;
    let mut counts = Array2::zeros((2, 400));
    add_block_counts(&bits, 48, None, counts.view_mut())?;
    assert_eq!(counts, naive_counts(&bytes, 19_200, 48, |_, _| true));
    Ok(())
}

#[test]
fn counts_of_parts_add_up_for_every_instruction_set() -> Result<()> {
    let frames = 3001;
    for (rows, width) in [(3, 77), (2, 64), (1, 200)] {
        let mut bytes = random_bits(frames, rows, width);
        // The first jots are always one, so all their digits carry.
        bytes.slice_mut(s![.., .., ..2]).fill(0xff);
        let expected = naive_counts(&bytes, width, 1, |_, _| true);
        on_every_level(|level| {
            for part in [1, 16, 23, 247, 1024, frames] {
                let mut counts = Array2::zeros((rows, width));
                for part in bytes.axis_chunks_iter(Axis(0), part) {
                    let bits = PackedBits::new(part, width)?;
                    add_block_counts(&bits, 1, None, counts.view_mut())?;
                }
                assert_eq!(counts, expected, "{level:?}, parts of {part} frames");
            }
            Ok(())
        })?;
    }
    Ok(())
}

#[test]
fn counts_are_added_to_the_previous_ones() -> Result<()> {
    for oversampling in [1, 4] {
        let bytes = Array3::from_elem((300, 40, 2), 0xff);
        let bits = PackedBits::new(bytes.view(), 12)?;
        let mut counts = Array2::from_elem((40 / oversampling, 12 / oversampling), 1000);
        add_block_counts(&bits, oversampling, None, counts.view_mut())?;
        let all = 1000 + 300 * (oversampling * oversampling) as i32;
        assert!(
            counts.iter().all(|&count| count == all),
            "oversampling {oversampling}"
        );
    }
    Ok(())
}

#[test]
fn counts_do_not_depend_on_layout_or_threads() -> Result<()> {
    let bytes = random_bits(20, 66, 30);
    let expected = [1, 6].map(|oversampling| naive_counts(&bytes, 30, oversampling, |_, _| true));
    let mut reversed = bytes.clone();
    reversed.invert_axis(ndarray::Axis(0));
    let fortran = bytes
        .clone()
        .reversed_axes()
        .as_standard_layout()
        .to_owned();
    for view in [bytes.view(), reversed.view(), fortran.t()] {
        for threads in [Some(1), Some(2), Some(3), None] {
            for (oversampling, expected) in [1, 6].into_iter().zip(&expected) {
                let mut counts = Array2::zeros(expected.dim());
                threads::install(threads, || {
                    add_block_counts(
                        &PackedBits::new(view, 30)?,
                        oversampling,
                        None,
                        counts.view_mut(),
                    )
                })??;
                assert_eq!(
                    &counts, expected,
                    "oversampling {oversampling}, threads {threads:?}"
                );
            }
        }
    }
    Ok(())
}

#[test]
fn invalid_arguments_are_errors() -> Result<()> {
    let bytes = random_bits(2, 6, 12);
    let name = |error: Result<()>| match error {
        Err(Error::Shape { what, .. } | Error::Range { what, .. }) => what,
        other => {
            assert!(other.is_err(), "no error");
            "another error"
        }
    };
    for width in [8, 17] {
        assert_eq!(
            name(PackedBits::new(bytes.view(), width).map(|_| ())),
            "bytes in a packed row"
        );
    }
    let bits = PackedBits::new(bytes.view(), 12)?;
    let mask = Array2::<u8>::zeros((6, 1));
    let mut counts = Array2::zeros((3, 6));
    let mut add = |oversampling, mask| {
        name(add_block_counts(
            &bits,
            oversampling,
            mask,
            counts.view_mut(),
        ))
    };
    assert_eq!(add(0, None), "oversampling");
    assert_eq!(add(5, None), "rows and columns of jots");
    assert_eq!(add(3, None), "counts");
    assert_eq!(add(2, Some(mask.view())), "packed mask");
    assert_eq!(
        threads::install(Some(0), || ()).map_err(|error| error.to_string()),
        Err("threads: expected at least 1 and at most 1024, got 0".into())
    );
    Ok(())
}
