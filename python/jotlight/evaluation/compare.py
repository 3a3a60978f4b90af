"""One call that compares methods, also those of the caller, on the bits of one image."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from jotlight.checks import as_image
from jotlight.errors import counted
from jotlight.evaluation.choice import title_of
from jotlight.evaluation.methods import COLOR_NETWORK, METHOD_NAMES, Method, find_method
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.request import AnyMethod, Request
from jotlight.evaluation.run_methods import MethodResult, compare_methods, select_methods
from jotlight.layout import Layout
from jotlight.networks.loading import AnyNetwork, wrong_network
from jotlight.notebook import card, table_of, text_table
from jotlight.parameter_names import takes_rng
from jotlight.progress import Progress, equal_steps, shown_progress
from jotlight.seeds import SeedLike
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.sensor import Sensor, require_sensor

if TYPE_CHECKING:
    from jotlight.figures import Figure

COLUMNS = "method", "PSNR", "SSIM", "time"
"""Titles of the columns of the table."""


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """Estimates of one image by several methods: a table when printed, and a figure."""

    image: npt.NDArray[np.floating]
    """The true image."""
    bits: Bits | Readings
    """Its bits, or readings of several bits."""
    results: list[MethodResult]
    """The estimates, their quality, and their computing times."""
    titles: Mapping[str, str]
    """Title of each method."""

    def rows(self) -> list[tuple[str, ...]]:
        """Return the title, PSNR, SSIM, and computing time of each method as texts."""
        return [
            (
                self.titles[result.method],
                f"{result.psnr:.2f} dB",
                "none" if result.ssim is None else f"{result.ssim:.3f}",
                _format_time(result.seconds),
            )
            for result in self.results
        ]

    def __repr__(self) -> str:
        return text_table(COLUMNS, self.rows())

    def _repr_html_(self) -> str:
        return card("Comparison", {}, self.plot().thumbnail()) + table_of(COLUMNS, self.rows())

    def plot(self) -> Figure:
        """Return a figure of the image, of its bits, and of all estimates, with enlarged parts."""
        import jotlight.plots as plots

        sensor, (height, width) = self.bits.sensor, self.image.shape[:2]
        assert isinstance(sensor, Sensor), "the sensor that exposed the image"
        panels = [
            plots.Panel("photograph", f"{height} × {width} pixels", self.image),
            plots.bits_panel(self.bits, sensor.oversampling),
        ]
        for (title, psnr, ssim, seconds), result in zip(self.rows(), self.results, strict=True):
            text = f"{psnr}   SSIM {ssim}   {seconds}"
            panels.append(plots.Panel(title, text, result.estimate))
        heading = f"{counted(sensor.trials, 'trial')} per pixel   {sensor!r}"
        return plots.comparison(panels, heading, white=sensor.max_intensity)


@takes_rng
def compare(
    methods: Mapping[str, AnyMethod | None] | Sequence[AnyMethod | None] | AnyMethod | None,
    image: npt.ArrayLike,
    sensor: Sensor,
    *,
    channel_axis: int | None = None,
    rng: SeedLike = 0,
    threads: int | None = None,
    progress: Progress = None,
) -> Comparison:
    """Expose an image, and return its estimates by several methods, with their quality.

    PSNR and SSIM are for a peak of 1, also for a brighter image and for another `max_intensity`.

    Parameters
    ----------
    methods : mapping of str, sequence, one method, or None
        Names of methods, as :func:`jotlight.reconstruct` takes them, networks, and functions
        ``f(bits, sensor)`` or ``f(bits)``; or a mapping of titles to them, where None is the
        recommended method. Without a mapping, None: all methods that are installed and serve the
        sensor. ``network.with_precision("bf16")`` is a network in another precision.
    image : array_like of float, shape (H, W)
        Intensities. A sensor with a mosaic needs red, green, and blue, (H, W, 3). With
        `channel_axis`, other sensors take color images, too.
    sensor : Sensor
        Sensor that exposes the image. The white balance of its mosaic is ignored, because the true
        image has none.
    channel_axis : int, optional
        Axis of the image that holds 1 or 3 channels. Default: the last one if the sensor has a
        mosaic, and else none.
    rng : int, numpy.random.Generator, or None
        Seed of the bits.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction. Default: a bar in notebooks.

    Returns
    -------
    Comparison
        Printed, it is a table; ``plot()`` returns a figure.

    Raises
    ------
    TypeError, ValueError
        When a method is unknown, does not serve the sensor, or returns no image.

    Examples
    --------
    >>> mine = lambda bits: bits.counts() / 16
    >>> photo = jl.datasets.photograph()[:64, :64]
    >>> found = jl.compare({"mine": mine, "mle": "mle"}, photo, jl.Sensor(frames=16))
    >>> [result.method for result in found.results]
    ['mine', 'mle']
    """
    require_sensor(sensor, may_differ=True, takes_mosaics=True)
    sensor = sensor.without_white_balance()
    pixels = as_image(image)
    if sensor.mosaic is not None and channel_axis is None and pixels.ndim == 3:
        channel_axis = -1  # where the mosaic finds the colors
    layout = Layout.of("image", pixels, channel_axis)
    if layout.is_stack or layout.number not in (1, 3):
        raise ValueError(f"image: expected a gray or RGB image, got {_describe(layout)}")
    known = _named_methods(methods, sensor, is_color=layout.number == 3)
    names = list(known)
    with shown_progress(progress, "comparing") as update:
        begin = equal_steps(update, len(names) + 1)
        show = begin("drawing bits")
        bits = sensor.expose(pixels, rng, channel_axis=channel_axis, threads=threads, progress=show)
        if channel_axis is not None:  # the estimates have the channels last
            pixels = np.moveaxis(pixels, channel_axis, -1)
        results = compare_methods(
            pixels, bits, sensor, names, threads=threads, begin=begin, methods=known
        )
        update(1.0)
    return Comparison(pixels, bits, results, {name: known[name].title for name in names})


def default_methods(sensor: Sensor, *, is_color: bool) -> dict[str, str]:
    """Return the names of all methods that are installed and serve a sensor, by their titles.

    The color network is one of them if it is the default: for an image that `is_color`, up to 1,000
    trials per pixel. Above, the blend on held-out bits contains it.

    Examples
    --------
    >>> default_methods(jl.Sensor(frames=8, mosaic="RGGB"), is_color=True)["network, color"]
    'network-color'
    """
    names = select_methods(sensor)
    if Request().choose(sensor, takes_colors=is_color).method == COLOR_NETWORK:
        names.append(COLOR_NETWORK)
    return {title_of(name, sensor): name for name in names}


def _named_methods(methods: object, sensor: Sensor, *, is_color: bool) -> dict[str, Method]:
    """Return the methods to compare, all of which serve the sensor, by the names of the results."""
    if methods is None:
        methods = list(default_methods(sensor, is_color=is_color).values())
    if isinstance(methods, Mapping):
        names, values = [str(title) for title in methods], list(methods.values())
        titles = names
    else:
        values = list(methods) if isinstance(methods, list | tuple) else [methods]
        names = [each if isinstance(each, str) else _name_of(each) for each in values]
        titles = [title_of(name, sensor) if name in METHOD_NAMES else name for name in names]
    if not values:
        raise ValueError("methods: expected at least one, got none")
    if len(set(names)) < len(names):
        raise ValueError(
            f"methods: expected different titles, got {', '.join(names)}; pass a mapping of "
            "titles to methods, such as {'mine': function}"
        )
    named = select_methods(sensor, [value for value in values if isinstance(value, str)])
    if COLOR_NETWORK in named and not is_color:
        raise ValueError(
            f"methods: {COLOR_NETWORK} takes red, green, and blue, got a gray image; leave it out"
        )
    each = zip(names, titles, values, strict=True)
    return {name: _as_method(title, value, sensor) for name, title, value in each}


def _name_of(method: object) -> str:
    """Return the name of a function, or the type of another object; None is the recommended one."""
    if method is None:
        return "recommended"
    return str(getattr(method, "__name__", type(method).__name__))


def _describe(layout: Layout) -> str:
    """Return the number of channels, or the axes of a stack."""
    return f"a stack {layout.shape}" if layout.is_stack else f"{layout.number} channels"


def _as_method(title: str, method: AnyMethod | None, sensor: Sensor) -> Method:
    """Return a method with a title."""
    are_counts_enough = sensor.has_plain_bits and sensor.mosaic is None
    if isinstance(method, str) and method != COLOR_NETWORK and are_counts_enough:
        return dataclasses.replace(find_method(method), title=title)
    if not (method is None or isinstance(method, str | AnyNetwork) or callable(method)):
        raise TypeError(
            f"methods: expected the name of a method, a network, or a function for {title!r}, got "
            f"{wrong_network(method) or repr(method)[:80]}"
        )
    # A function of the caller may count its calls, or work for one size of images only.
    is_own = callable(method) and not isinstance(method, AnyNetwork)
    return Method(title, partial(reconstruct, method=method), warms_up=not is_own)


def _format_time(seconds: float) -> str:
    return f"{1000 * seconds:.1f} ms" if seconds < 1 else f"{seconds:.2f} s"
