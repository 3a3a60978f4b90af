"""The number of trials from which a comparison with other methods pays."""

from jotlight.estimators.readings.typical_trials import typical_trials
from jotlight.sensing.sensor import Sensor

MAX_NETWORK_TRIALS = 1000
"""Largest K up to which the default needs no comparison with methods that trust the data more."""


def trials_of(sensor: Sensor) -> float:
    """Return about how many trials a pixel has: its readings, or more if these have several bits.

    Examples
    --------
    >>> several_bits = jl.Sensor(frames=64, gain=64.0, bit_depth=3)
    >>> trials_of(jl.Sensor(frames=16)), round(trials_of(several_bits))
    (16.0, 271)
    """
    # In a bracket for a wide range of light, typical light has fewer trials than readings.
    return max(float(sensor.trials), typical_trials(sensor))


def takes_blend(sensor: Sensor, trials: float) -> bool:
    """Return whether the blend on held-out bits is recommended for a number of trials per pixel.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=2000)
    >>> takes_blend(sensor, trials_of(sensor)), takes_blend(sensor.replace(kernel="cubic"), 2000)
    (True, False)
    """
    return trials > MAX_NETWORK_TRIALS and sensor.kernel == "box"
