"""Quality against time: which method to pick."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jotlight.evaluation.methods import METHODS
from jotlight.experiments.experiment import Results
from jotlight.experiments.report.curves import COLOURS, Axes, Line, draw
from jotlight.experiments.report.section import Column, Curves, Section, Table


def section(results: Mapping[str, Results]) -> Section | None:
    """What `fig7` and `timing` say together; None if one of them was not run."""
    if "fig7" not in results or "timing" not in results:
        return None
    quality, time = results["fig7"], results["timing"]
    cores = time.distinct("cores")
    rows: list[list[Any]] = []
    lines = []
    for method in time.distinct("method"):
        if method not in quality.distinct("method"):
            continue
        psnr, ssim = (
            float(quality.numbers(measure, method=method).mean()) for measure in ("psnr", "ssim")
        )
        medians = [
            float(np.median(time.numbers("milliseconds", cores=which, method=method)))
            for which in cores
        ]
        rows.append([METHODS[method].title, psnr, ssim, *medians])
        lines.append(Line(METHODS[method].title, [medians[0]], [psnr], COLOURS[method], marker="o"))
    return Section(
        "overview",
        "Which method to pick",
        f"Mean PSNR and SSIM over {len(quality.distinct('image'))} Berkeley images at K = "
        f"{quality.settings['bits']} (figure 7, below) beside the median time for one of them "
        "(time per image, below). Up is better, left is faster.",
        "",
        tables=[
            Table(
                "Quality and time",
                [
                    Column("method"),
                    Column("PSNR, dB", 2, "highest"),
                    Column("SSIM", 3, "highest"),
                    *(Column(f"ms, {which}", 2, "lowest") for which in cores),
                ],
                rows,
            )
        ],
        curves=[
            Curves(
                "overview",
                "PSNR against time per image",
                draw(
                    [
                        Axes(
                            lines,
                            x=f"milliseconds per image, {cores[0]}",
                            y="PSNR, dB",
                            x_log=True,
                        )
                    ]
                ),
            )
        ],
    )
