"""The calibration of a sensor from captures larger than the memory."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.calibration.calibrate import (
    MAX_DARK,
    JotSums,
    calibrate_sums,
    check_jots,
    check_limits,
)
from jotlight.calibration.captured_sensor import captured_threshold
from jotlight.calibration.jot_mosaics import mosaic_of_jots
from jotlight.calibration.result import Calibration, check_same_jots
from jotlight.calibration.steadiness import block_frames, steadiness_of_blocks
from jotlight.dask.counting import count
from jotlight.dask.pieces import width_in_jots
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.lazy import import_dask_array
from jotlight.sensing.parameters.provenance import Provenance

if TYPE_CHECKING:
    import dask.array


@dataclasses.dataclass(frozen=True)
class _LazySums:
    """Sums of a capture, as lazy arrays of int32, (N, H, W)."""

    blocks: "dask.array.Array"
    """Counts of the blocks of frames that are compared, or of all frames as one block."""
    pairs: "dask.array.Array | None"
    """Number of ones that are followed by a one in the same block."""
    rest: "dask.array.Array | None"
    """Counts of the remaining frames."""
    frames: int

    def arrays(self) -> list[Any]:
        return [self.blocks, self.pairs, self.rest]


@dataclasses.dataclass(frozen=True)
class LazyCalibration:
    """A calibration that is not computed yet. Each map is a lazy array of shape (H, W).

    Attributes
    ----------
    dark_counts : dask.array.Array
        d of each jot, float32.
    mask : dask.array.Array
        Dead jots, and hot jots with many dark counts, bool.
    hot : dask.array.Array
        Hot jots, bool.
    dead : dask.array.Array
        Dead jots, bool.
    efficiency : dask.array.Array, optional
        η of each jot, float32, if there is a flat capture.
    """

    dark_counts: "dask.array.Array"
    mask: "dask.array.Array"
    hot: "dask.array.Array"
    dead: "dask.array.Array"
    efficiency: "dask.array.Array | None"
    _sums: tuple[_LazySums | None, ...] = dataclasses.field(repr=False)
    _settings: dict[str, Any] = dataclasses.field(repr=False)

    def compute(self) -> Calibration:
        """Return the calibration. The workers count, and this process fits the distributions.

        It equals that of :func:`jotlight.calibrate`, whose warnings it issues.
        """
        import dask

        (arrays,) = dask.compute([None if sums is None else sums.arrays() for sums in self._sums])
        return _finish(arrays, _numbers(self._sums), self._settings)


def calibrate(
    dark: "Bits | dask.array.Array",
    flat: "Bits | dask.array.Array | None" = None,
    *,
    threshold: int | None = None,
    false_positive_rate: float = 1e-4,
    max_dark: float = MAX_DARK,
    mosaic: object = None,
    width: int | None = None,
) -> LazyCalibration:
    """Return the calibration of a sensor from a dark capture and, optionally, a flat one, lazily.

    Parameters
    ----------
    dark : Bits or dask.array.Array of uint8, shape (T, H, ceil(W / 8))
        Frames without light: bits, or packed bits as :meth:`jotlight.Bits.to_dask` returns them.
    flat : Bits or dask.array.Array of uint8, shape (T, H, ceil(W / 8)), optional
        The same for an evenly lit surface, with the exposure time of the dark capture.
    threshold, false_positive_rate, max_dark, mosaic
        As for :func:`jotlight.calibrate`.
    width : int, optional
        W: the true width in jots, such as ``bits.width``. An array of packed bits needs it, because
        its rows are padded to whole bytes. Default: that of the bits.

    Returns
    -------
    LazyCalibration
        Maps as lazy arrays. Its method `compute` returns the :class:`jotlight.Calibration`.

    Raises
    ------
    MissingExtraError
        When dask is not installed.
    TypeError, ValueError
        When the captures contradict each other, or a number is out of range.

    Examples
    --------
    >>> frames = np.random.default_rng(0).random((256, 16, 16)) < 0.01
    >>> frames[:, 3, 5] = True
    >>> lazy = jl.dask.calibrate(jl.Bits.from_array(frames).to_dask(chunks=100), width=16)
    >>> np.argwhere(lazy.mask.compute()).tolist()
    [[3, 5]]
    """
    array = import_dask_array()
    from dask.delayed import delayed

    check_limits(false_positive_rate, max_dark)
    if mosaic is not None and flat is None:
        raise ValueError("mosaic: is for a flat capture, and there is none; leave it out")
    captures = {"dark": dark, "flat": flat}
    threshold = captured_threshold(threshold, **captures)
    known = {
        name: each.provenance
        for name, each in captures.items()
        if isinstance(each, Bits) and each.provenance is not None
    }
    if "dark" in known and "flat" in known:
        check_same_jots("flat", known["flat"], "dark", known["dark"])
    settings: dict[str, Any] = {
        "threshold": threshold,
        "false_positive_rate": false_positive_rate,
        "max_dark": max_dark,
        "provenance": known,
    }
    sums = (_sums("dark", dark, width), None if flat is None else _sums("flat", flat, width))
    shape = sums[0].blocks.shape[1:]
    check_jots(shape, None if sums[1] is None else sums[1].blocks.shape[1:])
    settings["mosaic"] = None if flat is None else mosaic_of_jots(flat, mosaic, shape)
    arrays = [None if each is None else each.arrays() for each in sums]
    # dask takes the arrays in the list for parts of the graph.
    found = delayed(_finish)(arrays, _numbers(sums), settings)

    def map_of(name: str, dtype: npt.DTypeLike) -> "dask.array.Array":
        return array.from_delayed(getattr(found, name), shape, dtype)

    maps = {name: map_of(name, bool) for name in ("mask", "hot", "dead")}
    efficiency = None if flat is None else map_of("efficiency", np.float32)
    dark_counts = map_of("dark_counts", np.float32)
    return LazyCalibration(
        dark_counts, **maps, efficiency=efficiency, _sums=sums, _settings=settings
    )


def _sums(name: str, x: "Bits | dask.array.Array", width: int | None) -> _LazySums:
    """Return the sums that a calibration needs from a capture."""
    width = width_in_jots(x, width)
    if isinstance(x, Bits):
        x = x.to_dask()
    if x.ndim != 3:
        raise ValueError(
            f"{name}: expected frames of one channel, got {x.shape[3]}; calibrate each channel by "
            "itself"
        )
    frames = x.shape[0]
    size = block_frames(frames)
    if size is None:
        return _LazySums(count(x, frames, width=width), None, None, frames)
    used = frames // size * size
    both = x.map_overlap(
        _successive_ones,
        depth={0: (0, 1)},
        boundary="none",
        trim=False,
        dtype=np.uint8,
        chunks=x.chunks,
        meta=np.empty((0, 0, 0), np.uint8),
    )
    rest = None if used == frames else count(x[used:], frames - used, width=width)
    return _LazySums(
        count(x, size, width=width),
        # The last window ends with the last whole block, even if the rest is as long as a window.
        count(both[: used - 1], size - 1, size, width=width),
        rest,
        frames,
    )


def _successive_ones(block: npt.NDArray[np.uint8], block_info: Any = None) -> Any:
    """Return the bits that are 1 in a frame and in the next one. The last frame has no next one."""
    last = block_info[0]["chunk-location"][0] == block_info[0]["num-chunks"][0] - 1
    both = block[:-1] & block[1:]
    return np.concatenate([both, np.zeros_like(block[:1])]) if last else both


def _numbers(sums: tuple[_LazySums | None, ...]) -> list[int | None]:
    return [None if each is None else each.frames for each in sums]


def _finish(
    arrays: list[Any],
    frames: list[int | None],
    settings: dict[str, Any],
) -> Calibration:
    """Return the calibration from the computed sums of the dark and the flat capture."""
    dark, flat = (
        None if number is None else _jot_sums(each, number)
        for each, number in zip(arrays, frames, strict=True)
    )
    assert dark is not None, "a dark capture"
    if flat is not None:
        flat = dataclasses.replace(flat, mosaic=settings["mosaic"])
    provenance: dict[str, Provenance] = settings["provenance"]
    return calibrate_sums(
        dark,
        flat,
        settings["threshold"],
        settings["false_positive_rate"],
        settings["max_dark"],
        provenance,
    )


def _jot_sums(arrays: list[Any], frames: int) -> JotSums:
    blocks, pairs, rest = arrays
    ones = blocks.sum(axis=0, dtype=np.int32)
    if rest is not None:
        ones += rest[0]
    size = block_frames(frames)
    tests = None
    if pairs is not None and size is not None:
        tests = steadiness_of_blocks(blocks, pairs, size)
    return JotSums(ones, frames, tests)
