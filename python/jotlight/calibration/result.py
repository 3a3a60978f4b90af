"""A calibration: what two captures reveal about the jots of a sensor."""

import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.calibration.bulk import Bulk
from jotlight.calibration.steadiness import Steadiness
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import Tensors, read_tensors, write_tensors

FORMAT = "jotlight calibration"
_VERSION = "1"

Map = npt.NDArray[np.float32]
Flags = npt.NDArray[np.bool_]
Ones = npt.NDArray[np.int32]

_MAPS = {
    "dark_counts": np.float32,
    "efficiency": np.float32,
    "mask": np.bool_,
    "hot": np.bool_,
    "dead": np.bool_,
    "dark_ones": np.int32,
    "flat_ones": np.int32,
    "dark_steadiness": np.float32,
    "flat_steadiness": np.float32,
}
"""The tensors of a file and their types."""

_REQUIRED = {"dark_counts", "mask", "hot", "dead", "dark_ones"}


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """The properties of the jots of a sensor, as :func:`jotlight.calibrate` finds them.

    Parameters
    ----------
    dark_counts : ndarray of float32, shape (H, W)
        d: detections per jot and frame without light.
    mask : ndarray of bool, shape (H, W)
        Jots that reconstruction ignores: dead ones, and hot ones with more dark counts than
        `max_dark`.
    hot, dead : ndarray of bool, shape (H, W)
        Jots whose dark counts the distribution of ordinary jots does not explain, and jots that
        respond too weakly or too strongly.
    efficiency : ndarray of float32, shape (H, W), optional
        η, the response relative to the strongest jot. None without a flat capture.
    scale : float
        The response of the strongest jot, in units of the median of the jots that are not masked.
    threshold : int
        q.
    false_positive_rate, max_dark : float
        The arguments of :func:`jotlight.calibrate`.
    bulk : Bulk
        The distribution of the dark counts of ordinary jots.
    hot_threshold : int
        Smallest count of a hot jot in the dark capture; N + 1 if an ordinary jot may have even N.
    hot_probability : float
        Probability that an ordinary jot reaches this count, from the fitted distribution.
    dark_ones, dark_frames : ndarray of int32, int
        The dark capture.
    flat_ones, flat_frames : ndarray of int32, int, optional
        The flat capture.
    prnu, prnu_error, flat_noise : float, optional
        Non-uniformity of the response, its standard error, and the counting noise in the response
        of one jot, as fractions of the response.
    dark_steadiness, flat_steadiness : Steadiness, optional
        The tests of the frames of the captures, if they contain single frames.
    provenance : dict
        Where the captures come from, and their orientation, if known, with the keys ``"dark"`` and
        ``"flat"``.
    """

    dark_counts: Map
    mask: Flags
    hot: Flags
    dead: Flags
    threshold: int
    false_positive_rate: float
    max_dark: float
    bulk: Bulk
    hot_threshold: int
    hot_probability: float
    dark_ones: Ones
    dark_frames: int
    efficiency: Map | None = None
    scale: float = 1.0
    flat_ones: Ones | None = None
    flat_frames: int | None = None
    prnu: float | None = None
    prnu_error: float | None = None
    flat_noise: float | None = None
    dark_steadiness: Steadiness | None = None
    flat_steadiness: Steadiness | None = None
    provenance: dict[str, Provenance] = dataclasses.field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of jots."""
        height, width = self.dark_counts.shape
        return height, width

    def insufficient_frames_reason(self) -> str | None:
        """Return why the dark capture has too few frames to find hot jots at the rate, or None."""
        if self.hot_threshold <= self.dark_frames:
            return None
        number = self.dark_frames
        probability = self.bulk.tail_probability(number)
        return f"{number} of {number} bits are ones by chance in {probability:.2g} of ordinary jots"

    def sensor(self, frames: int = 1, **changes: Any) -> Sensor:
        """Return a sensor with these maps.

        Unless the changes contain `gain`, a pixel of intensity 1 causes one detection per frame in
        the median jot.

        Parameters
        ----------
        frames : int
            T of the capture to reconstruct.
        **changes
            Parameters of :class:`jotlight.Sensor`, which replace those of the calibration.
        """
        return self.applied_to(Sensor(frames=frames, threshold=self.threshold), **changes)

    def applied_to(self, sensor: Sensor, **changes: Any) -> Sensor:
        """Return the sensor with these maps, and with a gain that refers to the median jot.

        Raises
        ------
        ValueError
            If the sensor contradicts the maps.
        """
        # Dark counts are detections, not bits, so they hold for any threshold.
        maps: dict[str, Any] = {"dark_counts": self.dark_counts}
        maps["mask"] = self.mask if self.mask.any() else None
        if self.efficiency is not None:
            maps["efficiency"] = self.efficiency
        scalars = {name: value for name, value in changes.items() if name not in maps}
        replaced = {name: value for name, value in changes.items() if name in maps}
        plain = sensor.replace(dark_counts=0.0, efficiency=1.0, mask=None, **scalars)
        if "gain" not in changes and "efficiency" not in changes and plain.gain is not None:
            plain = plain.replace(gain=plain.gain * self.scale)
        return plain.replace(**{**maps, **replaced})

    def check_capture(self, shape: tuple[int, ...], provenance: Provenance | None = None) -> None:
        """Raise ValueError unless a capture has the same size and orientation."""
        if tuple(shape) != self.shape:
            raise ValueError(
                f"calibration: it has {self.shape[0]} x {self.shape[1]} jots, and the capture "
                f"has {' x '.join(map(str, shape))}; calibrate with captures that are opened in "
                "the same way (--rotate, --flip, --width)"
            )
        for name, own in self.provenance.items():
            if provenance is not None:
                check_same_orientation("this", provenance, f"the calibration's {name}", own)

    def unconfirmed_reason(self, provenance: Provenance | None) -> str | None:
        """Return why a capture may have its jots in other places than the calibration, or None."""
        if provenance is None or provenance.orientation is None:
            return "the orientation of the capture is unknown"
        known = self.provenance.get("dark")
        if known is None or known.orientation is None:
            return "the orientation of the calibration is unknown"
        # A converted file has the orientation of its original.
        own, other = [*known.lineage()][-1].format, [*provenance.lineage()][-1].format
        if own != other:
            return f"the calibration is from {own} and the capture is from {other}"
        return None

    def metadata(self) -> dict[str, Any]:
        """Return all fields except the maps, by name, as values that JSON can hold."""
        values = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Bulk | Steadiness):
                value = {
                    part.name: getattr(value, part.name)
                    for part in dataclasses.fields(value)
                    if part.name != "map"
                }
            if field.name == "provenance":
                value = {name: provenance.to_json() for name, provenance in value.items()}
            if value is not None and not isinstance(value, np.ndarray):
                values[field.name] = value
        return values

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the calibration to a `.safetensors` file.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import jotlight as jl
        >>> dark = np.random.default_rng(0).binomial(1000, 0.01, (32, 32))
        >>> calibration = jl.calibrate(dark, frames=1000)
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "mine.safetensors"
        >>> calibration.save(path)
        >>> jl.Calibration.load(path).sensor(16) == calibration.sensor(16)
        True
        """
        tensors: Tensors = {}
        for name in _MAPS:
            value = getattr(self, name)
            value = value.map if isinstance(value, Steadiness) else value
            if value is not None:
                tensors[name] = np.ascontiguousarray(value)
        metadata = {
            "format": FORMAT,
            "version": _VERSION,
            "numbers": json.dumps(self.metadata(), sort_keys=True),
        }
        write_tensors(path, tensors, metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the calibration in a file that :meth:`save` wrote.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If it is damaged, or not a calibration.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        tensors, metadata = read_tensors(path, FORMAT, _VERSION)
        try:
            return cls(**_checked(tensors, json.loads(metadata.get("numbers", ""))))
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{path}: the calibration is damaged ({error})") from error


_STEADINESS = {"dark_steadiness", "flat_steadiness"}
_SCALARS = {
    "dark_frames": (1, 2**31, int),
    "threshold": (1, 2**31, int),
    "hot_threshold": (1, 2**31, int),
    "hot_probability": (0, 1, float),
    "false_positive_rate": (0, 1, float),
    "max_dark": (0, math.inf, float),
    "scale": (0, 1e6, float),
}
_FLAT_SCALARS = {
    "prnu": (0, math.inf, float),
    "prnu_error": (0, math.inf, float),
    "flat_noise": (0, math.inf, float),
}
"""Names, limits, and types of the numbers in a file. Those of a flat capture are optional."""


def _checked(tensors: Tensors, numbers: Any) -> dict[str, Any]:
    """Return the fields of a calibration from a file, or raise ValueError."""
    _check_tensors(tensors)
    known = {field.name for field in dataclasses.fields(Calibration)}
    if not isinstance(numbers, dict) or not numbers.keys() <= known - (_MAPS.keys() - _STEADINESS):
        raise ValueError("its metadata are not those of a calibration")
    values: dict[str, Any] = dict(numbers)
    for name, limits in _SCALARS.items():
        values[name] = _number(numbers.get(name), name, *limits)
    if any((name in numbers) != ("efficiency" in tensors) for name in _FLAT_SCALARS):
        raise ValueError(f"expected all of efficiency, {', '.join(_FLAT_SCALARS)}, or none")
    for name, limits in (_FLAT_SCALARS | {"flat_frames": (1, 2**31, int)}).items():
        if name in numbers:
            values[name] = _number(numbers[name], name, *limits)
    bulk = _object(numbers.get("bulk"), "bulk", {"frames", "mean", "spread"})
    values["bulk"] = Bulk(
        _number(bulk["frames"], "frames", 1, 2**31, int),
        _number(bulk["mean"], "mean", 0, 1),
        _number(bulk["spread"], "spread", 0, 100),
    )
    for name in _STEADINESS:
        if (name in numbers) != (name in tensors):
            raise ValueError(f"{name}: expected both a map and numbers")
        if name in numbers:
            values[name] = _steadiness(name, numbers[name], tensors[name])
    provenance = values.get("provenance", {})
    if not isinstance(provenance, dict) or not provenance.keys() <= {"dark", "flat"}:
        raise ValueError("provenance: expected an object with dark and flat")
    values["provenance"] = {name: Provenance.from_json(part) for name, part in provenance.items()}
    for name in _MAPS.keys() - _STEADINESS:
        values[name] = tensors.get(name)
    # The sensor checks the values of its maps.
    Sensor(
        dark_counts=values["dark_counts"],
        efficiency=1.0 if values["efficiency"] is None else values["efficiency"],
        mask=values["mask"],
    )
    return values


def _check_tensors(tensors: Tensors) -> None:
    """Raise ValueError unless the tensors are maps of one shape, with known names and types."""
    if not _REQUIRED <= tensors.keys() <= _MAPS.keys():
        raise ValueError(f"expected tensors {', '.join(_REQUIRED)}, got {', '.join(tensors)}")
    shape = tensors["mask"].shape
    for name, tensor in tensors.items():
        if tensor.dtype != _MAPS[name] or tensor.shape != shape or tensor.ndim != 2:
            raise ValueError(f"{name}: got {tensor.dtype} of shape {tensor.shape}")


def _steadiness(name: str, content: Any, map_: npt.NDArray[Any]) -> Steadiness:
    names = {field.name for field in dataclasses.fields(Steadiness)} - {"map"}
    values = _object(content, name, names)
    found = {part: _number(values[part], part, -math.inf, math.inf) for part in names}
    return Steadiness(**found, map=map_)


def check_same_orientation(
    name: str, provenance: Provenance, other_name: str, other: Provenance
) -> None:
    """Raise ValueError if two captures are known to have different orientations."""
    if (
        None not in (provenance.orientation, other.orientation)
        and provenance.orientation != other.orientation
    ):
        raise ValueError(
            f"calibration: {name} capture is {provenance.describe_orientation()}, and "
            f"{other_name} capture "
            f"{other.describe_orientation()}; open them in the same orientation "
            "(--rotate, --flip)"
        )


def _object(value: Any, name: str, keys: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict) or value.keys() != keys:
        raise ValueError(f"{name}: expected an object with {', '.join(sorted(keys))}")
    return value


def _number(value: Any, name: str, low: float, high: float, kind: type = float) -> Any:
    if type(value) not in (int, kind) or not low <= value <= high or math.isinf(value):
        raise ValueError(f"{name}: expected a number from {low:g} to {high:g}, got {value!r}")
    return kind(value)
