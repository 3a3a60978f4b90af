//! The enlargement of images by 2, by cubic interpolation.

use ndarray::parallel::prelude::*;
use ndarray::{Array2, ArrayView2, Axis};

use crate::border::mirror_index;

/// The pole of the recursive filter that turns values into the coefficients of cubic B-splines:
/// √3 − 2.
const POLE: f64 = -0.267_949_192_431_122_7;

/// The values of four cubic B-splines, a quarter of the way from the second to the third coefficient.
const TAPS: [f64; 4] = [27.0 / 384.0, 235.0 / 384.0, 121.0 / 384.0, 1.0 / 384.0];

/// Return an image of twice the height and width.
///
/// Its pixels lie a quarter of a pixel before and after the centers of those of the image, which is
/// reflected beyond its border.
pub(super) fn enlarge(image: ArrayView2<'_, f64>) -> Array2<f64> {
    let wide = enlarge_rows(image);
    enlarge_rows(wide.t()).reversed_axes()
}

/// Return rows of twice the length.
fn enlarge_rows(image: ArrayView2<'_, f64>) -> Array2<f64> {
    let (height, width) = image.dim();
    let mut out = Array2::zeros((height, 2 * width));
    let rows = out.axis_iter_mut(Axis(0)).into_par_iter();
    let rows = rows.zip(image.axis_iter(Axis(0)).into_par_iter());
    rows.for_each_init(Vec::new, |coefficients, (mut out, row)| {
        coefficients.clear();
        coefficients.extend(row);
        to_coefficients(coefficients);
        for (place, out) in out.iter_mut().enumerate() {
            let center = (place / 2) as isize;
            let direction = if place % 2 == 0 { -1 } else { 1 };
            let terms = (-1..).zip(TAPS).map(|(offset, tap)| {
                tap * coefficients[mirror_index(center + direction * offset, width)]
            });
            *out = terms.sum();
        }
    });
    out
}

/// Replace values, which are reflected beyond their ends, with the coefficients of cubic B-splines.
fn to_coefficients(values: &mut [f64]) {
    let last = values.len().saturating_sub(1);
    if last == 0 {
        return;
    }
    // The sum of all values before the first one, which repeat with a period of twice the length.
    let mut power = POLE;
    let period = POLE.powi(values.len().min(1 << 20) as i32);
    let mut sum = values[0] + period * values[last];
    for index in 1..=last {
        sum += power * (values[index] + period * values[last - index]);
        power *= POLE;
    }
    let first = values[0] + sum * POLE / (1.0 - period * period);
    values[0] = first;
    for index in 1..=last {
        values[index] += POLE * values[index - 1];
    }
    values[last] *= POLE / (POLE - 1.0);
    for index in (0..last).rev() {
        values[index] = POLE * (values[index + 1] - values[index]);
    }
    // The gain of both filters.
    for value in values {
        *value *= (1.0 - POLE) * (1.0 - 1.0 / POLE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spline(distance: f64) -> f64 {
        match distance.abs() {
            x if x < 1.0 => 2.0 / 3.0 - x * x + x * x * x / 2.0,
            x if x < 2.0 => (2.0 - x).powi(3) / 6.0,
            _ => 0.0,
        }
    }

    /// Return the sum of the splines around the coefficients at a place.
    fn interpolate(coefficients: &[f64], place: f64) -> f64 {
        let near = place.floor() as isize;
        let terms = (near - 1..near + 3).map(|index| {
            coefficients[mirror_index(index, coefficients.len())] * spline(place - index as f64)
        });
        terms.sum()
    }

    #[test]
    fn splines_pass_through_the_values() {
        for length in [2, 3, 16, 101] {
            let values: Vec<f64> = (0..length).map(|x| f64::from(x * 37 % 11)).collect();
            let mut coefficients = values.clone();
            to_coefficients(&mut coefficients);
            for (place, value) in values.iter().enumerate() {
                let found = interpolate(&coefficients, place as f64);
                assert!((found - value).abs() < 1e-12, "{length} {place}");
            }
        }
    }

    #[test]
    fn pixels_lie_a_quarter_before_and_after_the_centers() {
        let image = Array2::from_shape_fn((5, 7), |(y, x)| ((y * 5 + x * 3) % 8) as f64);
        let found = enlarge(image.view());
        assert_eq!(found.dim(), (10, 14));
        let column_of = |image: ArrayView2<'_, f64>, place: f64| -> Vec<f64> {
            let rows = image.rows().into_iter().map(|row| {
                let mut coefficients = row.to_vec();
                to_coefficients(&mut coefficients);
                interpolate(&coefficients, place)
            });
            rows.collect()
        };
        for ((y, x), &value) in found.indexed_iter() {
            let place = |index: usize| 0.5 * index as f64 - 0.25;
            let mut column = column_of(image.view(), place(x));
            to_coefficients(&mut column);
            assert!((interpolate(&column, place(y)) - value).abs() < 1e-12);
        }
    }

    #[test]
    fn a_constant_image_stays_constant() {
        for shape in [(1, 1), (1, 6), (16, 16)] {
            let found = enlarge(Array2::from_elem(shape, 0.7).view());
            assert!(found.iter().all(|value| (value - 0.7).abs() < 1e-14));
        }
    }
}
