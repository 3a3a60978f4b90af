//! By how much an object explains bits better than what would be there without it.

use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, ArrayViewMut3, Axis};
use rayon::prelude::*;

use super::count::Count;
use super::disagreement::Counts;
use super::sums::check_counts;
use crate::error::{Error, Result};
use crate::interrupt;

/// The number of images that describe what a template predicts: log p/(1 − p) and log (1 − p) with
/// the probability p of a one; the expected loss of a bit because the template is noisy; and how
/// far the template is known, from 0 to 1.
pub const PREDICTIONS: usize = 4;

/// The number of sums of [`add_object_gain`].
pub const GAINS: usize = 3;

/// A segment of the scene, and where an object sees it in a block of frames.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The label of the segment. Segments with larger labels are in front of others.
    pub label: u8,
    /// What its template predicts, `(PREDICTIONS, H, W)`.
    pub predicted: ArrayView3<'a, f32>,
    /// How far its pixels are from those of the object that have the same positions, `(2, H, W)`.
    pub field: ArrayView3<'a, f32>,
}

/// The counts along the track of an object, and what its template predicts.
#[derive(Clone, Copy, Debug)]
pub struct Object<'a, C = i32> {
    /// The label of the object.
    pub label: u8,
    /// The counts of a block, `(H, W)`.
    pub counts: Counts<'a, C>,
    /// What its template predicts, `(PREDICTIONS, H, W)`.
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
    check_images("predictions", object.predicted, PREDICTIONS, size)?;
    for other in others {
        check_images("predictions", other.predicted, PREDICTIONS, size)?;
        check_images("field", other.field, 2, size)?;
    }
    check_images("output", out.view(), GAINS, size)?;
    out.axis_iter_mut(Axis(1))
        .into_par_iter()
        .enumerate()
        .for_each(|(row, out)| {
            if !interrupt::is_requested() {
                add_row(object, others, labels, row, out);
            }
        });
    Ok(())
}

/// Set `out` `(H, W)` to true where pixels are behind a segment in front.
///
/// Those are the pixels where the pixel of the segment at the same position has its label. `field`
/// is how far that pixel is away, `(2, H, W)`.
///
/// # Errors
/// [`Error::Shape`] if the shapes of the arrays do not match.
pub fn mark_covered(
    label: u8,
    field: ArrayView3<'_, f32>,
    labels: ArrayView2<'_, u8>,
    mut out: ArrayViewMut2<'_, bool>,
) -> Result<()> {
    let size = labels.dim();
    check_images("field", field, 2, size)?;
    if out.dim() != size {
        return Err(Error::shape("output", size, out.dim()));
    }
    out.axis_iter_mut(Axis(0))
        .into_par_iter()
        .enumerate()
        .for_each(|(row, mut out)| {
            for (column, out) in out.iter_mut().enumerate() {
                *out |= place_in(field, size, [row, column])
                    .is_some_and(|place| labels[place] == label);
            }
        });
    Ok(())
}

/// Check the shape of some images.
fn check_images(
    what: &'static str,
    images: ArrayView3<'_, f32>,
    number: usize,
    size: (usize, usize),
) -> Result<()> {
    let shape = (number, size.0, size.1);
    if images.dim() != shape {
        return Err(Error::shape(what, shape, images.dim()));
    }
    Ok(())
}

