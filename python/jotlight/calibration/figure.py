"""A page of plots of a calibration. Made without pyplot, as all figures are."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.calibration.result import Calibration
from jotlight.calibration.steadiness import Steadiness

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK, _QUIET, _MARK, _BAR = "#1d2733", "#5b6876", "#e4572e", "#9db4c8"
_HOT, _MASKED, _DEAD = "#f2a541", "#c1292e", "#2f6fdb"


def page(calibration: Calibration) -> "Figure":
    """Draw the maps, the distributions with the lines that were drawn in them, and the numbers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(17, 9), facecolor="white", layout="constrained")
    axes = figure.subplots(2, 4)
    captures = (f"{name}: {provenance}" for name, provenance in calibration.provenance.items())
    heading = "\n".join(["calibration", *captures])
    figure.suptitle(heading, x=0.01, ha="left", color=_INK, fontsize=12)
    _dark_map(axes[0, 0], calibration)
    _dark_histogram(axes[0, 1], calibration)
    _flags(axes[0, 2], calibration)
    _numbers(axes[0, 3], calibration)
    if calibration.efficiency is None:
        for place in axes[1, :2]:
            _absent(place, "no flat capture, so no response")
    else:
        _response(axes[1, 0], axes[1, 1], calibration, calibration.efficiency * calibration.scale)
    _steadiness(axes[1, 2], "dark", calibration.dark_steadiness)
    _steadiness(axes[1, 3], "flat", calibration.flat_steadiness)
    return figure


def _title(axes: "Axes", words: str) -> None:
    axes.set_title(words, fontsize=11, color=_INK, loc="left")


def _absent(axes: "Axes", words: str) -> None:
    axes.text(0.5, 0.5, words, ha="center", color=_QUIET, transform=axes.transAxes)
    axes.set_axis_off()


def _image(axes: "Axes", image: npt.NDArray[np.floating], title: str, **how: Any) -> None:
    shown = axes.imshow(image, interpolation="nearest", **how)
    axes.set_xticks([])
    axes.set_yticks([])
    _title(axes, title)
    axes.figure.colorbar(shown, ax=axes, shrink=0.75, location="bottom", pad=0.02)


def _dark_map(axes: "Axes", calibration: Calibration) -> None:
    # One count in all frames stands for none of them, which a logarithm cannot show.
    least = 1 / calibration.dark_frames
    image = np.log10(np.maximum(calibration.dark_counts, least))
    _image(axes, image, "dark counts per frame, log₁₀", cmap="inferno")


