//! By how much an object explains bits better than what would be there without it.

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis, CowArray, Ix3};
use rayon::prelude::*;

use super::count::{Count, Counts};
use super::lines::BLOCK;
use super::relative::{OUTSIDE, Relative};
use super::rounding::max;
use super::sums::check_counts;
#[cfg(doc)]
use crate::error::Error;
use crate::error::{Result, check_shape};
use crate::interrupt;

/// The number of values that describe what a template predicts: log p/(1 − p) and log (1 − p) with
/// the probability p of a one; the expected loss of a bit because the template is noisy; and how
/// far the template is known, from 0 to 1.
pub const PREDICTIONS: usize = 4;

/// The number of sums of [`add_object_gain`].
pub const GAINS: usize = 3;

/// A segment of the scene, and where an object sees it in a block of frames.
#[derive(Clone, Debug)]
pub struct Seen<'a> {
    /// The label of the segment. Segments with larger labels are in front of others.
    pub label: u8,
    /// What its template predicts, `(H, W, PREDICTIONS)`.
    pub predicted: ArrayView3<'a, f32>,
    /// How far its pixels are from those of the object that have the same positions.
    pub relative: Relative<'a>,
}

/// The counts along the track of an object, and what its template predicts.
#[derive(Clone, Copy, Debug)]
pub struct Object<'a, C = i32> {
    /// The label of the object.
    pub label: u8,
    /// The counts of a block, `(H, W)`.
    pub counts: Counts<'a, C>,
    /// What its template predicts, `(H, W, PREDICTIONS)`.
    pub predicted: ArrayView3<'a, f32>,
}