/// Add the gain of a row, `(GAINS, W)`.
fn add_row<C: Count>(
    object: &Object<'_, C>,
    others: &[Seen<'_>],
    labels: ArrayView2<'_, u8>,
    row: usize,
    mut out: ArrayViewMut2<'_, f32>,
) {
    for column in 0..labels.ncols() {
        let trials = object.counts.trials[[row, column]].to_f32();
        if trials <= 0.0 {
            continue;
        }
        let (other, [y, x]) = match shown(object.label, others, labels, [row, column]) {
            Shown::Hidden => continue,
            Shown::Nothing => {
                out[[2, column]] += trials;
                continue;
            }
            Shown::Behind(other, place) => (other, place),
        };
        out[[2, column]] += trials;
        let ones = object.counts.ones[[row, column]].to_f32();
        let difference =
            |index| object.predicted[[index, row, column]] - other.predicted[[index, y, x]];
        let loss = (-difference(2)).max(0.0);
        let gain = ones * difference(0) + trials * (difference(1) - loss);
        let known = other.predicted[[3, y, x]];
        out[[0, column]] += known * gain;
        out[[1, column]] += known * trials;
    }
}

/// What is at a pixel of an object.
enum Shown<'a, 'b> {
    /// A segment in front hides the object.
    Hidden,
    /// No other segment is there.
    Nothing,
    /// The foremost segment behind the object, and its pixel.
    Behind(&'a Seen<'b>, [usize; 2]),
}

/// Return what is at a pixel of an object.
fn shown<'a, 'b>(
    object: u8,
    others: &'a [Seen<'b>],
    labels: ArrayView2<'_, u8>,
    pixel: [usize; 2],
) -> Shown<'a, 'b> {
    let mut found = Shown::Nothing;
    for other in others {
        let Some(place) = place_in(other.field, labels.dim(), pixel) else {
            continue;
        };
        if other.label > 0 && labels[place] != other.label {
            continue;
        }
        if other.label > object {
            return Shown::Hidden;
        }
        found = Shown::Behind(other, place);
    }
    found
}

/// Return the pixel of a field at a pixel, if it is inside the image.
fn place_in(
    field: ArrayView3<'_, f32>,
    size: (usize, usize),
    [row, column]: [usize; 2],
) -> Option<[usize; 2]> {
    let shifted = |axis: usize, index: usize, length: usize| {
        let place = index as f32 + field[[axis, row, column]].round_ties_even();
        (place >= 0.0 && place < length as f32).then_some(place as usize)
    };
    Some([shifted(0, row, size.0)?, shifted(1, column, size.1)?])
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array3, arr2, arr3};

    use super::*;

    /// Images of one row of three pixels.
    fn row(values: [[f32; 3]; PREDICTIONS]) -> Array3<f32> {
        arr3(&values.map(|values| [values]))
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
        let mut field = Array3::zeros((2, 1, 3));
        field.index_axis_mut(Axis(0), 1).fill(1.0);
        let still = Array3::zeros((2, 1, 3));
        let object = Object {
            label: 1,
            counts: Counts {
                ones: ones.view(),
                trials: trials.view(),
            },
            predicted: own.view(),
        };
        let seen = |label, predicted, field| Seen {
            label,
            predicted,
            field,
        };
        let others = [
            seen(0, back.view(), field.view()),
            seen(2, front.view(), still.view()),
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
        let mut field = Array3::zeros((2, 1, 3));
        field.index_axis_mut(Axis(0), 1).fill(1.0);
        let mut out = Array2::from_elem((1, 3), false);
        mark_covered(2, field.view(), labels.view(), out.view_mut())?;
        assert_eq!(out.into_raw_vec_and_offset().0, [true, true, false]);
        let mut few = Array2::from_elem((1, 2), false);
        assert!(mark_covered(2, field.view(), labels.view(), few.view_mut()).is_err());
        Ok(())
    }

    #[test]
    fn other_shapes_are_refused() {
        let counts = Array2::<i32>::zeros((2, 3));
        let labels = Array2::zeros((2, 3));
        let images = Array3::zeros((PREDICTIONS, 2, 3));
        let object = Object {
            label: 1,
            counts: Counts {
                ones: counts.view(),
                trials: counts.view(),
            },
            predicted: images.view(),
        };
        let mut few = Array3::zeros((2, 2, 3));
        assert!(add_object_gain(&object, &[], labels.view(), few.view_mut()).is_err());
        let mut out = Array3::zeros((GAINS, 2, 3));
        assert!(add_object_gain(&object, &[], labels.view(), out.view_mut()).is_ok());
        let wrong = Seen {
            label: 0,
            predicted: images.view(),
            field: images.view(),
        };
        assert!(add_object_gain(&object, &[wrong], labels.view(), out.view_mut()).is_err());
    }
}
