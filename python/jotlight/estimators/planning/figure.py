"""Drawings of the expected and the actual accuracy of estimates."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.errors import counted
from jotlight.figure_style import MARK, QUIET, add_color_bar, set_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_CURVES = 6
"""Approximate maximum number of curves of the SNR."""


def draw_psnr(
    axes: "Axes", frames: npt.NDArray[np.int64], psnr: Array, target: float | None
) -> None:
    """Draw the PSNR of a scene over the number of frames, and a requested PSNR."""
    axes.plot(frames, psnr, color=MARK, marker="o", markersize=4)
    axes.set_xscale("log", base=2)
    if target is not None:
        axes.axhline(target, color=QUIET, linestyle=":")
    axes.set_xlabel("frames", color=QUIET)
    axes.grid(alpha=0.3)
    set_title(axes, "PSNR of the scene, dB")


def draw_snr(
    axes: "Axes", light: Array, frames: npt.NDArray[np.int64], snr: Array, bound: Array
) -> None:
    """Draw the SNR of a pixel and its bound over the light, for some numbers of frames.

    If there is one level of light, draw them over the number of frames.
    """
    if len(light) == 1:
        _draw_with_bound(axes, frames, snr[:, 0], bound[:, 0], MARK, marker="o", markersize=4)
        axes.set_xscale("log", base=2)
        axes.set_xlabel("frames", color=QUIET)
    else:
        shown = range(len(frames) - 1, -1, -max(1, len(frames) // (_MAX_CURVES - 1)))
        for place, row in enumerate(shown):
            label = counted(frames[row], "frame")
            _draw_with_bound(axes, light, snr[row], bound[row], f"C{place}", label=label)
        axes.set_xscale("log")
        axes.set_xlabel("photons per jot and frame", color=QUIET)
        # Beside the axes, where no curve can be.
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
    axes.grid(alpha=0.3)
    set_title(axes, "SNR of a pixel, dB (dotted: Cramér-Rao bound)")


def _draw_with_bound(
    axes: "Axes", x: npt.NDArray[Any], snr: Array, bound: Array, color: str, **style: Any
) -> None:
    axes.plot(x, snr, color=color, **style)
    axes.plot(x, bound, color=color, linestyle=":", linewidth=1)


def draw_map(axes: "Axes", values: npt.NDArray[np.floating], title: str) -> None:
    """Draw a map (H, W) with a color bar. Infinite values are blank.

    The colors end at the 99.5th percentile, and the color bar says so.
    """
    shown = np.where(np.isfinite(values), values, np.nan)
    high = float(np.nanpercentile(shown, 99.5)) if np.isfinite(shown).any() else 1.0
    image = axes.imshow(shown, vmin=0, vmax=high or 1.0, interpolation="nearest")
    axes.set(xticks=[], yticks=[])
    add_color_bar(axes, image, shrink=0.8)
    set_title(axes, title)


def draw_residuals(axes: "Axes", residuals: Mapping[str, Array]) -> None:
    """Draw residuals over the iterations."""
    for name, values in residuals.items():
        axes.plot(np.arange(1, len(values) + 1), values, label=name)
    axes.set_yscale("log")
    axes.set_xlabel("iteration", color=QUIET)
    axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.3)
    set_title(axes, "residuals")
