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

/// Write the sum of three rows into `out`.
#[inline(always)]
pub(super) fn add_three(rows: [&[f32]; 3], out: &mut [f32]) {
    let rows = rows.map(|row| &row[..out.len()]);
    for i in 0..out.len() {
        out[i] = rows[0][i] + (rows[1][i] + rows[2][i]);
    }
}

/// The last `N` rows of an image.
pub(super) struct LastRows<const N: usize> {
    values: Vec<f32>,
    width: usize,
}

impl<const N: usize> LastRows<N> {
    pub fn new(width: usize) -> Self {
        Self {
            values: vec![0.0; N * width],
            width,
        }
    }

    #[inline(always)]
    pub fn row(&self, index: usize) -> &[f32] {
        &self.values[index % N * self.width..][..self.width]
    }

    #[inline(always)]
    pub fn row_mut(&mut self, index: usize) -> &mut [f32] {
        &mut self.values[index % N * self.width..][..self.width]
    }
}