/// Add the gain of an object to `out` `(GAINS, H, W)`: in nats; the trials for which it is known;
/// and all trials of pixels that no segment in front hides.
///
/// A pixel shows the foremost other segment whose pixel at this position has its label; the segment
/// with the label 0 is everywhere. The gain of N ones in D trials is the difference of the
/// log-likelihoods under both templates, without the loss by the larger noise of the other one, times
/// how far the other template is known.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match. [`Error::Range`] if counts are not
/// possible.
pub fn add_object_gain<C: Count>(
    object: &Object<'_, C>,
    others: &[Seen<'_>],
    labels: ArrayView2<'_, u8>,
    mut out: ArrayViewMut3<'_, f32>,
) -> Result<()> {
    let size = labels.dim();
    check_counts(object.counts.ones, object.counts.trials, size)?;
    let shape = (size.0, size.1, PREDICTIONS);
    check_shape("predictions", shape, object.predicted.dim())?;
    for other in others {
        check_shape("predictions", shape, other.predicted.dim())?;
        check_shape("field", size, other.relative.size())?;
    }
    check_shape("output", (GAINS, size.0, size.1), out.dim())?;
    if labels.is_empty() {
        return Ok(());
    }
    let own = object.predicted.as_standard_layout();
    let predicted: Vec<_> = others
        .iter()
        .map(|other| other.predicted.as_standard_layout())
        .collect();
    let labels = labels.as_standard_layout();
    let labels = labels.as_slice().unwrap_or_default();
    let own = values(&own);
    let others: Vec<_> = others
        .iter()
        .zip(&predicted)
        .map(|(other, predicted)| Other {
            label: other.label,
            predicted: values(predicted),
            relative: &other.relative,
        })
        .collect();
    out.axis_iter_mut(Axis(1))
        .into_par_iter()
        .enumerate()
        .for_each(|(row, out)| {
            if !interrupt::is_requested() {
                add_row(object, own, &others, labels, row, out);
            }
        });
    Ok(())
}

/// Set `out` to true where pixels are behind a segment in front.
///
/// A segment in front is stated by its label, and by how far its pixels are from those of `out` that
/// have the same positions. It covers a pixel if its pixel at this position has its label in `labels`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match.
pub fn mark_covered(
    fronts: &[(u8, Relative<'_>)],
    labels: ArrayView2<'_, u8>,
    mut out: ArrayViewMut2<'_, bool>,
) -> Result<()> {
    let size = labels.dim();
    check_shape("output", size, out.dim())?;
    for (_, relative) in fronts {
        check_shape("field", size, relative.size())?;
    }
    if labels.is_empty() {
        return Ok(());
    }
    let labels = labels.as_standard_layout();
    let labels = labels.as_slice().unwrap_or_default();
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each(|(row, mut out)| {
            for (label, relative) in fronts {
                let relative = relative.row(row);
                for block in 0..size.1.div_ceil(BLOCK) {
                    let places = relative.places(block);
                    let pixels = out.iter_mut().skip(BLOCK * block);
                    for (out, place) in pixels.zip(places) {
                        *out |= labels.get(place) == Some(label);
                    }
                }
            }
        });
    Ok(())
}

/// Another segment of the scene.
struct Other<'a> {
    label: u8,
    predicted: &'a [[f32; PREDICTIONS]],
    relative: &'a Relative<'a>,
}

/// Return the values of each pixel.
fn values<'a>(predicted: &'a CowArray<'_, f32, Ix3>) -> &'a [[f32; PREDICTIONS]] {
    predicted.as_slice().unwrap_or_default().as_chunks().0
}

/// Add the gain of a row, `(GAINS, W)`.
fn add_row<C: Count>(
    object: &Object<'_, C>,
    own: &[[f32; PREDICTIONS]],
    others: &[Other<'_>],
    labels: &[u8],
    row: usize,
    mut out: ArrayViewMut2<'_, f32>,
) {
    let width = out.ncols();
    let rows: Vec<_> = others.iter().map(|other| other.relative.row(row)).collect();
    let mut places = vec![[OUTSIDE; BLOCK]; others.len()];
    let (ones, trials) = (object.counts.ones.row(row), object.counts.trials.row(row));
    for column in 0..width {
        if column % BLOCK == 0 {
            for (places, row) in places.iter_mut().zip(&rows) {
                *places = row.places(column / BLOCK);
            }
        }
        let trials = trials[column].to_f32();
        if trials <= 0.0 {
            continue;
        }
        let places = places.iter().map(|places| places[column % BLOCK]);
        let other = match shown(object.label, others, labels, places) {
            Shown::Hidden => continue,
            Shown::Nothing => {
                out[[2, column]] += trials;
                continue;
            }
            Shown::Behind(predicted) => predicted,
        };
        out[[2, column]] += trials;
        let ones = ones[column].to_f32();
        let own = own[row * width + column];
        let loss = max(other[2] - own[2], 0.0);
        let gain = ones * (own[0] - other[0]) + trials * (own[1] - other[1] - loss);
        let known = other[3];
        out[[0, column]] += known * gain;
        out[[1, column]] += known * trials;
    }
}

/// What is at a pixel of an object.
enum Shown {
    /// A segment in front hides the object.
    Hidden,
    /// No other segment is there.
    Nothing,
    /// What the template of the foremost segment behind the object predicts.
    Behind([f32; PREDICTIONS]),
}

/// Return what is at a pixel of an object, given the pixels of all other segments there.
#[inline(always)]
fn shown(
    object: u8,
    others: &[Other<'_>],
    labels: &[u8],
    places: impl Iterator<Item = usize>,
) -> Shown {
    let mut found = Shown::Nothing;
    for (other, place) in others.iter().zip(places) {
        let Some(&label) = labels.get(place) else {
            continue;
        };
        if other.label > 0 && label != other.label {
            continue;
        }
        if other.label > object {
            return Shown::Hidden;
        }
        found = Shown::Behind(other.predicted[place]);
    }
    found
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3, arr2};

    use super::*;
    use crate::error::Error;

    const TILE: usize = 16;

    /// The predictions of a row of three pixels.
    fn row(values: [[f32; 3]; PREDICTIONS]) -> Array3<f32> {
        Array3::from_shape_fn((1, 3, PREDICTIONS), |(_, column, index)| {
            values[index][column]
        })
    }

    /// Displacements at the center of a tile.
    fn nodes(down: f32, right: f32) -> Array3<f32> {
        Array3::from_shape_fn((2, 1, 1), |(axis, ..)| [down, right][axis])
    }

    #[test]
    fn a_gain_is_that_of_the_foremost_segment_behind() -> Result<()> {
        let ones = arr2(&[[1, 0, 2]]);
        let trials = Array2::from_elem((1, 3), 2);
        let own = row([[1.0; 3], [-0.5; 3], [0.01; 3], [1.0; 3]]);
        let back = row([
            [0.0, 0.5, 2.0],
            [-0.1, -0.2, -0.3],
            [0.02; 3],
            [1.0, 0.5, 0.0],
        ]);
        let front = row([[9.0; 3], [-9.0; 3], [0.0; 3], [1.0; 3]]);
        let labels = arr2(&[[0, 1, 2]]);
        let (moved, still) = (nodes(0.4, 1.0), nodes(0.0, 0.0));
        let object = Object {
            label: 1,
            counts: Counts {
                ones: ones.view(),
                trials: trials.view(),
            },
            predicted: own.view(),
        };
        let seen = |label, predicted, nodes| -> Result<Seen<'_>> {
            Ok(Seen {
                label,
                predicted,
                relative: Relative::new(nodes, TILE, (1, 3))?,
            })
        };
        let others = [
            seen(0, back.view(), moved.view())?,
            seen(2, front.view(), still.view())?,
        ];
        let mut out = Array3::zeros((GAINS, 1, 3));
        add_object_gain(&object, &others, labels.view(), out.view_mut())?;
        // The first pixel sees the second one of the background; the next one sees the third, which
        // is not known; the last one is hidden.
        let gain = 0.5 * (1.0 * (1.0 - 0.5) + 2.0 * (-0.5 + 0.2) - 2.0 * 0.01);
        let expected = [[gain, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 2.0, 0.0]];
        for (found, expected) in out.iter().zip(expected.as_flattened()) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        Ok(())
    }

    #[test]
    fn pixels_behind_a_segment_are_marked() -> Result<()> {
        let labels = arr2(&[[0, 2, 2]]);
        let (right, away) = (nodes(0.0, 1.0), nodes(-1.0, 0.0));
        let front = |label, nodes| Ok::<_, Error>((label, Relative::new(nodes, TILE, (1, 3))?));
        let mut out = Array2::from_elem((1, 3), false);
        let fronts = [front(2, right.view())?, front(1, right.view())?];
        mark_covered(&fronts, labels.view(), out.view_mut())?;
        assert_eq!(out, arr2(&[[true, true, false]]));
        // The pixels of this one are above the image.
        mark_covered(&[front(2, away.view())?], labels.view(), out.view_mut())?;
        assert_eq!(out, arr2(&[[true, true, false]]));
        let mut few = Array2::from_elem((1, 2), false);
        assert!(mark_covered(&fronts, labels.view(), few.view_mut()).is_err());
        Ok(())
    }

    #[test]
    fn other_shapes_are_refused() -> Result<()> {
        let counts = Array2::<i32>::zeros((2, 3));
        let labels = Array2::zeros((2, 3));
        let predicted = Array3::zeros((2, 3, PREDICTIONS));
        let still = nodes(0.0, 0.0);
        let object = Object {
            label: 1,
            counts: Counts {
                ones: counts.view(),
                trials: counts.view(),
            },
            predicted: predicted.view(),
        };
        let mut few = Array3::zeros((2, 2, 3));
        assert!(add_object_gain(&object, &[], labels.view(), few.view_mut()).is_err());
        let mut out = Array3::zeros((GAINS, 2, 3));
        assert!(add_object_gain(&object, &[], labels.view(), out.view_mut()).is_ok());
        let wrong = Seen {
            label: 0,
            predicted: predicted.view(),
            relative: Relative::new(still.view(), TILE, (3, 3))?,
        };
        assert!(add_object_gain(&object, &[wrong], labels.view(), out.view_mut()).is_err());
        assert!(Relative::new(still.view(), TILE, (17, 3)).is_err());
        Ok(())
    }
}
