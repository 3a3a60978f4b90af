"""A calibration: what two captures tell of a sensor, as one file."""

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
"""All tensors that a file may have, with their types."""

_NEEDED = {"dark_counts", "mask", "hot", "dead", "dark_ones"}


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration:
    """What is known of a sensor's jots; made by :func:`jotlight.calibrate`.

    Parameters
    ----------
    dark_counts : ndarray of float32, shape (H, W)
        d: detections per frame without light.
    mask : ndarray of bool, shape (H, W)
        Jots that reconstruction does not look at: dead ones, and hot ones with more dark counts
        than `most_dark`.
    hot, dead : ndarray of bool, shape (H, W)
        Jots whose dark counts the bulk of the jots does not explain, and jots that do not respond.
    efficiency : ndarray of float32, shape (H, W), optional
        η, the response relative to the strongest. None without a flat capture.
    scale : float
        The response of the strongest jot, where the median of those not masked is 1.
    threshold : int
        q.
    false_positive_rate, most_dark : float
        As given to :func:`jotlight.calibrate`.
    bulk : Bulk
        The distribution of the dark counts of ordinary jots.
    hot_from : int
        Ones in the dark capture from which a jot is hot; N + 1 where even N of N could be chance.
    hot_chance : float
        The share of ordinary jots that have so many, by the fitted bulk.
    dark_ones, dark_frames : ndarray of int32, int
        The dark capture.
    flat_ones, flat_frames : ndarray of int32, int, optional
        The flat capture.
    prnu, prnu_error, flat_noise : float, optional
        Non-uniformity of the response, its standard error, and the noise of counting in the
        response of one jot, as shares of the response.
    dark_steadiness, flat_steadiness : Steadiness, optional
        What the frames of the captures told, where they were given one by one.
    provenance : dict
        Where the captures are from and how they were turned, by ``"dark"`` and ``"flat"``, as far
        as that is known.
    """

    dark_counts: Map
    mask: Flags
    hot: Flags
    dead: Flags
    threshold: int
    false_positive_rate: float
    most_dark: float
    bulk: Bulk
    hot_from: int
    hot_chance: float
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

    def too_few(self) -> str | None:
        """Say why the dark capture is too short to tell hot jots at the rate asked for, or None."""
        if self.hot_from <= self.dark_frames:
            return None
        number, chance = self.dark_frames, self.bulk.chance(self.dark_frames)
        return f"{number} of {number} bits are ones by chance in {chance:.2g} of ordinary jots"

    def sensor(self, frames: int = 1, **changes: Any) -> Sensor:
        """Give the sensor with these maps.

        Unless `gain` is among the changes, a pixel of intensity 1 gives an ordinary jot one
        detection per frame.

        Parameters
        ----------
        frames : int
            T of the capture to be reconstructed.
        **changes
            Parameters of :class:`jotlight.Sensor`, taken as they are.
        """
        return self.applied_to(Sensor(frames=frames, threshold=self.threshold), **changes)

    def applied_to(self, sensor: Sensor, **changes: Any) -> Sensor:
        """Give a sensor these maps; its gain counts the detections of an ordinary jot.

        Raises
        ------
        ValueError
            When the sensor is not consistent with them.
        """
        # Dark counts are detections, and not bits, so that they hold for any threshold.
        maps: dict[str, Any] = {"dark_counts": self.dark_counts}
        maps["mask"] = self.mask if self.mask.any() else None
        if self.efficiency is not None:
            maps["efficiency"] = self.efficiency
        numbers = {name: value for name, value in changes.items() if name not in maps}
        chosen = {name: value for name, value in changes.items() if name in maps}
        plain = sensor.replace(dark_counts=0.0, efficiency=1.0, mask=None, **numbers)
        if "gain" not in changes and "efficiency" not in changes and plain.gain is not None:
            plain = plain.replace(gain=plain.gain * self.scale)
        return plain.replace(**{**maps, **chosen})

    def check_capture(self, shape: tuple[int, ...], provenance: Provenance | None = None) -> None:
        """Raise ValueError unless a capture has as many rows and columns, and is turned alike."""
        if tuple(shape) != self.shape:
            raise ValueError(
                f"calibration: it is of {self.shape[0]} x {self.shape[1]} jots, and the capture "
                f"has {' x '.join(map(str, shape))}; make it from captures that are opened in the "
                "same way (--rotate, --flip, --width)"
            )
        for name, own in self.provenance.items():
            if provenance is not None:
                check_alike("this", provenance, f"the calibration's {name}", own)

    def unsure(self, provenance: Provenance | None) -> str | None:
        """Say why nothing tells that a capture's jots lie as they do here, or None."""
        if provenance is None or provenance.orientation is None:
            return "how the capture was turned is not known"
        known = self.provenance.get("dark")
        if known is None or known.orientation is None:
            return "how the captures of the calibration were turned is not known"
        # Files that were converted lie as those that they were made of.
        own, its = [*known.lineage()][-1].format, [*provenance.lineage()][-1].format
        if own != its:
            return f"the calibration is from {own} and the capture is {its}"
        return None

    def numbers(self) -> dict[str, Any]:
        """All that is not a map, by name; JSON can hold it."""
        told = {}
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
                told[field.name] = value
        return told

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all of it to one `.safetensors` file.

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
            "numbers": json.dumps(self.numbers(), sort_keys=True),
        }
        write_tensors(path, tensors, metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read what :meth:`save` wrote.

        Raises
        ------
        OSError
            When the file cannot be read.
        ValueError
            When it is damaged, or no calibration.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        tensors, metadata = read_tensors(path, FORMAT, _VERSION)
        try:
            return cls(**_checked(tensors, json.loads(metadata.get("numbers", ""))))
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{path}: the calibration is damaged ({error})") from error


def _checked(tensors: Tensors, numbers: Any) -> dict[str, Any]:
    """The parameters of a calibration from what a file holds, or ValueError."""
    if not _NEEDED <= tensors.keys() <= _MAPS.keys():
        raise ValueError(f"expected tensors {', '.join(_NEEDED)}, got {', '.join(tensors)}")
    shape = tensors["mask"].shape
    for name, tensor in tensors.items():
        if tensor.dtype != _MAPS[name] or tensor.shape != shape or tensor.ndim != 2:
            raise ValueError(f"{name}: got {tensor.dtype} of shape {tensor.shape}")
    known = {field.name for field in dataclasses.fields(Calibration)}
    known = known | {"files"}
    if not isinstance(numbers, dict) or not numbers.keys() <= known - (
        _MAPS.keys() - {"dark_steadiness", "flat_steadiness"}
    ):
        raise ValueError("its numbers are not those of a calibration")
    values: dict[str, Any] = dict(numbers)
    for name in ("dark_frames", "threshold", "hot_from"):
        values[name] = _number(numbers.get(name), name, 1, 2**31, int)
    for name, least, most in (
        ("false_positive_rate", 0, 1), ("most_dark", 0, math.inf), ("scale", 0, 1e6),
    ):  # fmt: skip
        values[name] = _number(numbers.get(name), name, least, most)
    of_flat = ("prnu", "prnu_error", "flat_noise")
    if any((name in numbers) != ("efficiency" in tensors) for name in of_flat):
        raise ValueError(f"expected efficiency, {', '.join(of_flat)}, or none of them")
    for name in of_flat:
        if name in numbers:
            values[name] = _number(numbers[name], name, 0, math.inf)
    if "flat_frames" in numbers:
        values["flat_frames"] = _number(numbers["flat_frames"], "flat_frames", 1, 2**31, int)
    bulk = _object(numbers.get("bulk"), "bulk", {"frames", "mean", "spread"})
    values["bulk"] = Bulk(
        _number(bulk["frames"], "frames", 1, 2**31, int),
        _number(bulk["mean"], "mean", 0, 1),
        _number(bulk["spread"], "spread", 0, 100),
    )
    # Earlier calibrations do not tell it.
    values["hot_chance"] = _number(
        numbers.get("hot_chance", values["bulk"].chance(values["hot_from"])), "hot_chance", 0, 1
    )
    names = {field.name for field in dataclasses.fields(Steadiness)} - {"map"}
    for name in ("dark_steadiness", "flat_steadiness"):
        if (name in numbers) != (name in tensors):
            raise ValueError(f"{name}: expected a map and numbers")
        if name in numbers:
            told = _object(numbers[name], name, names)
            found = {part: _number(told[part], part, -math.inf, math.inf) for part in names}
            values[name] = Steadiness(**found, map=tensors[name])
    # Earlier calibrations name files and nothing more, which is not used.
    values.pop("files", None)
    provenance = values.get("provenance", {})
    if not isinstance(provenance, dict) or not provenance.keys() <= {"dark", "flat"}:
        raise ValueError("provenance: expected an object with dark and flat")
    values["provenance"] = {name: Provenance.from_json(told) for name, told in provenance.items()}
    for name in _MAPS.keys() - {"dark_steadiness", "flat_steadiness"}:
        values[name] = tensors.get(name)
    # What the sensor says of its maps holds here.
    Sensor(
        dark_counts=values["dark_counts"],
        efficiency=1.0 if values["efficiency"] is None else values["efficiency"],
        mask=values["mask"],
    )
    return values


def check_alike(name: str, provenance: Provenance, other_name: str, other: Provenance) -> None:
    """Raise ValueError when two captures are known to be turned in different ways."""
    if (
        None not in (provenance.orientation, other.orientation)
        and provenance.orientation != other.orientation
    ):
        raise ValueError(
            f"calibration: {name} capture is {provenance.describe_orientation()}, and "
            f"{other_name} capture "
            f"{other.describe_orientation()}; open them so that they are turned alike "
            "(--rotate, --flip)"
        )


def _object(value: Any, name: str, keys: set[str]) -> dict[str, Any]:
    if not isinstance(value, dict) or value.keys() != keys:
        raise ValueError(f"{name}: expected an object with {', '.join(sorted(keys))}")
    return value


def _number(value: Any, name: str, least: float, most: float, kind: type = float) -> Any:
    if type(value) not in (int, kind) or not least <= value <= most or math.isinf(value):
        raise ValueError(f"{name}: expected a number from {least:g} to {most:g}, got {value!r}")
    return kind(value)
