//! Scores of velocities: known displacements, any number of threads, and wrong arguments.

use jotlight::bits::{Blocks, PackedBits, add_counts_of_blocks};
use jotlight::error::{Error, Result};
use jotlight::motion::{Peak, Windows, peak_of_shifted_scores, velocity_scores};
use jotlight::threads::install;
use ndarray::{Array2, Array3, ArrayView3, array};

use crate::random::Random;

const LINE: [f64; 9] = [-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0];

/// Return images of a texture that moves down by a pixel, and left by a half, in each block.
fn moving(blocks: usize, rows: usize, columns: usize) -> Array3<i32> {
    let mut random = Random(1);
    let texture =
        Array2::from_shape_simple_fn((2 * rows, 2 * columns), || random.below(100).cast_signed());
    // Pixels of the texture are half as wide, and a pixel of an image is the sum of four.
    Array3::from_shape_fn((blocks, rows, columns), |(block, row, column)| {
        let texel = |down, right| {
            let row = (2 * row + down + 2 * (rows - block)) % (2 * rows);
            let column = (2 * column + right + block) % (2 * columns);
            texture[(row, column)]
        };
        texel(0, 0) + texel(0, 1) + texel(1, 0) + texel(1, 1)
    })
}

fn windows(corners: &[(usize, usize)], size: (usize, usize)) -> Windows<'_> {
    Windows {
        corners,
        size,
        filters: (0.5, 6.0),
    }
}

fn scores(blocks: ArrayView3<'_, i32>, threads: usize) -> Result<Array3<f32>> {
    let corners = [(0, 0), (5, 3)];
    install(Some(threads), || {
        velocity_scores(blocks, windows(&corners, (32, 40)), &[1, 2, 3], &LINE)
    })?
}

#[test]
fn scores_are_largest_at_the_displacement() -> Result<()> {
    for window in scores(moving(8, 37, 43).view(), 2)?.outer_iter() {
        let mut best = (0, 0);
        for (place, &score) in window.indexed_iter() {
            if score > window[best] {
                best = place;
            }
        }
        assert_eq!((LINE[best.0], LINE[best.1]), (1.0, -0.5));
    }
    Ok(())
}

#[test]
fn scores_do_not_depend_on_threads_or_the_layout() -> Result<()> {
    let blocks = moving(8, 37, 43);
    let expected = scores(blocks.view(), 1)?;
    let columns = blocks.t().as_standard_layout().into_owned();
    for threads in [1, 2, 5] {
        assert_eq!(scores(columns.t(), threads)?, expected);
    }
    Ok(())
}

fn what<T>(result: Result<T>) -> &'static str {
    match result {
        Err(Error::Shape { what, .. } | Error::Range { what, .. }) => what,
        _ => "no such error",
    }
}

#[test]
fn invalid_arguments_are_errors() {
    let blocks = moving(4, 8, 8);
    let score = |corner, size, lag, end| {
        let (corners, line) = ([corner], [0.0, end]);
        what(velocity_scores(
            blocks.view(),
            windows(&corners, size),
            &[lag],
            &line,
        ))
    };
    assert_eq!(score((1, 0), (8, 8), 1, 1.0), "windows");
    assert_eq!(score((0, usize::MAX), (8, 8), 1, 1.0), "windows");
    assert_eq!(score((0, 0), (8, 0), 1, 1.0), "windows");
    assert_eq!(score((0, 0), (8, 8), 0, 1.0), "lags");
    assert_eq!(score((0, 0), (8, 8), 4, 1.0), "lags");
    assert_eq!(score((0, 0), (8, 8), 1, f64::NAN), "line and filters");
    assert_eq!(score((0, 0), (8, 8), 3, 1e300), "no such error");
}

#[test]
fn an_empty_line_has_no_scores() -> Result<()> {
    let blocks = moving(3, 10, 12);
    let scores = velocity_scores(blocks.view(), windows(&[(0, 0)], (8, 8)), &[1], &[])?;
    assert_eq!(scores.dim(), (1, 0, 0));
    Ok(())
}

#[test]
fn shifted_scores_are_added_at_their_place_and_their_shift() -> Result<()> {
    let mut scores = Array3::zeros((2, 4, 5));
    scores[(0, 1, 2)] = 1.0;
    scores[(1, 3, 4)] = 2.0;
    let shifts = array![[[0, 0], [2, 2]], [[0, 0], [i64::MIN, i64::MAX]]];
    let peaks = peak_of_shifted_scores(scores.view(), shifts.view())?;
    let expected = [3.0, 1.0].map(|score| Peak {
        score,
        place: (1, 2),
    });
    assert_eq!(peaks, expected);
    let wrong = Array3::zeros((1, 3, 2));
    let result = peak_of_shifted_scores(scores.view(), wrong.view());
    assert_eq!(what(result), "shifts");
    Ok(())
}

#[test]
fn blocks_are_counted_with_a_weight() -> Result<()> {
    // Each frame has one 1 in each of the first two rows, in another column.
    let bytes = Array3::from_shape_fn(
        (7, 4, 1),
        |(frame, row, _)| {
            if row < 2 { 0b1000_0000 >> frame } else { 0 }
        },
    );
    let bits = PackedBits::new(bytes.view(), 8)?;
    let mut counts = Array3::from_elem((3, 2, 4), 1);
    let blocks = Blocks {
        before: 2,
        length: 3,
        weight: 4,
    };
    add_counts_of_blocks(&bits, 2, blocks, counts.view_mut())?;
    // Frame f belongs to the block (f + 2) / 3, and its 1 to the square f / 2.
    let expected = array![
        [[9, 1, 1, 1], [1, 1, 1, 1]],
        [[9, 17, 1, 1], [1, 1, 1, 1]],
        [[1, 1, 17, 9], [1, 1, 1, 1]]
    ];
    assert_eq!(counts, expected);
    for (before, length, weight) in [(3, 3, 1), (usize::MAX, 3, 1)] {
        let blocks = Blocks {
            before,
            length,
            weight,
        };
        let result = add_counts_of_blocks(&bits, 2, blocks, counts.view_mut());
        assert_eq!(what(result), "frames");
    }
    Ok(())
}
