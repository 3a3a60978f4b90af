"""Dark regions: the engine gives an estimate the mean of the bits there.

Networks were trained for scenes in which ones are frequent. Where nearly no bit is 1, the
probabilities that they return may be far too large. Behind a threshold above 1, such regions would
look bright. Yet the bits of a neighborhood show its mean well.
"""

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.estimators.trial_levels import LocalTrials
from jotlight.networks.inference.engine_backed import sensor_model
from jotlight.sensing.sensor import Sensor


def may_have_dark_regions(image: Image, sensor: Sensor) -> bool:
    """Return whether an estimate has dark pixels whose brightness would be wrong.

    For a threshold of 1, a wrong small p is a wrong small intensity, which matters little.

    Parameters
    ----------
    image : ndarray of float32, shape (H, W)
        The estimate.
    sensor : Sensor
        The sensor.

    Examples
    --------
    >>> image = np.full((4, 4), 0.1, np.float32)
    >>> several = jl.Sensor(frames=16, gain=16.0, threshold=3)
    >>> may_have_dark_regions(image, several), may_have_dark_regions(image, jl.Sensor(frames=16))
    (True, False)
    """
    return engine.may_have_dark_regions(image, sensor_model(sensor))


def match_dark_regions(
    probability: Image,
    fraction: Image,
    trials: LocalTrials,
    threshold: int,
    threads: int | None = None,
) -> Image:
    """Return probabilities of a one whose means in dark regions are those of the bits, (H, W).

    Parameters
    ----------
    probability : ndarray of float32, shape (H, W)
        Probabilities by a network. Those below 0 count as 0.
    fraction : ndarray of float32, shape (H, W)
        Fractions of ones, finite and at least 0.
    trials : int or ndarray of float32, shape (H, W)
        The local number of trials.
    threshold : int
        The threshold q.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    ValueError
        When a fraction is not finite or below 0, or the shapes do not match.

    Examples
    --------
    >>> wrong, zeros = np.full((8, 8), 1e-3, np.float32), np.zeros((8, 8), np.float32)
    >>> for threshold in (1, 4):
    ...     print(f"{match_dark_regions(wrong, zeros, 64, threshold).mean():.1e}")
    1.2e-05
    2.8e-07
    """
    return engine.match_dark_regions(probability, fraction, trials, threshold, threads)
