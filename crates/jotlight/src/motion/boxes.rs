//! Sums over neighboring values of rows, and over neighboring rows.

/// Write the sum of source\[i\], source\[i + step\], and source\[i + 2·step\] into `out`.
#[inline(always)]
pub(super) fn add_neighbors(source: &[f32], step: usize, out: &mut [f32]) {
    let length = out.len();
    let parts = [0, 1, 2].map(|k| &source[k * step..][..length]);
    for i in 0..length {
        out[i] = parts[0][i] + parts[1][i] + parts[2][i];
    }
}

/// Add to each of the first `number` rows those that are `step` and 2·`step` rows below it.
#[inline(always)]
pub(super) fn add_rows(rows: &mut [f32], width: usize, step: usize, number: usize) {
    for index in 0..number {
        let (above, below) = rows[index * width..].split_at_mut(step * width);
        let (near, far) = (&below[..width], &below[step * width..][..width]);
        for (sum, (near, far)) in above[..width].iter_mut().zip(near.iter().zip(far)) {
            *sum += near + far;
        }
    }
}
