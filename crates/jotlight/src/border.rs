//! The continuation of images beyond their border.
//!
//! The image is reflected, and the pixels at its edge are repeated: … 1 0 | 0 1 2 … n−1 | n−1 n−2 …

/// Return the index in `0..size` of the pixel that `index` shows, which may lie outside the image.
#[inline(always)]
pub(crate) fn mirror_index(index: isize, size: usize) -> usize {
    if (0..size as isize).contains(&index) {
        return index as usize;
    }
    let folded = index.rem_euclid(2 * size as isize) as usize;
    folded.min(2 * size - 1 - folded)
}

/// Replace the values before and after the `length` values of a row that begin at `margin`: the
/// values at a distance of up to `margin` are reflected.
#[inline(always)]
pub(crate) fn reflect_margins(row: &mut [f32], margin: usize, length: usize) {
    for distance in 1..=margin {
        row[margin - distance] = row[margin + mirror_index(-(distance as isize), length)];
        let after = margin + length + distance - 1;
        row[after] = row[margin + mirror_index((length + distance - 1) as isize, length)];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirror_index_repeats_the_edge() {
        let row: Vec<usize> = (-4..8).map(|index| mirror_index(index, 3)).collect();
        assert_eq!(row, [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
    }

    #[test]
    fn margins_wider_than_the_row_are_reflected_again() {
        let mut row = [0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0];
        reflect_margins(&mut row, 3, 2);
        assert_eq!(row.map(|value| value as i32), [2, 2, 1, 1, 2, 2, 1, 1]);
    }
}
