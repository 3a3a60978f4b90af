//! Squares of 2 × 2 pixels, and their counts.

use ndarray::{Array2, ArrayView2, Zip};

use super::Pixels;
use crate::error::{Error, Result};
use crate::likelihood::Threshold;
use crate::mle::JotResponses;
use crate::values::Values;

/// The smallest weight of a pixel in the means over a square. A square without bits has the mean of
/// its pixels.
const MIN_TRIALS: f64 = 1e-9;

/// One number for all squares, or one for each.
#[derive(Clone, Debug, PartialEq)]
pub enum OfSquares {
    /// The number of all squares.
    Same(f64),
    /// The number of each square.
    Each(Array2<f64>),
}

impl OfSquares {
    fn values(&self) -> Values<'_, f64> {
        match self {
            Self::Same(value) => Values::Same(*value),
            Self::Each(map) => Values::Each(map.as_slice().unwrap_or_default()),
        }
    }
}

/// The counts of squares of 2 × 2 pixels. At the edge, pixels fill the squares twice.
#[derive(Clone, Debug)]
pub struct Squares {
    /// The numbers of ones.
    pub counts: Array2<i32>,
    /// The numbers of bits.
    pub trials: OfSquares,
    /// The quantum efficiency: the mean over the bits.
    pub efficiency: OfSquares,
    /// The dark counts: for the threshold 1 those that cause as many ones, for others the mean over the
    /// bits.
    pub dark_counts: OfSquares,
}

impl Squares {
    /// Return the counts of the squares of pixels with a threshold.
    ///
    /// # Errors
    /// [`Error::Shape`] if the lengths of the arrays do not match, and [`Error::Range`] for counts
    /// whose sum is too large.
    pub fn of(pixels: &Pixels<'_>, threshold: Threshold) -> Result<Self> {
        let shape = pixels.counts.dim();
        let sums = sum_squares(pixels.counts, i64::from);
        if let Some(sum) = sums.iter().find(|&&sum| i32::try_from(sum).is_err()) {
            let expected = "sums of 4 counts up to 2147483647";
            return Err(Error::range("counts", expected, sum));
        }
        let map = map_of("trials", pixels.trials, shape)?;
        let trials = map.map_or_else(
            || OfSquares::Same(4.0 * pixels.trials.get(0)),
            |trials| OfSquares::Each(sum_squares(trials, |trials| trials)),
        );
        let weights = map.map(|trials| trials.mapv(|trials| trials.max(MIN_TRIALS)));
        let weights = weights.unwrap_or_else(|| Array2::ones(shape));
        // The mean of a function of values over the bits of each square.
        let mean = |what, values: Values<'_, f64>, of: fn(f64) -> f64| match values {
            Values::Same(value) => Ok(OfSquares::Same(value)),
            Values::Each(_) => {
                let mut weighted = weights.clone();
                if let Some(map) = map_of(what, values, shape)? {
                    weighted.zip_mut_with(&map, |weighted, &value| *weighted *= of(value));
                }
                let sums = [weighted.view(), weights.view()];
                let [sum, total] = sums.map(|image| sum_squares(image, |value| value));
                Ok(OfSquares::Each(sum / total))
            }
        };
        let (efficiency, dark_counts) = (pixels.jots.efficiency, pixels.jots.dark_counts);
        let is_first = threshold.photons() == 1;
        let of_dark: fn(f64) -> f64 = if is_first { |d| (-d).exp() } else { |d| d };
        let dark_counts = match mean("dark counts", dark_counts, of_dark)? {
            OfSquares::Each(zeros) if is_first => {
                OfSquares::Each(zeros.mapv(|zeros| -zeros.max(f64::MIN_POSITIVE).ln()))
            }
            other => other,
        };
        Ok(Self {
            counts: sums.mapv(|sum| sum as i32),
            trials,
            efficiency: mean("efficiency", efficiency, |efficiency| efficiency)?,
            dark_counts,
        })
    }

    /// Return the counts as those of pixels.
    #[must_use]
    pub fn pixels(&self) -> Pixels<'_> {
        Pixels {
            counts: self.counts.view(),
            trials: self.trials.values(),
            jots: JotResponses {
                efficiency: self.efficiency.values(),
                dark_counts: self.dark_counts.values(),
            },
        }
    }
}

