//! The numbers of trials that state the noise around pixels.

use ndarray::{ArcArray, ArrayView2, Axis, Ix2};

use crate::error::{Error, Result};
use crate::filter;

/// The standard deviation of the neighborhood in which noise is averaged, in pixels.
const NEIGHBORHOOD: f64 = 3.0;

/// The ratio of the largest to the smallest local trials up to which one run serves all pixels.
const NEAR_RATIO: f32 = 1.2;

/// A real number of trials is rounded up if its fraction is at least this. A denoiser loses about
/// twice as much with 10 % too many trials as with 10 % too few.
const ROUNDED_UP: f64 = 2.0 / 3.0;

/// The number of trials that states the noise around each pixel of an image: the local trials.
#[derive(Clone, Debug)]
pub enum LocalTrials {
    /// The same whole number everywhere.
    Same(u32),
    /// A number above 0 for each pixel. Images may share the map.
    Map(ArcArray<f32, Ix2>),
}

impl LocalTrials {
    /// Return the trials, limited to a range.
    pub(super) fn clamp(&self, (min, max): (u32, u32)) -> Self {
        match self {
            Self::Same(trials) => Self::Same((*trials).clamp(min, max)),
            Self::Map(map) => {
                let clamped = map.mapv(|n| n.clamp(min as f32, max as f32));
                Self::Map(clamped.into_shared())
            }
        }
    }

    /// Check that a map has the shape of its image.
    pub(super) fn check_shape(&self, image: (usize, usize)) -> Result<()> {
        match self {
            Self::Map(map) if map.dim() != image => Err(Error::shape("trials", image, map.dim())),
            _ => Ok(()),
        }
    }

    /// Return the largest number.
    pub(super) fn max(&self) -> f64 {
        match self {
            Self::Same(trials) => f64::from(*trials),
            Self::Map(map) => f64::from(map.iter().fold(0.0f32, |most, &n| most.max(n))),
        }
    }

    /// Return the trials as an array that broadcasts with an image.
    pub(super) fn to_array(&self) -> ArcArray<f32, Ix2> {
        match self {
            Self::Same(trials) => ArcArray::from_elem((1, 1), *trials as f32),
            Self::Map(map) => map.clone(),
        }
    }
}

/// Return the number of trials that states the noise around each pixel.
///
/// The noise of a fraction of ones is inversely proportional to its trials. A denoiser weighs a pixel
/// against its neighbors, so the mean noise around the pixel counts: the harmonic mean of the trials.
/// Where it is nearly the same everywhere, the result is one whole number.
///
/// # Errors
/// [`Error::Range`] for an image without pixels, and for trials that are not finite and above 0.
pub fn local_trials(trials: ArrayView2<'_, f64>) -> Result<LocalTrials> {
    let Some(&first) = trials.first() else {
        return Err(Error::range("trials", "at least one pixel", 0));
    };
    let is_wrong = |trials: &&f64| !(**trials > 0.0 && trials.is_finite());
    if let Some(wrong) = trials.iter().find(is_wrong) {
        let expected = "finite numbers above 0; fill pixels without readings before";
        return Err(Error::range("trials", expected, wrong));
    }
    if trials.iter().all(|other| other.total_cmp(&first).is_eq()) {
        return Ok(LocalTrials::Same(whole_trials(first)));
    }
    let noise = trials.mapv(|trials| (1.0 / trials) as f32);
    let noise = noise.insert_axis(Axis(0));
    let mut blurred = noise.clone();
    filter::blur(noise.view(), NEIGHBORHOOD, blurred.view_mut())?;
    let noise = blurred.index_axis_move(Axis(0), 0);
    let (low, high) = extremes(noise.view());
    if high <= NEAR_RATIO * low {
        let sum: f64 = noise.iter().copied().map(f64::from).sum();
        return Ok(LocalTrials::Same(whole_trials(noise.len() as f64 / sum)));
    }
    Ok(LocalTrials::Map(
        noise.mapv(|noise| 1.0 / noise).into_shared(),
    ))
}

/// Return the whole number of trials that serves a real one best, at least 1.
fn whole_trials(trials: f64) -> u32 {
    (trials + 1.0 - ROUNDED_UP).floor().max(1.0) as u32
}

/// Return the smallest and the largest number of a map.
pub(super) fn extremes(map: ArrayView2<'_, f32>) -> (f32, f32) {
    let start = (f32::INFINITY, f32::NEG_INFINITY);
    map.iter()
        .fold(start, |(low, high), &x| (low.min(x), high.max(x)))
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;

    #[test]
    fn local_trials_are_harmonic_means() -> Result<()> {
        let (height, width) = (30, 40);
        let image = Array2::from_shape_fn((height, width), |(row, column)| {
            let trials = 4.0 + f64::from((row * 7 + column * 13) as u32 % 23);
            if column < 20 { trials } else { 8.0 * trials }
        });
        for (trials, whole) in [(0.3, 1), (16.0, 16), (16.6, 16), (16.7, 17)] {
            let same = Array2::from_elem((3, 4), trials);
            let found = local_trials(same.view())?;
            assert!(matches!(found, LocalTrials::Same(number) if number == whole));
        }
        let LocalTrials::Map(found) = local_trials(image.view())? else {
            return Err(Error::range("local trials", "a map", "one number"));
        };
        let gaussian = |x: i32| (-0.5 * f64::from(x * x) / 9.0).exp();
        // Beyond the border, the pixels follow in reverse.
        let mirrored = |place: i32, length: usize| {
            let place = place.rem_euclid(2 * length as i32) as usize;
            place.min(2 * length - 1 - place)
        };
        for (row, column) in [(0, 0), (15, 20), (29, 3)] {
            let (mut total, mut sum) = (0.0, 0.0);
            for (i, j) in ndarray::indices((19, 19)) {
                let (i, j) = (i as i32 - 9, j as i32 - 9);
                let weight = gaussian(i) * gaussian(j);
                total += weight;
                sum += weight / image[[mirrored(row + i, height), mirrored(column + j, width)]];
            }
            let expected = total / sum;
            let found = f64::from(found[[row as usize, column as usize]]);
            assert!((found - expected).abs() < 1e-5 * expected);
        }
        Ok(())
    }
}
