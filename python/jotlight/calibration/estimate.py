"""Dark counts, hot and dead jots, and the response, from a dark and a flat capture."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.calibration.bulk import fit_bulk
from jotlight.calibration.flat import response
from jotlight.calibration.rates import Counts, detections, variance
from jotlight.calibration.result import Calibration, check_alike
from jotlight.calibration.steadiness import Steadiness, steadiness
from jotlight.checks import as_counts
from jotlight.errors import warn
from jotlight.sensing.bits import Bits
from jotlight.sensing.provenance import Provenance

MOST_DARK = 0.1
"""Dark counts per frame above which a hot jot is masked: measured, see docs/guide/calibration.md."""

_LEAST_JOTS = 64


def calibrate(
    dark: Bits | npt.ArrayLike,
    flat: Bits | npt.ArrayLike | None = None,
    *,
    frames: int | None = None,
    flat_frames: int | None = None,
    threshold: int = 1,
    false_positive_rate: float = 1e-4,
    most_dark: float = MOST_DARK,
    provenance: dict[str, Provenance] | None = None,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Calibration:
    """Calibrate a sensor from a capture without light, and one of even light.

    Parameters
    ----------
    dark : Bits or array_like of int, shape (H, W)
        Frames taken without light, or the counts of ones over such frames.
    flat : Bits or array_like of int, shape (H, W), optional
        The same of an evenly lit surface, out of focus, with the exposure time of the dark capture;
        best so that about half of the bits are ones.
    frames, flat_frames : int, optional
        N: out of how many frames counts are. `flat_frames` is `frames` unless given. Bits tell it.
    threshold : int
        q: photons that make a jot report 1.
    false_positive_rate : float
        The share of ordinary jots that are called hot, at most, and the share that are called dead.
        Counts are whole, so that the share of hot ones is below it: ``hot_chance``.
    most_dark : float
        Dark counts per frame above which a hot jot is masked; below, reconstruction uses its bits,
        knowing its dark counts.
    provenance : dict, optional
        Where the captures are from, by ``"dark"`` and ``"flat"``, to be kept with the calibration.
        Default: what bits tell of themselves.
    threads : int, optional
        Threads to use. Default: all.
    progress : callable, optional
        Called now and then with the share that is done.

    Returns
    -------
    Calibration

    Raises
    ------
    TypeError, ValueError
        When the captures cannot be what they are said to be.

    Warns
    -----
    JotlightWarning
        When frames are correlated or change over time, and when there are so few frames that hot
        jots cannot be told from ordinary ones at this rate.

    Notes
    -----
    Hot is what the bulk of the jots does not explain: see :func:`jotlight.calibration.fit_bulk`.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> counts = rng.binomial(4096, 0.002, (64, 64))
    >>> counts[10, 20] = 4096
    >>> calibration = calibrate(counts, frames=4096)
    >>> np.argwhere(calibration.mask).tolist()
    [[10, 20]]
    >>> calibration.sensor(frames=16)
    Sensor(frames=16, dark_counts=<64 x 64 map>, mask=<64 x 64 map>)
    """
    if not 0 < false_positive_rate <= 0.01:
        raise ValueError(
            f"false_positive_rate: expected a number in (0, 0.01], got {false_positive_rate!r}"
        )
    if not 0 < most_dark < np.inf:
        raise ValueError(f"most_dark: expected a finite number above 0, got {most_dark!r}")
    known = _provenance(dark=dark, flat=flat) if provenance is None else dict(provenance)
    if "dark" in known and "flat" in known:
        check_alike("flat", known["flat"], "dark", known["dark"])
    half = 0.5 if flat is not None else 1.0

    def share(first: float) -> Callable[[float], object] | None:
        return None if progress is None else lambda done: progress(first + half * done)

    if flat_frames is None and not isinstance(flat, Bits):
        flat_frames = frames
    ones, number, steady = _seen("dark", dark, frames, threads, share(0))
    if ones.size < _LEAST_JOTS:
        raise ValueError(
            f"dark: expected {_LEAST_JOTS} jots at least, to tell what is ordinary, got {ones.size}"
        )
    bulk = fit_bulk(ones, number)
    hot_from = bulk.threshold(false_positive_rate)
    dark_counts = detections(ones, number, threshold)
    if (ones == number).all():
        raise ValueError("dark: expected some jots that do not fire in every frame, got none")
    hot = ones >= hot_from
    # A jot that always fired has no finite rate.
    mask = hot & ((dark_counts > most_dark) | (ones == number))
    found = Calibration(
        dark_counts=dark_counts.astype(np.float32),
        mask=mask,
        hot=hot,
        dead=np.zeros(ones.shape, bool),
        threshold=threshold,
        false_positive_rate=false_positive_rate,
        most_dark=most_dark,
        bulk=bulk,
        hot_from=hot_from,
        hot_chance=bulk.chance(hot_from),
        dark_ones=ones,
        dark_frames=number,
        dark_steadiness=steady,
        provenance=known,
    )
    if hot_from > number:
        warn(
            f"dark: no jot is called hot, since {found.too_few()}, more than the rate of "
            f"{false_positive_rate:.2g}; take more frames, or frames with fewer dark counts"
        )
    _warn_of("dark", steady, false_positive_rate)
    if flat is None:
        return found
    return _with_flat(found, flat, flat_frames, threads, share(half))


def _with_flat(
    found: Calibration,
    flat: Bits | npt.ArrayLike,
    frames: int | None,
    threads: int | None,
    progress: Callable[[float], object] | None,
) -> Calibration:
    ones, number, steady = _seen("flat", flat, frames, threads, progress)
    if ones.shape != found.shape:
        raise ValueError(
            f"flat: expected the dark capture's {found.shape[0]} x {found.shape[1]} jots, got "
            f"{ones.shape[0]} x {ones.shape[1]}"
        )
    dark = found.dark_counts.astype(np.float64)
    seen = response(
        ones,
        number,
        dark,
        variance(dark, found.dark_frames, found.threshold),
        found.mask,
        threshold=found.threshold,
        false_positive_rate=found.false_positive_rate,
    )
    _warn_of("flat", steady, found.false_positive_rate)
    efficiency = np.minimum(seen.relative / seen.relative.max(), 1).astype(np.float32)
    mask = found.mask | seen.dead
    return dataclasses.replace(
        found,
        mask=mask,
        dead=seen.dead,
        efficiency=efficiency,
        # The median, so that networks, which go by it, find 1 detection at intensity 1.
        scale=1 / float(np.median(efficiency[~mask])),
        flat_ones=ones,
        flat_frames=number,
        prnu=seen.prnu,
        prnu_error=seen.prnu_error,
        flat_noise=seen.noise,
        flat_steadiness=steady,
    )


def _seen(
    name: str,
    data: Bits | npt.ArrayLike,
    frames: int | None,
    threads: int | None,
    progress: Callable[[float], object] | None,
) -> tuple[Counts, int, Steadiness | None]:
    """The ones of each jot, out of how many frames, and what single frames tell."""
    if isinstance(data, Bits):
        if len(data.shape) != 3:
            raise ValueError(
                f"{name}: expected frames of one channel, got {data.shape[3]}; calibrate them one "
                "by one"
            )
        if frames is not None and frames != len(data):
            raise ValueError(f"frames: expected the {len(data)} of the {name} bits, got {frames}")
        ones = data.counts(1, threads=threads)
        return ones, len(data), steadiness(data, threads=threads, progress=progress)
    ones = as_counts(data)
    if ones.ndim != 2:
        raise ValueError(f"{name}: expected counts of one channel (H, W), got shape {ones.shape}")
    if frames is None:
        raise ValueError(
            f"frames: {name} holds counts, and nothing tells out of how many frames; give frames "
            "(--frames, --flat-frames)"
        )
    if not (1 <= frames < 2**31 and ones.max() <= frames):
        raise ValueError(
            f"frames: expected at least as many as the largest of the {name} counts, {ones.max()}, "
            f"got {frames}"
        )
    return ones, int(frames), None


def _provenance(**data: object) -> dict[str, Provenance]:
    return {
        name: part.provenance
        for name, part in data.items()
        if isinstance(part, Bits) and part.provenance is not None
    }


def _warn_of(name: str, steady: Steadiness | None, rate: float) -> None:
    """Say what would happen by chance at no more than this rate."""
    from scipy.stats import norm

    if steady is None:
        return
    if abs(steady.correlation_z) > norm.isf(rate / 2):
        warn(
            f"{name}: successive frames are correlated, {steady.correlation:.2g} "
            f"(z = {steady.correlation_z:.1f}), as by afterpulsing; the likelihood takes them to "
            "be independent"
        )
    if steady.homogeneity_z > norm.isf(rate):
        warn(
            f"{name}: counts change over time (z = {steady.homogeneity_z:.1f}), as by motion, "
            "flicker or temperature; one map stands for all of it"
        )
