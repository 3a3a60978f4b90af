"""Where each method wins: PSNR by exposure and by trials per pixel. This goes beyond the paper."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jotlight.datasets.fetch import Progress
from jotlight.evaluation.methods import METHODS
from jotlight.experiments.bsds_methods import (
    TWO_LAYER_METHOD,
    crop_center,
    methods_for,
    methods_with,
)
from jotlight.experiments.experiment import (
    Experiment,
    Part,
    PartResult,
    Results,
    Row,
    RunContext,
    command_of,
)
from jotlight.experiments.method_titles import ALGEBRAIC, method_title
from jotlight.experiments.report.content import Column, Curves, Section, Table
from jotlight.experiments.report.curves import METHOD_COLORS, OTHER_COLOR, Axes, Line, render_svg
from jotlight.experiments.training_runs import paper_sensor, train_by_default
from jotlight.metrics import psnr, ssim
from jotlight.networks.network import Network
from jotlight.networks.pretrained import TRAINED_TRIALS, pretrained, uses_conditional
from jotlight.sensing.sensor import Sensor

SETTINGS = {
    "bits": 16,
    "gains": [1, 2, 4, 8, 16, 32, 64, 128],
    "many_bits": list(TRAINED_TRIALS),
    "images": 10,
    "side": 256,
    "learning_images": 200,
    "learning_steps": None,
    "learning_batch": None,
    "seed": 0,
}

_MAX_FAST = 20.0
"""Maximum milliseconds per Berkeley image on one core of a method that counts as fast."""

Means = dict[float, dict[str, float]]
"""Mean PSNR by exposure or by trials per pixel, and by method."""


def parts(context: RunContext) -> list[Part]:
    """Return one part for each sensor."""
    settings = context.settings

    def one_sensor(axis: str, sensor: Sensor) -> Callable[[Progress], PartResult]:
        return lambda progress: PartResult(_rows(context, axis, sensor, progress))

    exposures = [paper_sensor(settings["bits"], gain=float(gain)) for gain in settings["gains"]]
    return [
        *(Part(f"gain{s.gain:g}", 60, one_sensor("exposure", s)) for s in exposures),
        *(
            Part(f"k{bits}", 35, one_sensor("bits", paper_sensor(bits)))
            for bits in settings["many_bits"]
        ),
    ]


def _rows(context: RunContext, axis: str, sensor: Sensor, progress: Progress) -> list[Row]:
    """Return PSNR and SSIM of every method on every image for one sensor."""
    settings = context.settings
    runs = methods_with(_network(context, sensor, progress), sensor, context.own)
    runs.pop(ALGEBRAIC, None)
    names, images = context.data.bsds300("test")
    # The chosen images are spread over the whole set.
    chosen = range(0, len(images), max(1, len(images) // settings["images"]))
    chosen = chosen[: settings["images"]]
    rows: list[Row] = []
    for done, number in enumerate(chosen):
        progress(1 / 3 + 2 / 3 * done / len(chosen))
        image = crop_center(images[number], settings["side"])
        bits = sensor.expose(image, number, threads=context.threads)
        for method, reconstruct in runs.items():
            estimate = reconstruct(bits, sensor, threads=context.threads)
            rows.append(
                {
                    "axis": axis,
                    "bits": sensor.trials,
                    "gain": sensor.gain,
                    "image": names[number],
                    "method": method,
                    "psnr": psnr(estimate, image, data_range=1.0),
                    "ssim": ssim(estimate, image, data_range=1.0),
                }
            )
    return rows


def _network(context: RunContext, sensor: Sensor, progress: Progress) -> Network:
    """Return the package's network for the sensor's K and exposure, or train one."""
    if not uses_conditional(sensor, "two-layer"):
        return pretrained(sensor, "two-layer")
    _, scenes = context.data.bsds300("train", context.settings["learning_images"])
    name = f"gain{sensor.gain:g}"
    network, _ = train_by_default(context, name, sensor, scenes, lambda share: progress(share / 3))
    return network


def section(results: Results) -> Section:
    """Return the curves by exposure and by bits, and which method wins where."""
    settings = results.settings
    bits = settings["bits"]
    exposures = [gain / bits for gain in settings["gains"]]
    by_exposure = {
        gain / bits: _means(results, axis="exposure", gain=gain) for gain in settings["gains"]
    }
    by_bits = {k: _means(results, axis="bits", bits=k) for k in settings["many_bits"]}
    fast = _fast_methods(results)
    measured = results.unique("method")
    added = [name for name in methods_for(paper_sensor(bits)) if name not in measured]
    without = f" (without {', '.join(map(method_title, added))})" if added else ""
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"{len(results.unique('image'))} test images of BSDS300 in gray, their central "
        f"{settings['side']} × {settings['side']} pixels, by every installed method with its "
        f"default strength that serves the sensor{without}. The first tables are by exposure "
        f"α / K, the photons per jot where the scene has intensity 1, at K = {bits}. The second "
        "tables are by K with α = K. The learned network is the package's own where the package "
        "has one for the sensor; otherwise this run trains it on the training images by the "
        "default training.",
        command_of(EXPERIMENT.name, settings),
        ["gain.csv"],
        tables=[
            _psnr_table(f"PSNR in dB by exposure α / K, K = {bits}", by_exposure),
            _best_table("photons per jot, α / K", by_exposure, fast),
            _psnr_table("PSNR in dB by trials per pixel K, α = K", by_bits),
            _best_table("trials per pixel K", by_bits, fast),
        ],
        curves=[
            Curves(
                "gain-exposure",
                f"PSNR by exposure, K = {bits}",
                render_svg(
                    [_axes(by_exposure, "photons per jot at intensity 1, α / K", exposures)]
                ),
            ),
            Curves(
                "gain-bits",
                "PSNR by trials per pixel, α = K",
                render_svg([_axes(by_bits, "trials per pixel K", settings["many_bits"])]),
            ),
        ],
    )


def _means(results: Results, **where: Any) -> dict[str, float]:
    """Return the mean PSNR of each method that serves a sensor, in the order of the tables."""
    columns = {
        method: results.column("psnr", method=method, **where)
        for method in results.unique("method")
    }
    return {method: float(column.mean()) for method, column in columns.items() if column.size}


def _axes(means: Mapping[float, dict[str, float]], x_label: str, ticks: list[float]) -> Axes:
    lines = [
        Line(
            method_title(method),
            [value for value, row in means.items() if method in row],
            [row[method] for row in means.values() if method in row],
            color=METHOD_COLORS.get(method, OTHER_COLOR),
            marker="o" if method == TWO_LAYER_METHOD else ".",
        )
        for method in _methods_of(means)
    ]
    return Axes(lines, x_label, "PSNR, dB", x_log=True, x_ticks=ticks)


def _methods_of(means: Mapping[float, dict[str, float]]) -> list[str]:
    """Return the methods that serve any of the sensors, in the order of all tables."""
    found = dict.fromkeys(method for row in means.values() for method in row)
    known = [method for method in METHODS if method in found]
    return known + [method for method in found if method not in METHODS]


def _psnr_table(title: str, means: Means) -> Table:
    return Table(
        title,
        [Column("method"), *(Column(f"{value:g}", ".2f", "highest") for value in means)],
        [
            [method_title(method), *(row.get(method) for row in means.values())]
            for method in _methods_of(means)
        ],
    )


def _fast_methods(results: Results) -> set[str]:
    """Return the methods that `timing` found to be fast, or none if it was not run."""
    timing = results.others.get("timing")
    if timing is None:
        return set()
    cores = timing.unique("cores")[0]
    return {
        method
        for method in timing.unique("method")
        if np.median(timing.column("milliseconds", cores=cores, method=method)) < _MAX_FAST
    }


def _best_table(first: str, means: Means, fast: set[str]) -> Table:
    """Return the best of all methods, of those with a free license, and of the fast ones."""
    groups: dict[str, Callable[[str], bool]] = {
        "best": lambda name: True,
        "best under a free license": lambda name: name != "noniterative-bm3d",
    }
    if fast:
        groups[f"best in less than {_MAX_FAST:g} ms"] = lambda name: name in fast
    rows: list[list[Any]] = []
    for value, row in means.items():
        cells: list[Any] = [int(value) if value == int(value) else value]
        for belongs in groups.values():
            best = max(filter(belongs, row), key=row.__getitem__)
            cells += [method_title(best), row[best]]
        rows.append(cells)
    columns = [Column(first)]
    for title in groups:
        columns += [Column(title), Column("PSNR, dB", ".2f")]
    return Table(
        f"The best method, by {first}",
        columns,
        rows,
        "BM3D's package is for non-commercial use.",
    )


EXPERIMENT = Experiment(
    "gain",
    "Where each method wins",
    SETTINGS,
    {
        **SETTINGS,
        "gains": [4, 16],
        "many_bits": [9, 36],
        "images": 1,
        "side": 64,
        "learning_images": 8,
        "learning_steps": 2,
        "learning_batch": 16,
    },
    parts,
    section,
    compares_methods=True,
    datasets=("bsds300",),
)
