"""One method on many images: how good it is on average, and where it is worst."""

import csv
import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight import metrics
from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor

MEASURES = ("psnr", "snr", "ssim")


@dataclasses.dataclass(frozen=True)
class Score:
    """How close the estimate of one image came."""

    image: str
    psnr: float
    """In dB, for a peak of 1."""
    snr: float
    """In dB."""
    ssim: float | None
    """None for images smaller than its window."""


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The scores of all images."""

    scores: list[Score]

    def values(self, measure: str) -> npt.NDArray[np.float64]:
        """Give one measure ("psnr", "snr" or "ssim") of all images, NaN where it has none."""
        if measure not in MEASURES:
            raise ValueError(f"measure: expected one of {', '.join(MEASURES)}, got {measure!r}")
        return np.array([getattr(score, measure) for score in self.scores], np.float64)

    def mean(self, measure: str) -> float:
        """Give the mean over the images."""
        return float(np.mean(self.values(measure)))

    def worst(self, measure: str, share: float) -> float:
        """Give the mean over the worst share of the images, at least one.

        Examples
        --------
        >>> scores = [Score(str(psnr), psnr, psnr, None) for psnr in (20.0, 30.0, 40.0, 50.0)]
        >>> Evaluation(scores).worst("psnr", 0.5)
        25.0
        """
        if not 0 < share <= 1:
            raise ValueError(f"share: expected a number in (0, 1], got {share}")
        # Less what binary fractions may have too much.
        number = math.ceil(share * len(self.scores) - 1e-9)
        return float(np.mean(np.sort(self.values(measure))[:number]))

    def write_csv(self, path: Path) -> None:
        """Write one row for each image."""
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["image", "psnr_db", "snr_db", "ssim"])
            for score in self.scores:
                ssim = "" if score.ssim is None else f"{score.ssim:.6f}"
                writer.writerow([score.image, f"{score.psnr:.6f}", f"{score.snr:.6f}", ssim])


def evaluate(
    method: Network | Callable[..., npt.NDArray[np.float32]],
    images: Sequence[npt.NDArray[np.floating]] | npt.NDArray[np.floating],
    sensor: Sensor,
    *,
    names: Sequence[str] | None = None,
    rng: int = 0,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Evaluation:
    """Expose every image, reconstruct it, and compare.

    Parameters
    ----------
    method : Network or callable
        A callable is run as ``method(bits, sensor, threads=threads)``, like `jotlight.mle`.
    images : sequence of arrays (H, W) or (H, W, C), or one array (N, H, W)
        Intensities.
    sensor : Sensor
        What sees them.
    names : sequence of str, optional
        Of the images. Default: their numbers.
    rng : int
        Seed of the first image's bits; the next image has the next number.
    threads : int, optional
        Threads to use. Default: all.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        For no images, or names that do not fit them.

    Examples
    --------
    >>> from jotlight import mle
    >>> sensor = Sensor(oversampling=4)
    >>> evaluate(mle, np.full((2, 16, 16), 0.5), sensor).mean("psnr") > 10
    True
    """
    if not isinstance(rng, int | np.integer):
        raise TypeError(f"rng: expected the whole number that is the first seed, got {rng!r}")
    images = [np.asarray(image) for image in images]
    if len(images) == 0:
        raise ValueError("images: expected at least one, got none")
    names = [str(number) for number in range(len(images))] if names is None else names
    if len(names) != len(images):
        raise ValueError(f"names: expected one for each of {len(images)} images, got {len(names)}")
    run = method.reconstruct if isinstance(method, Network) else method
    scores = []
    for number, (name, image) in enumerate(zip(names, images, strict=True)):
        bits = sensor.expose(image, rng=rng + number, threads=threads)
        estimate = run(bits, sensor, threads=threads)
        ssim = metrics.ssim(estimate, image) if min(image.shape[:2]) >= 11 else None
        scores.append(
            Score(name, metrics.psnr(estimate, image), metrics.snr(estimate, image), ssim)
        )
        if progress:
            progress((number + 1) / len(images))
    return Evaluation(scores)