/// Return the map of values, or None if all pixels have the same one.
fn map_of<'a>(
    what: &'static str,
    values: Values<'a, f64>,
    shape: (usize, usize),
) -> Result<Option<ArrayView2<'a, f64>>> {
    let Values::Each(values) = values else {
        return Ok(None);
    };
    let map = ArrayView2::from_shape(shape, values);
    let wrong = |_| Error::shape(what, shape.0 * shape.1, values.len());
    Ok(Some(map.map_err(wrong)?))
}

/// Return the sums over squares of 2 × 2 pixels. Pixels of the edge count once more where a square
/// exceeds the image.
pub(super) fn sum_squares<T: Copy + Send + Sync, S>(
    image: ArrayView2<'_, T>,
    value: impl Fn(T) -> S + Send + Sync,
) -> Array2<S>
where
    S: std::ops::Add<Output = S> + Send,
{
    let (height, width) = image.dim();
    let squares = Array2::<()>::default((height.div_ceil(2), width.div_ceil(2)));
    Zip::indexed(&squares).par_map_collect(|(row, column), ()| {
        let (top, left) = (2 * row, 2 * column);
        let (bottom, right) = ((top + 1).min(height - 1), (left + 1).min(width - 1));
        let column_of = |column| value(image[[top, column]]) + value(image[[bottom, column]]);
        column_of(left) + column_of(right)
    })
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn squares_have_the_counts_of_their_pixels() -> Result<()> {
        let trials = [1.0, 3.0, 2.0, 4.0, 5.0, 7.0];
        let dark = [0.0, 1.0, 0.5, 0.2, 0.3, 0.1];
        let counts = array![[1, 2, 1], [3, 5, 7]];
        for (q, expected_dark) in [
            (
                1,
                -((1.0 + 3.0 * (-1.0f64).exp() + 4.0 * (-0.2f64).exp() + 5.0 * (-0.3f64).exp())
                    / 13.0)
                    .ln(),
            ),
            (2, (3.0 + 0.8 + 1.5) / 13.0),
        ] {
            let pixels = Pixels {
                counts: counts.view(),
                trials: Values::Each(&trials),
                jots: JotResponses {
                    efficiency: Values::Same(0.5),
                    dark_counts: Values::Each(&dark),
                },
            };
            let squares = Squares::of(&pixels, Threshold::new(q)?)?;
            assert_eq!(squares.counts, array![[11, 16]]);
            assert_eq!(squares.trials, OfSquares::Each(array![[13.0, 18.0]]));
            assert_eq!(squares.efficiency, OfSquares::Same(0.5));
            let OfSquares::Each(found) = &squares.dark_counts else {
                return Err(Error::range("dark counts", "a map", "one number"));
            };
            assert!((found[[0, 0]] - expected_dark).abs() < 1e-12);
            assert_eq!(squares.pixels().counts, squares.counts);
        }
        Ok(())
    }

    #[test]
    fn pixels_alike_have_squares_alike() -> Result<()> {
        let counts = Array2::from_elem((3, 4), 2);
        let pixels = Pixels {
            counts: counts.view(),
            trials: Values::Same(3.0),
            jots: JotResponses {
                efficiency: Values::Same(0.5),
                dark_counts: Values::Same(0.1),
            },
        };
        let squares = Squares::of(&pixels, Threshold::new(1)?)?;
        assert_eq!(squares.counts, Array2::from_elem((2, 2), 8));
        assert_eq!(squares.trials, OfSquares::Same(12.0));
        assert_eq!(squares.dark_counts, OfSquares::Same(0.1));
        Ok(())
    }

    #[test]
    fn sums_that_are_too_large_are_refused() -> Result<()> {
        let counts = Array2::from_elem((2, 2), i32::MAX / 2);
        let pixels = Pixels {
            counts: counts.view(),
            trials: Values::Same(1e10),
            jots: JotResponses {
                efficiency: Values::Same(1.0),
                dark_counts: Values::Same(0.0),
            },
        };
        let found = Squares::of(&pixels, Threshold::new(1)?);
        assert!(matches!(found, Err(Error::Range { what: "counts", .. })));
        Ok(())
    }
}
