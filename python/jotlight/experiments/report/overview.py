"""The section that compares the quality and the time of all methods."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jotlight.evaluation.many_trials import MAX_NETWORK_TRIALS
from jotlight.experiments.experiment import Results
from jotlight.experiments.method_titles import ALGEBRAIC, method_title
from jotlight.experiments.report.changes import row_title
from jotlight.experiments.report.content import Column, Curves, Section, Table
from jotlight.experiments.report.curves import METHOD_COLORS, OTHER_COLOR, Axes, Line, render_svg


def overview_section(results: Mapping[str, Results], date: str) -> Section | None:
    """Return what `fig7` and `timing` say together, or None if one of them was not run.

    `date` is the day of the older one.
    """
    if "fig7" not in results or "timing" not in results:
        return None
    quality, timing = results["fig7"], results["timing"]
    cores = timing.unique("cores")
    rows: list[list[Any]] = []
    lines = []
    for method in quality.unique("method"):
        if method == ALGEBRAIC:
            continue  # its time is that of BM3D
        title = method_title(method)
        psnr, ssim = (
            float(quality.column(measure, method=method).mean()) for measure in ("psnr", "ssim")
        )
        times = [timing.column("milliseconds", cores=which, method=method) for which in cores]
        # An earlier run may lack the time of a method.
        medians = [float(np.median(each)) if each.size else None for each in times]
        rows.append([row_title(title, method, date), psnr, ssim, *medians])
        if medians[0] is not None:
            color = METHOD_COLORS.get(method, OTHER_COLOR)
            lines.append(Line(title, [medians[0]], [psnr], color, marker="o"))
    columns = [
        Column("method"),
        Column("PSNR, dB", ".2f", "highest"),
        Column("SSIM", ".3f", "highest"),
        *(Column(f"ms, {which}", ".2f", "lowest") for which in cores),
    ]
    axes = Axes(lines, f"milliseconds per image, {cores[0]}", "PSNR, dB", x_log=True)
    return Section(
        "overview",
        "Which method to pick",
        f"Mean PSNR and SSIM over {len(quality.unique('image'))} Berkeley images at K = "
        f"{quality.settings['bits']} (figure 7, below) beside the median time for one of them "
        "(time per image, below). Up is better, left is faster. The list names every method that "
        "serves this sensor and differs from the others: for the box kernel, iterative maximum "
        "likelihood equals maximum likelihood, and the best blend on held-out bits is for more "
        f"than {MAX_NETWORK_TRIALS:,} trials per pixel. A dash instead of a time means that the "
        "run that measured the times did not include the method. Rows *changed since* are of "
        "methods that changed after the measurement, as the top of the page states. [Their present "
        "quality](networks.md#quality) is on another page.",
        tables=[Table("Quality and time", columns, rows)],
        curves=[Curves("overview", "PSNR against time per image", render_svg([axes]))],
    )