def _dark_histogram(axes: "Axes", calibration: Calibration) -> None:
    ones, bulk = calibration.dark_ones, calibration.bulk
    most = min(max(3 * calibration.hot_from, 10), calibration.dark_frames)
    step = max(1, most // 200)
    edges = np.arange(0, most + step + 1, step) - 0.5
    number, _ = np.histogram(ones, edges)
    axes.bar(edges[:-1], number, width=step, align="edge", color=_BAR, label="jots")
    middle = np.rint((edges[:-1] + edges[1:]) / 2)
    middle = middle[middle <= calibration.dark_frames]
    # As many as make the lower half what it is: not all jots are ordinary.
    half = np.arange(np.median(ones) + 1)
    ordinary = (ones < len(half)).sum() / np.exp(bulk.log_probability(half)).sum()
    expected = ordinary * step * np.exp(bulk.log_probability(middle))
    axes.plot(middle, expected, color=_MARK, linewidth=1.5, label="ordinary jots, fitted")
    if calibration.too_few() is None:
        axes.axvline(
            calibration.hot_from - 0.5,
            color=_HOT,
            linestyle="--",
            label=f"hot from {calibration.hot_from}",
        )
    axes.set_yscale("log")
    axes.set_ylim(0.5, 2 * max(int(number.max()), 1))
    above = int((ones > edges[-1]).sum())
    axes.set_xlabel(
        f"ones in {calibration.dark_frames} dark frames"
        + (f"; {above} jots lie further right" if above else ""),
        color=_QUIET,
    )
    axes.legend(fontsize=8, frameon=False)
    _title(axes, "how many jots have how many dark counts")


def _flags(axes: "Axes", calibration: Calibration) -> None:
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    image = np.ones((*calibration.shape, 3))
    masked_hot = calibration.hot & calibration.mask
    shown = [
        (_HOT, calibration.hot & ~calibration.mask, "hot, used with its dark counts"),
        (_MASKED, masked_hot, "hot, masked"),
        (_DEAD, calibration.dead, "dead, masked"),
    ]
    for colour, flags, _ in shown:
        image[flags] = to_rgb(colour)
    axes.imshow(image, interpolation="nearest")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.legend(
        handles=[
            Patch(color=colour, label=f"{words}: {flags.sum()} ({flags.mean():.2%})")
            for colour, flags, words in shown
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.02),
        fontsize=8,
        frameon=False,
    )
    _title(axes, "hot and dead jots")


def _response(
    map_axes: "Axes", axes: "Axes", calibration: Calibration, relative: npt.NDArray[np.float32]
) -> None:
    good = relative[~calibration.mask]
    low, high = np.percentile(good, (0.5, 99.5))
    image = np.where(calibration.mask, np.nan, relative)
    _image(map_axes, image, "response relative to its surroundings", vmin=low, vmax=high)
    axes.hist(good, bins=100, range=(good.min(), good.max()), color=_BAR)
    axes.set_yscale("log")
    axes.set_xlabel(
        "response of jots that are not masked\n"
        f"noise of counting, {calibration.flat_noise:.2%}, is taken off the PRNU",
        color=_QUIET,
    )
    _title(axes, f"PRNU {calibration.prnu:.2%} ± {calibration.prnu_error:.2%}")


def _steadiness(axes: "Axes", name: str, found: Steadiness | None) -> None:
    if found is None:
        _absent(axes, f"{name}: no single frames,\nso no look at change over time")
        return
    _image(axes, found.map, f"{name}: change over time, in σ", vmin=-4, vmax=4, cmap="RdBu_r")
    axes.set_xlabel(
        f"correlation of successive frames\n{found.correlation:.2g} ± "
        f"{found.correlation_error:.2g} (z = {found.correlation_z:.1f})\n"
        f"change over time: z = {found.homogeneity_z:.1f}",
        color=_QUIET,
    )


def _numbers(axes: "Axes", calibration: Calibration) -> None:
    axes.set_axis_off()
    for index, fact in enumerate(facts(calibration)):
        # In points, so that lines keep their distance whatever the height of the axes.
        for text, colour, size, below in zip(fact, (_QUIET, _INK), (7, 8.5), (0, 8), strict=True):
            axes.annotate(
                text,
                (0, 1),
                xytext=(0, -21 * index - below),
                xycoords="axes fraction",
                textcoords="offset points",
                color=colour,
                fontsize=size,
                va="top",
            )


def facts(calibration: Calibration) -> list[tuple[str, str]]:
    """What there is to tell in words, which the page and the command line show."""
    dead, mask, rate = calibration.dead, calibration.mask, calibration.false_positive_rate
    told = [
        ("jots", " x ".join(map(str, calibration.shape))),
        (
            "dark counts",
            f"median {np.median(calibration.dark_counts):.3g} per frame, from "
            f"{calibration.dark_frames} frames",
        ),
        *_hot(calibration),
    ]
    if calibration.prnu is not None:
        chance = f"by chance {rate * dead.size:.2g} at most"
        told.append(("dead", f"{dead.sum()} ({dead.mean():.2%}); {chance}"))
    told.append(
        (
            "masked",
            f"{mask.sum()} ({mask.mean():.2%}): dead, or hot with more than "
            f"{calibration.most_dark:g} per frame",
        )
    )
    if calibration.prnu is not None:
        told.append(
            (
                "PRNU",
                f"{calibration.prnu:.2%} ± {calibration.prnu_error:.2%}, without "
                f"{calibration.flat_noise:.2%} of counting",
            )
        )
    for name in ("dark", "flat"):
        found = getattr(calibration, f"{name}_steadiness")
        if found is not None:
            told.append((f"{name}: frames correlate", _z(found.correlation, found.correlation_z)))
            told.append((f"{name}: change over time", f"z = {found.homogeneity_z:.1f}"))
    return told


def _hot(calibration: Calibration) -> list[tuple[str, str]]:
    hot, chance = calibration.hot, calibration.hot_chance
    if (few := calibration.too_few()) is not None:
        return [("hot", "none can be told, with so few frames"), ("hot by chance", few)]
    asked = f"{calibration.false_positive_rate:.2g}"
    return [
        ("hot", f"{hot.sum()} ({hot.mean():.2%}), from {calibration.hot_from} ones on"),
        ("hot by chance", f"{chance * hot.size:.2g}, a rate of {chance:.2g}; {asked} at most"),
    ]


def _z(value: float, z: float) -> str:
    return f"{value:.2g} (z = {z:.1f})"
