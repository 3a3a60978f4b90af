"""The sensor of a capture: that of its file, changed by a calibration and then by options."""

from typing import Any

from jotlight.calibration.result import Calibration
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor


def stated_sensor(
    stated: Sensor | None,
    calibration: Calibration | None,
    changes: dict[str, Any],
    *,
    frames: int,
    jots: tuple[int, ...],
    provenance: Provenance | None,
) -> Sensor:
    """Return the sensor of a capture: that of its file, changed by a calibration and by options.

    Parameters
    ----------
    stated : Sensor, optional
        The sensor that the file states.
    calibration : Calibration, optional
        A calibration of the same jots.
    changes : dict
        Parameters of :class:`jotlight.Sensor`, which replace those of the file and of the
        calibration.
    frames : int
        Number of frames, if neither the file nor the changes state it.
    jots : tuple of int
        (H, W): the size of the capture, with which the calibration is compared.
    provenance : Provenance, optional
        Where the capture comes from. None: only the size is compared.

    Raises
    ------
    ValueError
        When the calibration is of other jots, or the parameters contradict each other.

    Examples
    --------
    >>> capture = {"frames": 8, "jots": (4, 4), "provenance": None}
    >>> stated_sensor(None, None, {"gain": 3.0}, **capture)
    Sensor(frames=8, gain=3.0)
    >>> stated_sensor(jl.Sensor(frames=6, max_intensity=2.0), None, {"gain": 3.0}, **capture)
    Sensor(frames=6, gain=3.0, max_intensity=2.0)
    """
    if calibration is not None:
        calibration.check_capture(jots, provenance)
    if stated is None:
        make = Sensor if calibration is None else calibration.sensor
        return make(**{"frames": frames, **changes})
    if calibration is None:
        return stated.replace(**changes)
    return calibration.applied_to(stated, **changes)
