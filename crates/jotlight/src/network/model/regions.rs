//! Parts of an image that together contain the pixels of a map.

use ndarray::ArrayView2;

use crate::network::tiling::region::Region;

/// The sides of the cells of which regions consist, in pixels. Large ones need fewer halos.
const CELLS: [usize; 2] = [8, 32];

/// Return disjoint rectangles that contain all needed pixels.
///
/// They are the whole image where it has no more pixels than they have together with their halos.
pub(super) fn cover(weights: ArrayView2<'_, f32>, halo: usize) -> Vec<Region> {
    let size = weights.dim();
    let mut best = vec![Region {
        rows: 0..size.0,
        columns: 0..size.1,
    }];
    let mut least = size.0 * size.1;
    for side in CELLS {
        let regions = rectangles(weights, side);
        let area = |region: &Region| {
            let wide = widen(region, halo, size);
            wide.rows.len() * wide.columns.len()
        };
        let area: usize = regions.iter().map(area).sum();
        if area < least {
            (best, least) = (regions, area);
        }
    }
    best
}

/// Return a region with the part of the halo around it that lies in the image.
pub(super) fn widen(region: &Region, halo: usize, (height, width): (usize, usize)) -> Region {
    Region {
        rows: region.rows.start.saturating_sub(halo)..(region.rows.end + halo).min(height),
        columns: region.columns.start.saturating_sub(halo)..(region.columns.end + halo).min(width),
    }
}

/// Return rectangles of square cells that cover all pixels with a weight above 0.
///
/// A rectangle grows downward as long as the same run of cells is needed.
fn rectangles(weights: ArrayView2<'_, f32>, side: usize) -> Vec<Region> {
    let (height, width) = weights.dim();
    let mut found: Vec<Region> = Vec::new();
    let mut growing: Vec<Region> = Vec::new();
    for top in (0..height).step_by(side) {
        let rows = top..(top + side).min(height);
        let mut next = Vec::new();
        for columns in runs(weights, rows.clone(), side) {
            let same = growing.iter().position(|region| region.columns == columns);
            let start = same.map_or(top, |index| growing.swap_remove(index).rows.start);
            next.push(Region {
                rows: start..rows.end,
                columns: columns.start..columns.end.min(width),
            });
        }
        found.append(&mut growing);
        growing = next;
    }
    found.append(&mut growing);
    found
}

/// Return the runs of neighboring cells with needed pixels in a row of cells.
fn runs(
    weights: ArrayView2<'_, f32>,
    rows: std::ops::Range<usize>,
    side: usize,
) -> Vec<std::ops::Range<usize>> {
    let width = weights.ncols();
    let mut runs: Vec<std::ops::Range<usize>> = Vec::new();
    for left in (0..width).step_by(side) {
        let columns = left..(left + side).min(width);
        let cell = weights.slice(ndarray::s![rows.clone(), columns.clone()]);
        if !cell.iter().any(|&weight| weight > 0.0) {
            continue;
        }
        match runs.last_mut() {
            Some(run) if run.end == left => run.end = columns.end,
            _ => runs.push(columns),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, s};

    use super::*;

    #[test]
    fn regions_are_disjoint_and_contain_all_needed_pixels() {
        for seed in 0..40u32 {
            let mut weights = Array2::<f32>::zeros((100, 131));
            for part in 0..seed % 5 {
                let (top, left) = ((seed * 37 + part * 29) % 90, (seed * 53 + part * 71) % 120);
                let (top, left) = (top as usize, left as usize);
                weights
                    .slice_mut(s![top..top + 10, left..left + 11])
                    .fill(1.0);
            }
            let mut covered = Array2::<f32>::zeros(weights.dim());
            let regions = cover(weights.view(), seed as usize % 12);
            for Region { rows, columns } in regions {
                covered
                    .slice_mut(s![rows, columns])
                    .mapv_inplace(|x| x + 1.0);
            }
            assert!(covered.iter().all(|&number| number <= 1.0));
            assert!(
                weights
                    .iter()
                    .zip(&covered)
                    .all(|(need, have)| need <= have)
            );
        }
    }

    #[test]
    fn small_regions_save_work() {
        let mut weights = Array2::<f32>::zeros((100, 300));
        weights.slice_mut(s![..40, 70..80]).fill(0.5);
        let regions = cover(weights.view(), 4);
        assert_eq!(regions.len(), 1);
        assert_eq!(
            (regions[0].rows.clone(), regions[0].columns.clone()),
            (0..40, 64..80)
        );
        assert_eq!(cover(weights.view(), 300)[0].columns, 0..300);
    }
}
