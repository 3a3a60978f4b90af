"""Equivalent counts near estimates of the intensities, for methods that take counts."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Pattern
from jotlight.estimators.demosaicing import COLORS, brightest_mean, demosaic
from jotlight.estimators.merge_readings import linear_counts, mean_jots, merge_joint, min_light
from jotlight.estimators.readings.joint_mle import maximize, solve_expected_total
from jotlight.estimators.readings.neighbors import (
    MAX_FILTERS,
    MAX_FRACTION,
    average_fractions,
    common_intensity,
    min_intensity,
    toward_own,
    typical_spread,
)
from jotlight.estimators.readings.reference_sensors import MAX_TRIALS, light_share, reference_sensor
from jotlight.estimators.readings.whole_counts import complete_trials, whole_counts
from jotlight.kept import kept_property
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood, joint_likelihood
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.maps import pixel_means
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.response import intensity_at_probability
from jotlight.sensing.sensor import Sensor

_MAP_SIGMA = 0.4
"""Standard deviation of the filter of the counts, in pixels, for maps of thresholds.

Some of their pixels say much and their neighbors little, and denoisers take both for equally good.
"""

_ALIKE = 0.9
"""Fraction of the pixels with the same thresholds from which pixels count as alike. If the jots of
each pixel have all thresholds, an average would only hide noise from denoisers and intervals."""


@dataclasses.dataclass(frozen=True)
class Merging:
    """Equivalent counts of an image near several estimates of its intensities.

    What does not depend on the estimate is computed once.
    """

    joint: JointLikelihood
    """The likelihood of the readings."""

    @kept_property
    def maximum(self) -> Array:
        """The most likely intensity of each pixel, (H, W)."""
        return maximize(self.joint)

    @kept_property
    def thresholds_differ(self) -> bool:
        """Whether pixels have different thresholds."""
        if np.ndim(self.joint.sensor.threshold) < 2:
            return False
        kinds = _kinds_of_pixels(self.joint, None)
        return bool(np.bincount(kinds.ravel()).max() < _ALIKE * kinds.size)

    def near_neighbors(self, mosaic: Mosaic | None = None) -> Merged:
        """Return counts as :meth:`near` does, near averages over the neighbors of each pixel.

        Parameters
        ----------
        mosaic : Mosaic, optional
            The filters. Only neighbors with the same one are averaged. If there are more than three
            filters, their averages become colors, as the information behind each filter permits.

        Examples
        --------
        >>> from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
        >>> sensor = jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0])
        >>> bits = sensor.expose(np.full((64, 64), 0.6), rng=0)
        >>> merged = Merging(joint_likelihood(bits, sensor, None)).near_neighbors()
        >>> bool(abs(merged.ones.sum() / merged.trials.sum() - (1 - np.exp(-0.6))) < 0.02)
        True
        """
        joint = self.joint
        if joint.sensor.has_plain_bits and not _jots_of_pixels_differ(joint):
            return merge_joint(joint)
        sigma = typical_spread(float(np.mean(joint.trials)), _typical_information(joint))
        pattern = None if mosaic is None else mosaic.full(*joint.shape)
        near = _average(joint, sigma, pattern)
        if mosaic is not None and pattern is not None and len(np.unique(pattern)) > COLORS:
            near = _behind_filters(joint, near, mosaic, pattern)
        return self.near(near, pattern)

    def near(
        self,
        intensity: npt.NDArray[np.floating],
        pattern: npt.NDArray[np.integer] | None = None,
    ) -> Merged:
        """Return counts whose likelihood near given intensities is close to that of the readings.

        The derivative of the log-likelihood and the information are those at the given
        intensities. :func:`jotlight.merge_readings` takes them at the most likely intensity of each
        pixel. So the trials do not depend on the noise of a pixel, and the ones are a linear
        function of its readings, without bias. The higher the signal-to-noise ratio of a pixel, the
        closer the intensity is to the most likely one instead: halfway at a ratio of 10. At a high
        ratio, the most likely intensity is usually closer to the truth than the given one.

        Pixels of less than one trial are completed to one, which agrees with the given intensity.
        The ones are rounded such that the errors of neighbors cancel. Where rounding makes more
        ones than trials, the next pixels have fewer trials. Where the thresholds of pixels differ,
        counts are averaged over the nearest neighbors, unless there is a mosaic.

        Parameters
        ----------
        intensity : ndarray of float, shape (H, W)
            Intensities in [0, S] near the true ones, with the S of the sensor of the likelihood.
        pattern : ndarray of int, shape (H, W), optional
            The filter of each pixel of a mosaic. Errors of rounding cancel among pixels with the
            same filter. Default: all pixels have the same one.

        Examples
        --------
        >>> from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
        >>> sensor = jl.Sensor(frames=2, gain=[1.0, 3.0], max_intensity=9.0)
        >>> joint = joint_likelihood(jl.Bits.from_array(np.ones((2, 1, 100), bool)), sensor, None)
        >>> merged = Merging(joint).near(np.full((1, 100), 0.5))
        >>> int(merged.ones.sum()), round(float(merged.trials.sum()))
        (199, 268)
        """
        from scipy.ndimage import gaussian_filter

        joint, near = self.joint, intensity.astype(np.float64)
        if not self.thresholds_differ:  # the counts of others are averaged, so intensities stay
            near = self._toward_most_likely(near)
        ones, trials, rate = _real_counts(joint, near)
        reference = reference_sensor(joint.sensor)
        threshold = int(reference.threshold)
        ones, trials = complete_trials(ones, trials, rate, joint.trials > 0, threshold)
        if pattern is None and self.thresholds_differ:
            ones, trials = (gaussian_filter(part, _MAP_SIGMA) for part in (ones, trials))
        ones, trials = np.minimum(ones, MAX_TRIALS), np.minimum(trials, MAX_TRIALS)
        whole, trials = whole_counts(ones, trials, pattern, joint.threads)
        efficiency, dark_counts = _jots_of_counts(joint.sensor, reference)
        share = light_share(joint.sensor, reference)
        return Merged(
            whole,
            trials,
            reference,
            dark_counts=dark_counts,
            efficiency=efficiency,
            light_share=share,
            valid_up_to=reference.max_intensity,
        )

    def _toward_most_likely(self, near: Array) -> Array:
        """Return intensities between given ones and the most likely ones, (H, W)."""
        least = min_intensity(self.joint.sensor)
        known = self.joint.information(np.maximum(near, least))
        return toward_own(near, self.maximum, known)


def merge_different_jots(
    images: GrayImages, sensor: Sensor, threads: int | None
) -> tuple[GrayImages, Sensor]:
    """Return equivalent counts of bits if the jots of a pixel differ, and their sensor.

    A count does not say which of these jots reported the ones. Other data are returned as they are.

    Parameters
    ----------
    images : GrayImages
        Data of a sensor with plain bits.
    sensor : Sensor
        The sensor.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import gray_images
    >>> efficiency = np.where(np.indices((4, 4))[1] % 2, 1.0, 0.2)
    >>> sensor = jl.Sensor(oversampling=2, frames=8, gain=64.0, efficiency=efficiency)
    >>> images = gray_images(sensor.expose(np.full((2, 2), 0.5), rng=0))
    >>> merge_different_jots(images, sensor, None)[0].data[0].shape
    (2, 2)
    """
    differ = any(
        pixel_means(value, sensor.mask, sensor.oversampling)[1]
        for value in (sensor.efficiency, sensor.dark_counts)
    )
    if not differ or not all(isinstance(each, Bits) for each in images.data):
        return images, sensor
    joints = (joint_likelihood(each, sensor, threads) for each in images.data)
    merged = [Merging(joint).near_neighbors() for joint in joints]
    return GrayImages(merged, images.layout), reference_sensor(sensor)


def _behind_filters(joint: JointLikelihood, near: Array, mosaic: Mosaic, pattern: Pattern) -> Array:
    """Return the intensities behind the filters of the colors that averages determine, (H, W).

    Where clear pixels are saturated, their own averages would be too dark.
    """
    sensitivity = mosaic.sensitivity[pattern]
    values = near / sensitivity
    bright = brightest_mean(values, pattern) * sensitivity
    known = joint.information(np.maximum(bright, min_intensity(joint.sensor)))
    weights = np.where(joint.trials > 0, known * sensitivity**2, 0.0)
    colors = demosaic(values, mosaic.without_white_balance(), "differences", weights)
    return np.asarray(mosaic.light(np.maximum(colors, 0)))


def _average(joint: JointLikelihood, spread: float, pattern: Pattern | None) -> Array:
    """Return the intensity that the readings around each pixel have in common, (H, W).

    It is that at which their sum is expected. The sums of pixels with different thresholds cannot
    be compared. So each kind of pixels has averages of its own first, and the equivalent counts
    near them are averaged.
    """
    if np.ndim(joint.sensor.threshold) < 2:
        return common_intensity(joint, spread, pattern)
    kinds = _kinds_of_pixels(joint, pattern)
    if kinds.max() < MAX_FILTERS:
        ones, trials = _real_counts(joint, common_intensity(joint, spread, kinds))[:2]
    else:
        merged = merge_joint(joint)
        ones, trials = merged.ones.astype(np.float64), np.broadcast_to(merged.trials, joint.shape)
    return _intensity(average_fractions(ones, trials, spread, pattern), joint.sensor)


def _intensity(fraction: Array, sensor: Sensor) -> Array:
    """Return the intensity at which equivalent counts have a fraction of ones, (H, W)."""
    reference = reference_sensor(sensor)
    efficiency, dark_counts = _jots_of_counts(sensor, reference)
    one = np.clip(fraction, 0, MAX_FRACTION)
    # Dead pixels have no efficiency.
    slope = np.where(efficiency > 0, efficiency, 1.0) * reference.light_per_intensity
    threshold = int(reference.threshold)
    return np.maximum(intensity_at_probability(threshold, one, 1 - one, slope, dark_counts), 0)


def _jots_of_counts(sensor: Sensor, reference: Sensor) -> tuple[float | Array, float | Array]:
    """Return the efficiency and the dark counts of the jots to which equivalent counts refer.

    These are the jots of each pixel. Counts of a map of thresholds are averaged over neighbors, so
    all of them refer to the same jot.
    """
    return reference_jot(reference) if np.ndim(sensor.threshold) == 2 else mean_jots(reference)


def _typical_information(joint: JointLikelihood) -> float:
    """Return the mean information of a pixel about the logarithm of its intensity.

    The intensity is the one that explains the sum of all readings.
    """
    fraction = joint.total.sum() / max(float(joint.max_total.sum()), 1.0)
    light = solve_expected_total(joint, fraction * joint.max_total)
    light = np.maximum(light, min_intensity(joint.sensor))
    return float(np.mean(light**2 * joint.information(light)))


def _kinds_of_pixels(joint: JointLikelihood, pattern: Pattern | None) -> npt.NDArray[np.integer]:
    """Return whole numbers from 0 that tell filters and thresholds of pixels apart, (H, W)."""
    kinds = np.zeros(joint.shape, np.int64) if pattern is None else pattern.astype(np.int64)
    for term in joint.terms:
        kinds = 2 * kinds + (term.sum_pixels(term.trials) > 0)
        # Numbers without gaps stay small for any number of terms.
        kinds = np.unique(kinds, return_inverse=True)[1].reshape(joint.shape)
    return kinds


def _jots_of_pixels_differ(joint: JointLikelihood) -> bool:
    """Return whether the jots of one pixel differ in their efficiency or their dark counts."""
    return any(term.side > 1 for term in joint.terms)


def _real_counts(
    joint: JointLikelihood, intensity: npt.NDArray[np.floating]
) -> tuple[Array, Array, Array]:
    """Return the ones and the trials near intensities, and the rates of a trial there, (H, W)."""
    reference, largest = reference_sensor(joint.sensor), joint.sensor.max_intensity
    efficiency, dark_counts = _jots_of_counts(joint.sensor, reference)
    least = np.maximum(min_intensity(joint.sensor), min_light(joint))
    near = np.clip(intensity.astype(np.float64), least, largest)
    slope = efficiency * reference.light_per_intensity
    rate = np.asarray(slope * near + dark_counts)
    is_known = joint.trials > 0
    gradient = np.where(is_known, joint.gradient_and_curvature(near)[0], 0.0)
    information = np.where(is_known, joint.information(near), 0.0)
    with np.errstate(over="ignore"):  # where some jots of a pixel are far from saturated
        threshold = int(reference.threshold)
        ones, trials = linear_counts(gradient, information, slope, rate, rate, threshold)
    return ones, trials, rate
