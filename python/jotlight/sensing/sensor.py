"""The physics: from an image to bits."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import as_image
from jotlight.chunks import frame_chunks
from jotlight.memory_maps import release
from jotlight.seeds import SeedLike, seed_bytes
from jotlight.sensing.bits import Bits

MAPS = ("dark_counts", "efficiency", "mask")
"""The parameters of a sensor that may have a value for each jot."""

_WORDS = {"dark_counts": "dark counts", "efficiency": "efficiency", "mask": "dead jots"}

KERNELS = ("box", "linear", "quadratic", "cubic")
"""Interpolation kernels of the light field, by degree of the B-spline."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sensor:
    """A quanta image sensor: each jot reports 1 when at least `threshold` photons arrive.

    An image c, in units of intensity, gives each jot ``s = (gain / frames) * (G c)`` photons per
    frame in the mean, where G spreads a pixel's light over its jots by `kernel`; of these the
    sensor detects ``efficiency * s + dark_counts``. With the defaults a pixel of intensity 1 gives
    each of its jots one photon per frame.

    Parameters
    ----------
    oversampling : int
        K̂: each pixel covers K̂ x K̂ jots.
    frames : int
        T: binary frames of the same scene.
    gain : float, optional
        α: photons on a pixel of intensity 1, over all its jots and frames. Default: K, the number
        of bits per pixel.
    threshold : int
        q: photons that make a jot report 1.
    kernel : {"box", "linear", "quadratic", "cubic"}
        How a pixel's light is spread. A B-spline; the box keeps it on the pixel's own jots.
    dark_counts : float or array_like of shape (H * K̂, W * K̂)
        d: detections per jot and frame without light, the same for all jots or one for each.
    efficiency : float or array_like of shape (H * K̂, W * K̂)
        η in (0, 1]: the share of photons that are detected, the same for all jots or one for each.
    mask : array_like of bool of shape (H * K̂, W * K̂), optional
        True marks a dead jot, as in `numpy.ma`. It never fires in simulation, and reconstruction
        does not look at it.
    max_intensity : float
        S: the largest intensity that an estimate may have.

    Raises
    ------
    ValueError
        When a value is outside of its range, or a map has the wrong shape or values.

    Notes
    -----
    Paper, section 2.1, equations (2) and (3). Efficiency and dark counts are those of real sensors,
    which the paper leaves out.

    Examples
    --------
    >>> sensor = Sensor(oversampling=4, threshold=2)
    >>> sensor.bits_per_pixel, sensor.gain
    (16, 16.0)
    >>> round(float(sensor.probability(np.ones((1, 1)))[0, 0]), 4)  # two photons or more at s = 1
    0.2642
    """

    oversampling: int = 1
    frames: int = 1
    gain: float | None = None
    threshold: int = 1
    kernel: str = "box"
    dark_counts: float | npt.NDArray[np.float32] = 0.0
    efficiency: float | npt.NDArray[np.float32] = 1.0
    mask: npt.NDArray[np.bool_] | None = None
    max_intensity: float = 1.0

    def __post_init__(self) -> None:
        for name, most in (("oversampling", 4096), ("frames", 2**31 - 1), ("threshold", 65535)):
            object.__setattr__(self, name, _whole(name, getattr(self, name), most))
        if self.bits_per_pixel >= 2**31:
            raise ValueError(
                f"oversampling**2 * frames: expected less than 2**31 bits per pixel, "
                f"got {self.bits_per_pixel}"
            )
        if self.kernel not in KERNELS:
            raise ValueError(f"kernel: expected one of {', '.join(KERNELS)}, got {self.kernel!r}")
        gain = self.bits_per_pixel if self.gain is None else self.gain
        object.__setattr__(self, "gain", _positive("gain", gain))
        object.__setattr__(self, "max_intensity", _positive("max_intensity", self.max_intensity))
        object.__setattr__(self, "dark_counts", self._checked_dark_counts())
        object.__setattr__(self, "efficiency", self._checked_efficiency())
        object.__setattr__(self, "mask", self._checked_mask())
        maps = list(self.maps().items())
        for name, map_ in maps[1:]:
            if map_.shape != maps[0][1].shape:
                raise ValueError(
                    f"{name}: expected the shape of the map of {_WORDS[maps[0][0]]} "
                    f"{maps[0][1].shape}, got {map_.shape}"
                )

    @property
    def bits_per_pixel(self) -> int:
        """K = T·K̂²."""
        return self.frames * self.oversampling**2

    def replace(self, **changes: Any) -> Self:
        """Give a sensor with some parameters changed; without `gain` among them, α/K stays.

        So ``sensor.replace(frames=16)`` takes 16 times the frames, each as bright as before.

        Examples
        --------
        >>> Sensor(oversampling=2, gain=2.0).replace(frames=3).gain
        6.0
        """
        known = {field.name for field in dataclasses.fields(self)}
        if unknown := sorted(set(changes) - known):
            raise TypeError(f"expected a parameter of Sensor, got {', '.join(unknown)}")
        new = dataclasses.replace(self, **{"gain": None, **changes})
        if "gain" not in changes:
            scale = self._gain / self.bits_per_pixel
            object.__setattr__(new, "gain", _positive("gain", scale * new.bits_per_pixel))
        return new

    def rate(self, image: npt.ArrayLike, *, threads: int | None = None) -> npt.NDArray[np.float32]:
        """Expected detections per jot and frame, s, or η s + d for a sensor that has η or d.

        Parameters
        ----------
        image : array_like of float, shape (H, W) or (H, W, C)
            Intensities, finite and not negative.
        threads : int, optional
            Threads to use. Default: all.

        Returns
        -------
        ndarray of float32, shape (H * K̂, W * K̂) or (H * K̂, W * K̂, C)
            Dead jots too have the rate that falls on them.

        Examples
        --------
        >>> Sensor(oversampling=2, gain=2.0, dark_counts=0.125).rate(np.full((1, 1), 0.5))
        array([[0.375, 0.375],
               [0.375, 0.375]], dtype=float32)
        """
        return self._jot_map(engine.rate, image, threads)

    def probability(
        self, image: npt.ArrayLike, *, threads: int | None = None
    ) -> npt.NDArray[np.float32]:
        """P(b = 1) of each jot: equation (3); 0 for a dead one. Takes what :meth:`rate` takes.

        Examples
        --------
        >>> np.allclose(Sensor().probability(np.ones((1, 1))), 1 - np.exp(-1))
        True
        """
        return self._jot_map(engine.probability, image, threads)

    def expose(
        self,
        image: npt.ArrayLike,
        rng: SeedLike = None,
        *,
        tile: tuple[slice, slice] | None = None,
        frames: slice | None = None,
        out: npt.NDArray[np.uint8] | None = None,
        threads: int | None = None,
        progress: Callable[[float], object] | None = None,
    ) -> Bits:
        """Draw the bits of an image.

        Each bit depends on the seed and on its own place alone, so that any `tile` and any range of
        `frames` holds just what the whole would hold there, for any number of threads.

        Parameters
        ----------
        image : array_like of float, shape (H, W) or (H, W, C)
            Intensities, finite and not negative. The channels of a colour image are independent.
            Float32 and float64 are read in place; nothing else is as large as the jots.
        rng : int, numpy.random.Generator, numpy.random.SeedSequence or None
            The seed. A generator gives a new seed each time; None takes fresh entropy.
        tile : (slice, slice), optional
            Rows and columns of pixels. Default: all.
        frames : slice, optional
            Frames. Default: all.
        out : ndarray of uint8, optional
            Where to put the packed bits, of the shape of ``Bits.packed``; a memory map, say.
        threads : int, optional
            Threads to use. Default: all.
        progress : callable, optional
            Called now and then with the share that is done.

        Returns
        -------
        Bits
            The packed bits, which carry this sensor, cut to the tile and frames.

        Raises
        ------
        TypeError
            For an image of integers, whose scale is unknown.
        ValueError
            For an image that is empty, negative, not finite, or not of 2 or 3 dimensions.

        Notes
        -----
        The generator is ChaCha with 8 rounds, keyed by the seed and asked for the draw at a
        place; a bit is [U < P(b = 1)] with U uniform on 48 bits.

        Examples
        --------
        >>> image = np.linspace(0, 1, 16).reshape(4, 4)
        >>> sensor = Sensor(oversampling=8, frames=2)
        >>> whole = sensor.expose(image, rng=1)
        >>> part = sensor.expose(image, rng=1, tile=(slice(1, 3), slice(2, 4)), frames=slice(1, 2))
        >>> bool((part.to_array() == whole.to_array()[1:2, 8:24, 16:32]).all())
        True
        """
        pixels = as_image(image)
        height, width = pixels.shape[:2]
        self.check_jots(height * self.oversampling, width * self.oversampling)
        if tile is None:
            tile = (slice(None), slice(None))
        elif len(tile) != 2:
            raise ValueError(f"tile: expected slices of rows and columns, got {tile!r}")
        rows = _span("tile rows", tile[0], height)
        columns = _span("tile columns", tile[1], width)
        span = _span("frames", slice(None) if frames is None else frames, self.frames)
        shape = (
            len(span),
            len(rows) * self.oversampling,
            math.ceil(len(columns) * self.oversampling / 8),
            *pixels.shape[2:],
        )
        if out is None:
            out = np.empty(shape, np.uint8)
        elif out.dtype != np.uint8 or out.shape != shape or not out.flags.writeable:
            raise ValueError(
                f"out: expected a writeable uint8 array of shape {shape}, "
                f"got {out.dtype} of shape {out.shape}"
            )
        seed = seed_bytes(rng)
        description = self._engine_arguments()
        channels = [(0, pixels, out)]
        if pixels.ndim == 3:
            channels = [(c, pixels[..., c], out[..., c]) for c in range(pixels.shape[2])]
        slabs = list(frame_chunks(len(span), len(rows), len(columns) * self.oversampling**2))
        for step, (channel, plane, packed) in enumerate(channels):
            for index, (f, r) in enumerate(slabs):
                jots = slice(r.start * self.oversampling, r.stop * self.oversampling)
                part = packed[f.start : f.stop, jots]
                engine.expose(
                    description,
                    plane,
                    seed,
                    channel,
                    (span.start + f.start, span.start + f.stop),
                    (rows.start + r.start, rows.start + r.stop),
                    (columns.start, columns.stop),
                    part,
                    threads,
                )
                release(part)
                if progress:
                    progress((step + (index + 1) / len(slabs)) / len(channels))
        sensor = self._cut(len(span), rows, columns, whole=(height, width))
        return Bits(out, len(columns) * self.oversampling, sensor)

    def _jot_map(
        self, function: Callable[..., None], image: npt.ArrayLike, threads: int | None
    ) -> npt.NDArray[np.float32]:
        pixels = as_image(image)
        height, width = (size * self.oversampling for size in pixels.shape[:2])
        self.check_jots(height, width)
        out = np.empty((height, width, *pixels.shape[2:]), np.float32)
        description = self._engine_arguments()
        planes = [(pixels, out)]
        if pixels.ndim == 3:
            planes = [(pixels[..., c], out[..., c]) for c in range(pixels.shape[2])]
        for plane, jots in planes:
            # Finding a jot's probability takes some ten times as long as drawing it.
            for _, rows in frame_chunks(1, height, 10 * width):
                part = jots[rows.start : rows.stop]
                function(description, plane, rows.start, part, threads)
        return out

    def _cut(self, frames: int, rows: range, columns: range, whole: tuple[int, int]) -> "Sensor":
        """The sensor that reports only these frames, rows and columns of pixels."""
        cut = self if frames == self.frames else self.replace(frames=frames)
        if (len(rows), len(columns)) == whole:
            return cut
        jots = tuple(
            slice(part.start * self.oversampling, part.stop * self.oversampling)
            for part in (rows, columns)
        )
        maps = {name: map_[jots] for name, map_ in self.maps().items()}
        return cut.replace(**maps) if maps else cut

    def check_jots(self, height: int, width: int) -> None:
        """Raise ValueError unless the maps are of this many rows and columns of jots."""
        for name, map_ in self.maps().items():
            if map_.shape != (height, width):
                raise ValueError(
                    f"{name}: expected one value per jot, shape {(height, width)}, "
                    f"got shape {map_.shape}"
                )

    def maps(self) -> dict[str, npt.NDArray[Any]]:
        """Those of the parameters that are maps over the jots, by name."""
        return {
            name: value for name in MAPS if isinstance(value := getattr(self, name), np.ndarray)
        }

    def without_maps(self) -> Self:
        """Give the sensor without dead jots, and with the mean for a map of other parameters."""
        return self.replace(
            mask=None,
            dark_counts=float(np.mean(self.dark_counts)),
            efficiency=float(np.mean(self.efficiency)),
        )

    def numbers(self) -> dict[str, Any]:
        """Those of the parameters that are not maps, by name; JSON can hold them."""
        maps = self.maps()
        return {
            field.name: getattr(self, field.name)
            for field in dataclasses.fields(self)
            if field.name not in maps and field.name != "mask"
        }

    @classmethod
    def from_parts(cls, numbers: Any, maps: dict[str, npt.NDArray[Any]] | None = None) -> Self:
        """Undo :meth:`numbers` and :meth:`maps`.

        Raises
        ------
        ValueError
            When the parts do not describe a sensor.
        """
        if not isinstance(numbers, dict):
            raise ValueError(
                f"sensor: expected an object with named parameters, got {type(numbers).__name__}"
            )
        known = {field.name for field in dataclasses.fields(cls)}
        if unknown := sorted(map(str, set(numbers) - known)):
            raise ValueError(f"sensor: unknown parameters {', '.join(unknown)}")
        try:
            return cls(**{**numbers, **(maps or {})})
        except TypeError as error:
            raise ValueError(f"sensor: {error}") from error

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sensor):
            return NotImplemented
        mine, theirs = self.maps(), other.maps()
        return (
            self.numbers() == other.numbers()
            and mine.keys() == theirs.keys()
            and all(np.array_equal(mine[name], theirs[name]) for name in mine)
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        parts = []
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            default = self.bits_per_pixel if field.name == "gain" else field.default
            if isinstance(value, np.ndarray):
                parts.append(f"{field.name}=<{value.shape[0]} x {value.shape[1]} map>")
            elif value != default:
                parts.append(f"{field.name}={value!r}")
        return f"Sensor({', '.join(parts)})"

    @property
    def _gain(self) -> float:
        """α, which is a number once the sensor is made."""
        assert self.gain is not None
        return self.gain

    def _engine_arguments(self) -> dict[str, Any]:
        return {
            "oversampling": self.oversampling,
            "kernel_degree": KERNELS.index(self.kernel),
            "gain_per_frame": self._gain / self.frames,
            "efficiency": self.efficiency,
            "dark_counts": self.dark_counts,
            "dead": self.mask,
            "threshold": self.threshold,
        }

    def _response(self) -> tuple[int, float, float]:
        """The box-kernel response of a pixel: q, α / K and S."""
        return self.threshold, self._gain / self.bits_per_pixel, self.max_intensity

    def _checked_dark_counts(self) -> float | npt.NDArray[np.float32]:
        dark = np.asarray(self.dark_counts)
        if dark.dtype.kind not in "iuf" or dark.ndim not in (0, 2):
            raise ValueError(
                "dark_counts: expected a number, or a map of numbers with one per jot, "
                f"got {dark.dtype} of {dark.ndim} dimensions"
            )
        if dark.ndim == 2:
            # Checked as they will be kept: float32 has a smaller range.
            with np.errstate(over="ignore"):
                dark = dark.astype(np.float32)
        if dark.size == 0 or not (np.isfinite(dark).all() and dark.min() >= 0):
            raise ValueError("dark_counts: expected finite numbers, 0 or more, in range of float32")
        return float(dark) if dark.ndim == 0 else _frozen(dark, np.float32)

    def _checked_efficiency(self) -> float | npt.NDArray[np.float32]:
        share = np.asarray(self.efficiency)
        if share.ndim == 0:
            number = _positive("efficiency", self.efficiency)
            if number > 1:
                raise ValueError(f"efficiency: expected a number in (0, 1], got {number}")
            return number
        if share.dtype.kind not in "iuf" or share.ndim != 2:
            raise ValueError(
                "efficiency: expected a number, or a map of numbers with one per jot, "
                f"got {share.dtype} of {share.ndim} dimensions"
            )
        share = share.astype(np.float32)
        if share.size == 0 or not (share > 0).all() or share.max() > 1:
            raise ValueError(
                "efficiency: expected numbers in (0, 1]; what is relative to the mean is to be "
                "divided by its maximum, and gain multiplied by that; a jot that detects nothing "
                "belongs in the mask"
            )
        return _frozen(share, np.float32)

    def _checked_mask(self) -> npt.NDArray[np.bool_] | None:
        if self.mask is None:
            return None
        mask = np.asarray(self.mask)
        if mask.dtype != np.bool_ or mask.ndim != 2:
            raise ValueError(
                "mask: expected a 2-D array of bool with True for a dead jot, "
                f"got {mask.dtype} of {mask.ndim} dimensions"
            )
        return _frozen(mask, np.bool_)


def _frozen(array: npt.NDArray[Any], dtype: type[np.generic]) -> npt.NDArray[Any]:
    """A copy that nobody changes behind the sensor's back."""
    copy = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


def _whole(name: str, value: Any, most: int) -> int:
    number = _number(value)
    if not 1 <= number <= most or number != int(number):
        raise ValueError(f"{name}: expected a whole number from 1 to {most}, got {value!r}")
    return int(number)


def _positive(name: str, value: Any) -> float:
    number = float(_number(value))
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name}: expected a finite number above 0, got {value!r}")
    return number


def _number(value: Any) -> float:
    """A single real number, and NaN for all else: bool and text too."""
    array = np.asarray(value)
    return array.item() if array.ndim == 0 and array.dtype.kind in "iuf" else math.nan


def _span(name: str, part: slice, size: int) -> range:
    if not isinstance(part, slice):
        raise TypeError(f"{name}: expected a slice, got {part!r}")
    span = range(size)[part]
    if span.step != 1 or len(span) == 0:
        raise ValueError(f"{name}: expected a slice with step 1 inside 0..{size}, got {part!r}")
    return span
