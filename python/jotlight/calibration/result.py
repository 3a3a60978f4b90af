"""A calibration: what two captures reveal about the jots of a sensor."""

from __future__ import annotations

import dataclasses
import json
import os
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.calibration.agreement import warn_about_conflict
from jotlight.calibration.bulk import Bulk
from jotlight.calibration.captured_sensor import refuse_read_noise
from jotlight.calibration.fields import CalibrationFields
from jotlight.calibration.figure import facts, page
from jotlight.calibration.files import MAPS, checked_fields
from jotlight.calibration.jot_mosaics import mosaic_of_pixels
from jotlight.calibration.steadiness import Steadiness
from jotlight.notebook import card, normalize
from jotlight.paths import as_path, as_tensors_path
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.crop import noted_region
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import Tensors, read_tensors, write_tensors

if TYPE_CHECKING:
    from jotlight.figures import Figure

FORMAT = "jotlight calibration"
_VERSION = "1"


@dataclasses.dataclass(frozen=True, eq=False)
class Calibration(CalibrationFields):
    """The properties of the jots of a sensor, as :func:`jotlight.calibrate` finds them.

    Parameters
    ----------
    dark_counts : ndarray of float32, shape (H, W)
        d: detections per jot and frame without light. For threshold 1, those of ordinary jots
        are shrunk toward their mean according to their counting noise.
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
        Smallest count of a hot jot in the dark capture; T + 1 if even T is too probable for an
        ordinary jot.
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
    mosaic : jotlight.Mosaic, optional
        The color filters of the jots. None for a gray sensor, and without a flat capture.
    provenance : dict
        Where the captures come from, and their orientation and region, if known, with the keys
        ``"dark"`` and ``"flat"``.
    """

    def sensor(self, frames: int | Bits = 1, **changes: Any) -> Sensor:
        """Return a sensor with these maps, for a capture or for a number of frames.

        A pixel of intensity 1 causes one detection per frame in the median jot, unless the changes
        contain `gain` or the bits carry a sensor, whose gain then refers to the median jot.

        Parameters
        ----------
        frames : int or Bits
            The bits to reconstruct, or only their number of frames T. Bits are compared with the
            calibration. A number says nothing about the jots, so nothing is compared.
        **changes
            Parameters of :class:`jotlight.Sensor`, which replace those of the calibration.

        Raises
        ------
        TypeError, ValueError
            When the bits have another size, orientation, or region than the calibration, or when
            the sensor has read noise, which the dark counts of the calibration contain.

        Warns
        -----
        JotlightWarning
            When most jots with many dark counts do not show them in the bits.

        Examples
        --------
        >>> import jotlight as jl
        >>> dark = np.random.default_rng(0).binomial(1000, 0.01, (32, 48))
        >>> calibration = jl.calibrate(dark, frames=1000)
        >>> bits = jl.Bits.from_array(np.zeros((16, 32, 48), bool))
        >>> calibration.sensor(bits).frames
        16
        >>> calibration.sensor(jl.Bits.from_array(np.zeros((16, 32, 40), bool)))
        Traceback (most recent call last):
          ...
        ValueError: calibration: it has 32 x 48 jots, and the capture has 32 x 40; ...
        """
        if not isinstance(frames, Bits):
            if np.ndim(frames):
                raise TypeError(
                    "frames: expected jotlight.Bits or the number of frames, got "
                    f"{type(frames).__name__} of shape {np.shape(frames)}; Bits.from_array packs "
                    "an array of 0 and 1"
                )
            return self.applied_to(Sensor(frames=frames, threshold=self.threshold), **changes)
        self.check_capture(frames.shape[1:3], frames.provenance)
        own = carried_sensor(frames)
        if own is None:
            own = Sensor(frames=len(frames), threshold=self.threshold)
        sensor = self.applied_to(own, **changes)
        warn_about_conflict(frames, sensor)
        return sensor

    def applied_to(self, sensor: Sensor, **changes: Any) -> Sensor:
        """Return the sensor with these maps, and with a gain that refers to the median jot.

        A jot is masked if the sensor or the calibration masks it. Without a flat capture, the
        sensor keeps its efficiency. A sensor with a mosaic keeps it. The changes override the
        sensor and the calibration.

        Raises
        ------
        ValueError
            If the sensor contradicts the maps, its pixels have jots behind several filters, or it
            has read noise, unless the changes contain `dark_counts`.
        """
        # Dark counts are detections, not bits, so they hold for any threshold.
        maps: dict[str, Any] = {"dark_counts": self.dark_counts, "mask": self._joined(sensor.mask)}
        if self.efficiency is not None:
            maps["efficiency"] = self.efficiency
        if self.mosaic is not None and sensor.mosaic is None and "mosaic" not in changes:
            side = changes.get("oversampling", sensor.oversampling)
            maps["mosaic"] = mosaic_of_pixels(self.mosaic, side)
        applied = sensor.replace(**{**maps, **changes})
        if "dark_counts" not in changes:
            refuse_read_noise(applied)
        if "gain" in changes or "efficiency" in changes:
            return applied
        return applied.replace(gain=applied.gain * self.scale)

    def _joined(self, mask: npt.NDArray[np.bool_] | None) -> npt.NDArray[np.bool_] | None:
        """Return the mask of jots that this calibration or another mask contains, or None."""
        if mask is None:
            return self.mask if self.mask.any() else None
        if mask.shape != self.shape:
            raise ValueError(
                f"sensor: expected a mask of the shape of the calibration {self.shape}, got "
                f"{mask.shape}"
            )
        return self.mask | mask

    def check_capture(self, shape: tuple[int, ...], provenance: Provenance | None = None) -> None:
        """Raise ValueError unless a capture has the same size, orientation, and region."""
        if tuple(shape) != self.shape:
            raise ValueError(
                f"calibration: it has {self.shape[0]} x {self.shape[1]} jots, and the capture "
                f"has {' x '.join(map(str, shape))}; calibrate with captures that are opened in "
                "the same way (--rotate, --flip, --width, --region)"
            )
        for name, own in self.provenance.items():
            if provenance is not None:
                check_same_jots("this", provenance, f"the calibration's {name}", own)

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
        if noted_region(known) != noted_region(provenance):
            return (
                f"the calibration is of {_region_words(known)}, and the capture is of "
                f"{_region_words(provenance)}"
            )
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
            if isinstance(value, Mosaic):
                value = value.to_json()
            if field.name == "provenance":
                value = {name: provenance.to_json() for name, provenance in value.items()}
            if value is not None and not isinstance(value, np.ndarray):
                values[field.name] = value
        return values

    def _maps(self) -> Tensors:
        """Return all maps over the jots by name, (H, W)."""
        tensors: Tensors = {}
        for name in MAPS:
            value = getattr(self, name)
            value = value.map if isinstance(value, Steadiness) else value
            if value is not None:
                tensors[name] = np.ascontiguousarray(value)
        return tensors

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Calibration):
            return NotImplemented
        mine, theirs = self._maps(), other._maps()
        return (
            self.metadata() == other.metadata()
            and mine.keys() == theirs.keys()
            and all(np.array_equal(mine[name], theirs[name]) for name in mine)
        )

    def __hash__(self) -> int:
        return hash((self.shape, self.dark_frames, self.flat_frames, int(self.dark_ones.sum())))

    def plot(self) -> Figure:
        """Return a figure with the maps, the distributions and their limits, and the numbers."""
        return page(self)

    def _repr_html_(self) -> str:
        # One count in all frames replaces 0, because the logarithm of 0 is infinite.
        smallest = 1 / self.dark_frames
        image = np.log(np.maximum(self.dark_counts, smallest) / smallest)
        shown = {"image": "dark counts, logarithmic"}
        return card("Calibration", {**dict(facts(self)), **shown}, normalize(image))

    def __repr__(self) -> str:
        parts = [
            f"{self.shape[0]} x {self.shape[1]} jots",
            f"dark counts {np.median(self.dark_counts):.3g} per frame in the median",
            f"hot {self.hot.mean():.2%}",
            f"masked {self.mask.mean():.2%}",
        ]
        if self.prnu is not None:
            parts.append(f"PRNU {self.prnu:.2%}")
        return f"<Calibration: {', '.join(parts)}>"

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
        >>> jl.Calibration.load(path) == calibration
        True
        """
        path = as_tensors_path(path, 'calibration.save("camera.safetensors")')
        metadata = {
            "format": FORMAT,
            "version": _VERSION,
            "numbers": json.dumps(self.metadata(), sort_keys=True),
        }
        write_tensors(path, self._maps(), metadata)

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
        path = as_path(path, 'jotlight.Calibration.load("camera.safetensors")')
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        tensors, metadata = read_tensors(path, FORMAT, _VERSION)
        try:
            return cls(**checked_fields(tensors, json.loads(metadata.get("numbers", ""))))
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{path}: the calibration is damaged ({error})") from error


def check_same_jots(name: str, provenance: Provenance, other_name: str, other: Provenance) -> None:
    """Raise ValueError if two captures are known to have different orientations or regions."""
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
    region, other_region = noted_region(provenance), noted_region(other)
    # Rows of frames of different sizes may be the same jots, because cameras crop, too.
    if (
        region is not None
        and other_region is not None
        and region != other_region
        and region[1] == other_region[1]
    ):
        raise ValueError(
            f"calibration: {name} capture is of {_region_words(provenance)}, and {other_name} "
            f"capture is of {_region_words(other)}; open them with the same region (--region)"
        )


def _region_words(provenance: Provenance) -> str:
    """Return the region of a capture in words."""
    found = noted_region(provenance)
    return "an unknown region" if found is None else found[0].describe((0, *found[1]))
