"""Evaluation of one method on many images: mean quality, and quality on the worst images."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import os
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

import jotlight.metrics as metrics
from jotlight.checks import real_number, refuse_masked, shown
from jotlight.errors import counted
from jotlight.evaluation.own_method import OwnMethod
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.files import write_file
from jotlight.images.sets import require_image_list
from jotlight.layout import looks_like_color
from jotlight.networks.network import Network
from jotlight.notebook import card, table_of, text_table
from jotlight.parameter_names import check_choice, takes_rng
from jotlight.paths import as_path
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.sensor import Sensor, require_any_sensor

METRICS = ("psnr", "snr", "ssim")

COLUMNS = "", "PSNR", "SNR", "SSIM"
"""Titles of the columns of the table."""


@dataclasses.dataclass(frozen=True)
class Score:
    """Quality of the estimate of one image."""

    image: str
    psnr: float
    """PSNR in dB, for a peak of 1."""
    snr: float
    """SNR in dB."""
    ssim: float | None
    """SSIM, or None for images smaller than its window."""


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The scores of one method on all images."""

    scores: Sequence[Score]

    def __post_init__(self) -> None:
        object.__setattr__(self, "scores", tuple(self.scores))

    def values(self, metric: str) -> npt.NDArray[np.float64]:
        """Return "psnr", "snr", or "ssim" of each image, NaN where it is None."""
        check_choice("metric", metric, METRICS)
        return np.array([getattr(score, metric) for score in self.scores], np.float64)

    def mean(self, metric: str) -> float:
        """Return the mean of a metric over the images that have a value, NaN if none has one."""
        return self.mean_of_worst(metric, 1)

    def mean_of_worst(self, metric: str, fraction: float) -> float:
        """Return the mean of a metric over the worst fraction of the images, rounded up.

        These are the images that have a value. The result is NaN if none has one.

        Examples
        --------
        >>> scores = [Score(str(psnr), psnr, psnr, None) for psnr in (20.0, 30.0, 40.0, 50.0)]
        >>> Evaluation(scores).mean_of_worst("psnr", 0.5)
        25.0
        """
        if not 0 < real_number(fraction) <= 1:
            raise ValueError(f"fraction: expected a number in (0, 1], got {shown(fraction)}")
        # 0.07 * 100 rounds to just above 7; the tolerance keeps it from becoming 8.
        values = np.sort(self._known(metric))
        number = math.ceil(fraction * values.size - 1e-9)
        return float(np.mean(values[:number])) if number else math.nan

    def _known(self, metric: str) -> npt.NDArray[np.float64]:
        """Return a metric of the images that have a value."""
        values = self.values(metric)
        return values[~np.isnan(values)]

    def rows(self) -> list[tuple[str, ...]]:
        """Return the title and the PSNR, SNR, and SSIM of all and of the worst images as texts.

        The texts state how many images have an SSIM, if only some do.
        """
        values: dict[str, Callable[[str], float]] = {
            "mean": self.mean,
            "worst 5 %": lambda metric: self.mean_of_worst(metric, 0.05),
            "worst 1 %": lambda metric: self.mean_of_worst(metric, 0.01),
        }
        known, number = self._known("ssim").size, len(self.scores)
        note = "" if known == number else f" ({known} of {number} images)"
        rows: list[tuple[str, ...]] = []
        for title, value in values.items():
            psnr, snr, ssim = (value(metric) for metric in METRICS)
            text = "none" if math.isnan(ssim) else f"{ssim:.3f}{note}"
            rows.append((title, f"{psnr:.2f} dB", f"{snr:.2f} dB", text))
        return rows

    def __repr__(self) -> str:
        return text_table(COLUMNS, self.rows())

    def _repr_html_(self) -> str:
        title = f"Evaluation of {counted(len(self.scores), 'image')}"
        return card(title, {}) + table_of(COLUMNS, self.rows())

    def write_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file with one row for each image, completely or not at all.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> path = pathlib.Path(tempfile.mkdtemp()) / "scores.csv"
        >>> Evaluation([Score("a.png", 20.0, 15.0, None)]).write_csv(path)
        >>> path.read_text().splitlines()
        ['image,psnr_db,snr_db,ssim', 'a.png,20.000000,15.000000,']
        """
        path = as_path(path, 'evaluation.write_csv("scores.csv")')
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(["image", "psnr_db", "snr_db", "ssim"])
        for score in self.scores:
            ssim = "" if score.ssim is None else f"{score.ssim:.6f}"
            writer.writerow([score.image, f"{score.psnr:.6f}", f"{score.snr:.6f}", ssim])
        write_file(path, text.getvalue())


@takes_rng
def evaluate(
    method: str | Network | OwnMethod,
    images: Sequence[npt.NDArray[np.floating]] | npt.NDArray[np.floating],
    sensor: Sensor,
    *,
    channel_axis: int | None = None,
    names: Sequence[str] | None = None,
    precision: str | None = None,
    rng: int = 0,
    threads: int | None = None,
    progress: Progress = None,
) -> Evaluation:
    """Return the quality of a method on images that the sensor exposes.

    PSNR and SSIM are for a peak of 1, also for brighter images and for another `max_intensity`.

    Parameters
    ----------
    method : str, Network, or callable
        The name of a method, a network, or a function ``f(bits, sensor)`` or ``f(bits)``, as for
        :func:`jotlight.reconstruct`.
    images : sequence of arrays (H, W), or one array (N, H, W)
        Intensities. With `channel_axis`, each image has one more axis.
    sensor : Sensor
        Sensor that exposes the images. The white balance of its mosaic is ignored, because the
        true images have none.
    channel_axis : int, optional
        Axis of each image that holds color channels. Default: the last one if the sensor has a
        mosaic, and else none.
    names : sequence of str, optional
        Names of the images. Default: their indices.
    precision : {"f32", "bf16"}, optional
        Precision of the products of a deep network, as for :func:`jotlight.reconstruct`.
    rng : int
        Seed of the bits of the first image. Each further image uses the next integer.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar; or a function that is called after each image with the
        completed fraction. Default: a bar in notebooks.

    Returns
    -------
    Evaluation

    Raises
    ------
    TypeError
        When the images or the sensor have another type.
    ValueError
        When there are no images, one array looks like a color image, or the number of names
        differs from that of the images.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=4)
    >>> jl.evaluate(jl.mle, np.full((2, 16, 16), 0.5), sensor).mean("psnr") > 10
    True
    """
    if isinstance(rng, bool) or not isinstance(rng, int | np.integer):
        raise TypeError(f"rng: expected an int, the seed of the first image, got {rng!r}")
    if isinstance(method, list | tuple | Mapping):
        raise TypeError(
            f"method: expected one method, got {shown(method)}; "
            "jotlight.compare takes several, for one image"
        )
    require_any_sensor(sensor)
    sensor = sensor.without_white_balance()  # the true images have none
    if sensor.mosaic is not None and channel_axis is None:
        channel_axis = -1  # where the mosaic finds the colors
    images = _list_images(images, channel_axis)
    names = _list_names(names, len(images))
    scores = []
    with shown_progress(progress, "reconstructing") as update:
        for number, (name, image) in enumerate(zip(names, images, strict=True)):
            bits = sensor.expose(image, rng + number, channel_axis=channel_axis, threads=threads)
            estimate = reconstruct(
                bits, sensor, method=method, precision=precision, threads=threads
            )
            if channel_axis is not None:  # the estimate has the channels last
                image = np.moveaxis(image, channel_axis, -1)
            axis = None if channel_axis is None else -1
            ssim = metrics.ssim_or_none(estimate, image, axis)
            psnr = metrics.psnr(estimate, image, data_range=1.0)
            scores.append(Score(name, psnr, metrics.snr(estimate, image), ssim))
            update((number + 1) / len(images))
    return Evaluation(scores)


def _list_names(names: Sequence[str] | None, number: int) -> list[str]:
    """Return the names of a number of images: those of the caller, or their indices."""
    if names is None:
        return [str(index) for index in range(number)]
    if isinstance(names, str) or not hasattr(names, "__len__"):
        raise TypeError(
            f"names: expected a list with a name for each image, such as ['a', 'b'], got "
            f"{shown(names)}"
        )
    if len(names) != number:
        raise ValueError(f"names: expected one for each of {number} images, got {len(names)}")
    return [str(name) for name in names]


def _list_images(
    images: Sequence[npt.NDArray[np.floating]] | npt.NDArray[np.floating], channel_axis: int | None
) -> list[npt.NDArray[np.floating]]:
    """Return a sequence of images, or an array of them, as a list. Refuse a single image."""
    require_image_list(images)
    whole = images.shape if isinstance(images, np.ndarray) else ()
    for image in images:
        refuse_masked("images", image)
    listed = [np.asarray(image) for image in images]
    if not listed:
        raise ValueError("images: expected at least one, got none")
    expected = "(N, H, W)" if channel_axis is None else "(N, ...) whose images have channels"
    # A gray image in a list is refused with its own message, which names no axis of a list.
    if listed[0].ndim < (3 if whole and channel_axis is not None else 2):
        raise ValueError(
            f"images: expected a list of images, or an array {expected}, got "
            f"{f'shape {whole}' if whole else f'images of shape {listed[0].shape}'}; "
            "put one image in a list"
        )
    if channel_axis is None and looks_like_color(whole):
        raise ValueError(
            f"images: expected a list of images, or an array {expected}, but shape {whole} looks "
            "like color; put one color image in a list, and pass channel_axis=-1"
        )
    dimensions = 2 if channel_axis is None else 3
    for index, image in enumerate(listed):
        if image.ndim > dimensions:
            each = "(H, W)" if channel_axis is None else "(H, W) and an axis of channels"
            advice = "pass channel_axis=-1 for color, or " if channel_axis is None else ""
            raise ValueError(
                f"images: expected each image of shape {each}, got shape {image.shape} at index "
                f"{index}; {advice}pass the images of a stack as items of the list"
            )
    return listed
