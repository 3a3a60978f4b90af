"""Checks of all parameters of a sensor together, and other names that they have."""

from collections.abc import Mapping
from typing import Any

from jotlight.checks import number_in_range, refuse_masked, whole_number_in_range
from jotlight.sensing.parameters import reading_checks
from jotlight.sensing.parameters.maps import LIMITS, MAPS, checked_maps
from jotlight.sensing.parameters.mosaic import Mosaic

SYNONYMS = {
    "k_hat": "oversampling",
    "t": "frames",
    "k": "frames (K is frames * oversampling**2)",
    "exposure": "gain (photons), or exposure_time (seconds)",
    "alpha": "gain",
    "q": "threshold",
    "psf": "kernel",
    "dcr": "dark_counts (DCR * exposure time)",
    "dark_count_rate": "dark_counts (DCR * exposure time)",
    "d": "dark_counts",
    "eta": "efficiency",
    "pde": "efficiency",
    "qe": "efficiency",
    "s": "max_intensity",
    "sigma": "read_noise",
    "bayer": "mosaic",
    "cfa": "mosaic",
    "dead_time": "jotlight.FreeRunning(dead_time=...)",
}
"""Symbols of the parameters, and their names in data sheets and in other software."""


def checked_parameters(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a sensor by name, as it stores them.

    Parameters
    ----------
    given : mapping
        All parameters of :class:`jotlight.Sensor`. Its kernel is not checked.

    Raises
    ------
    TypeError
        When a map is a masked array.
    ValueError
        When a value is out of range, or the values do not fit together.
    """
    for name in ("gain", *MAPS):
        advice = "fill it, such as with array.filled(value), and pass its mask as mask="
        refuse_masked(name, given[name], advice)
    checked = dict(given)
    for name, maximum in (("oversampling", 4096), ("frames", 2**31 - 1)):
        checked[name] = whole_number_in_range(name, given[name], 1, maximum)
    frames = checked["frames"]
    trials = frames * checked["oversampling"] ** 2
    if trials >= 2**31:
        raise ValueError(
            f"oversampling**2 * frames: expected fewer than 2**31 trials per pixel, got {trials}"
        )
    gain = trials if given["gain"] is None else given["gain"]
    checked["gain"] = reading_checks.checked_gain(gain, frames)
    checked["threshold"] = reading_checks.checked_threshold(given["threshold"], frames)
    for name in ("max_intensity", *(["exposure_time"] * (given["exposure_time"] is not None))):
        checked[name] = number_in_range(name, given[name], *LIMITS)
    checked |= reading_checks.checked_response(
        given["bit_depth"], given["read_noise"], checked["threshold"]
    )
    maps = (given["dark_counts"], given["efficiency"], given["mask"])
    checked |= checked_maps(*maps, checked["threshold"])
    if given["mosaic"] is not None:
        checked["mosaic"] = Mosaic.of(given["mosaic"])
        if given["kernel"] != "box":
            raise ValueError(
                f"kernel: expected the box kernel with a mosaic, got {given['kernel']!r}, which "
                "would mix the light of neighboring filters"
            )
    return checked
