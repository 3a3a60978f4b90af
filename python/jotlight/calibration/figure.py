"""A page of plots of a calibration."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.calibration.fields import CalibrationFields
from jotlight.calibration.steadiness import Steadiness
from jotlight.figure_style import INK, MARK, QUIET, add_color_bar, draw_absence, set_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jotlight.figures import Figure

_BAR = "#9db4c8"
_HOT, _MASKED, _DEAD = "#f2a541", "#c1292e", "#2f6fdb"


def page(calibration: CalibrationFields) -> "Figure":
    """Return a figure with the maps, the distributions and their limits, and the numbers."""
    from jotlight.figures import Figure

    figure = Figure(17, 9)
    axes = figure.subplots(2, 4)
    captures = (f"{name}: {provenance}" for name, provenance in calibration.provenance.items())
    heading = "\n".join(["calibration", *captures])
    figure.suptitle(heading, x=0.01, ha="left", color=INK, fontsize=12)
    _dark_map(axes[0, 0], calibration)
    _dark_histogram(axes[0, 1], calibration)
    _flags(axes[0, 2], calibration)
    _numbers(axes[0, 3], calibration)
    if calibration.efficiency is None:
        for place in axes[1, :2]:
            draw_absence(place, "no flat capture, so no response")
    else:
        _response(axes[1, 0], axes[1, 1], calibration, calibration.efficiency * calibration.scale)
    _steadiness(axes[1, 2], "dark", calibration.dark_steadiness)
    if calibration.efficiency is None:
        draw_absence(axes[1, 3], "no flat capture,\nso no test of its change over time")
    else:
        _steadiness(axes[1, 3], "flat", calibration.flat_steadiness)
    return figure


def _image(axes: "Axes", image: npt.NDArray[np.floating], title: str, **options: Any) -> None:
    shown = axes.imshow(image, interpolation="nearest", **options)
    axes.set_xticks([])
    axes.set_yticks([])
    set_title(axes, title)
    add_color_bar(axes, shown, shrink=0.75, location="bottom", pad=0.02)


def _dark_map(axes: "Axes", calibration: CalibrationFields) -> None:
    # The logarithm of 0 is infinite, so one count in all frames replaces 0.
    smallest = 1 / calibration.dark_frames
    image = np.log10(np.maximum(calibration.dark_counts, smallest))
    _image(axes, image, "dark counts per frame, log₁₀", cmap="inferno")


def _dark_histogram(axes: "Axes", calibration: CalibrationFields) -> None:
    ones, bulk = calibration.dark_ones, calibration.bulk
    top = min(max(3 * calibration.hot_threshold, 10), calibration.dark_frames)
    step = max(1, top // 200)
    edges = np.arange(0, top + step + 1, step) - 0.5
    number, _ = np.histogram(ones, edges)
    axes.bar(edges[:-1], number, width=step, align="edge", color=_BAR, label="jots")
    middle = np.rint((edges[:-1] + edges[1:]) / 2)
    middle = middle[middle <= calibration.dark_frames]
    # Not all jots are ordinary, so the curve is scaled to the lower half of the jots.
    half = np.arange(np.median(ones) + 1)
    ordinary = (ones < len(half)).sum() / np.exp(bulk.log_probability(half)).sum()
    expected = ordinary * step * np.exp(bulk.log_probability(middle))
    axes.plot(middle, expected, color=MARK, linewidth=1.5, label="ordinary jots, fitted")
    if calibration.insufficient_frames_reason() is None:
        axes.axvline(
            calibration.hot_threshold - 0.5,
            color=_HOT,
            linestyle="--",
            label=f"hot: {calibration.hot_threshold} or more",
        )
    axes.set_yscale("log")
    axes.set_ylim(0.5, 2 * max(int(number.max()), 1))
    above = int((ones > edges[-1]).sum())
    axes.set_xlabel(
        f"ones in {calibration.dark_frames} dark frames"
        + (f"; {above} jots are beyond the axis" if above else ""),
        color=QUIET,
    )
    axes.legend(fontsize=8, frameon=False)
    set_title(axes, "distribution of the dark counts")


def _flags(axes: "Axes", calibration: CalibrationFields) -> None:
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    image = np.ones((*calibration.shape, 3))
    masked_hot = calibration.hot & calibration.mask
    shown = [
        (_HOT, calibration.hot & ~calibration.mask, "hot, used with its dark counts"),
        (_MASKED, masked_hot, "hot, masked"),
        (_DEAD, calibration.dead, "dead, masked"),
    ]
    for color, flags, _ in shown:
        image[flags] = to_rgb(color)
    axes.imshow(image, interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.legend(
        handles=[
            Patch(color=color, label=f"{text}: {flags.sum()} ({flags.mean():.2%})")
            for color, flags, text in shown
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.02),
        fontsize=8,
        frameon=False,
    )
    set_title(axes, "hot and dead jots")


def _response(
    map_axes: "Axes",
    axes: "Axes",
    calibration: CalibrationFields,
    relative: npt.NDArray[np.float32],
) -> None:
    good = relative[~calibration.mask]
    low, high = np.percentile(good, (0.5, 99.5))
    image = np.where(calibration.mask, np.nan, relative)
    _image(map_axes, image, "response relative to the neighborhood", vmin=low, vmax=high)
    axes.hist(good, bins=100, range=(good.min(), good.max()), color=_BAR)
    axes.set_yscale("log")
    axes.set_xlabel(
        "response of the jots that are not masked\n"
        f"the PRNU excludes the counting noise of {calibration.flat_noise:.2%}",
        color=QUIET,
    )
    set_title(axes, f"PRNU {calibration.prnu:.2%} ± {calibration.prnu_error:.2%}")


def _steadiness(axes: "Axes", name: str, found: Steadiness | None) -> None:
    if found is None:
        draw_absence(axes, f"{name}: only counts,\nso no test of change over time")
        return
    _image(axes, found.map, f"{name}: change over time, in σ", vmin=-4, vmax=4, cmap="RdBu_r")
    axes.set_xlabel(
        f"correlation of successive frames\n{found.correlation:.2g} ± "
        f"{found.correlation_error:.2g} (z = {found.correlation_z:.1f})\n"
        f"change over time: z = {found.homogeneity_z:.1f}",
        color=QUIET,
    )


def _numbers(axes: "Axes", calibration: CalibrationFields) -> None:
    axes.set_axis_off()
    for index, fact in enumerate(facts(calibration)):
        # Offsets in points keep the distance of the lines for any height of the axes.
        for text, color, size, below in zip(fact, (QUIET, INK), (7, 8.5), (0, 8), strict=True):
            axes.annotate(
                text,
                (0, 1),
                xytext=(0, -21 * index - below),
                xycoords="axes fraction",
                textcoords="offset points",
                color=color,
                fontsize=size,
                va="top",
            )


def facts(calibration: CalibrationFields) -> list[tuple[str, str]]:
    """Return pairs of name and text that the page and the command line show."""
    dead, mask, rate = calibration.dead, calibration.mask, calibration.false_positive_rate
    lines = [
        ("jots", " x ".join(map(str, calibration.shape))),
        (
            "dark counts",
            f"median {np.median(calibration.dark_counts):.3g} per frame, from "
            f"{calibration.dark_frames} frames",
        ),
        *_hot(calibration),
    ]
    if calibration.mosaic is not None:
        lines.insert(1, ("color filters", repr(calibration.mosaic)))
    if calibration.prnu is not None:
        expected = f"at most {rate * dead.size:.2g} by chance"
        lines.append(("dead", f"{dead.sum()} ({dead.mean():.2%}); {expected}"))
    lines.append(
        (
            "masked",
            f"{mask.sum()} ({mask.mean():.2%}): dead, or hot with more than "
            f"{calibration.max_dark:g} per frame",
        )
    )
    if calibration.prnu is not None:
        lines.append(
            (
                "PRNU",
                f"{calibration.prnu:.2%} ± {calibration.prnu_error:.2%}, without "
                f"{calibration.flat_noise:.2%} of counting noise",
            )
        )
    for name in ("dark", "flat"):
        found = getattr(calibration, f"{name}_steadiness")
        if found is not None:
            lines.append(
                (f"{name}: correlation of frames", _z(found.correlation, found.correlation_z))
            )
            lines.append((f"{name}: change over time", f"z = {found.homogeneity_z:.1f}"))
    return lines


def _hot(calibration: CalibrationFields) -> list[tuple[str, str]]:
    hot, rate = calibration.hot, calibration.hot_probability
    if (reason := calibration.insufficient_frames_reason()) is not None:
        return [("hot", "none found: too few frames"), ("hot by chance", reason)]
    limit = f"{calibration.false_positive_rate:.2g}"
    return [
        ("hot", f"{hot.sum()} ({hot.mean():.2%}); {calibration.hot_threshold} ones or more"),
        ("hot by chance", f"{rate * hot.size:.2g}, a rate of {rate:.2g}; at most {limit}"),
    ]


def _z(value: float, z: float) -> str:
    return f"{value:.2g} (z = {z:.1f})"
