"""Beyond the paper: PSNR by exposure and by bits per pixel, for every method."""

from collections.abc import Callable
from typing import Any

import numpy as np

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.experiments import fig7
from jotlight.experiments.experiment import (
    Experiment,
    Lab,
    Outcome,
    Part,
    Results,
    Row,
    Update,
)
from jotlight.experiments.learning import learn, sensor_of
from jotlight.experiments.names import ALGEBRAIC
from jotlight.experiments.report.curves import COLOURS, Axes, Line, draw
from jotlight.experiments.report.section import Column, Curves, Section, Table
from jotlight.networks.pretrained import BITS_PER_PIXEL, unsupported_reason

SETTINGS = {
    "bits": 16,
    "gains": [1, 2, 4, 8, 16, 32, 64, 128],
    "many_bits": list(BITS_PER_PIXEL),
    "images": 10,
    "side": 256,
    "learning_images": 200,
    "learning_steps": None,
    "learning_batch": None,
    "seed": 0,
}

_FAST = 20.0
"""Milliseconds per Berkeley image on one core, for a method that counts as fast."""


def parts(lab: Lab) -> list[Part]:
    """One for each sensor."""
    settings = lab.settings

    def one_sensor(axis: str, sensor: jl.Sensor) -> Callable[[Update], Outcome]:
        def run(update: Update) -> Outcome:
            if unsupported_reason(sensor, "two-layer") is None:
                network = jl.pretrained(sensor, "two-layer")
            else:
                _, scenes = lab.data.photographs("train", settings["learning_images"])
                network, _ = learn(
                    lab, f"gain{sensor.gain:g}", sensor, scenes, lambda share: update(share / 3)
                )
            runs = fig7.methods(network)
            runs.pop(ALGEBRAIC, None)
            names, images = lab.data.photographs("test")
            # Spread over the whole set.
            chosen = range(0, len(images), max(1, len(images) // settings["images"]))
            chosen = chosen[: settings["images"]]
            rows: list[Row] = []
            for done, number in enumerate(chosen):
                update(1 / 3 + 2 / 3 * done / len(chosen))
                image = fig7.part_of(images[number], settings["side"])
                bits = sensor.expose(image, number, threads=lab.threads)
                for method, reconstruct in runs.items():
                    estimate = reconstruct(bits, sensor, threads=lab.threads)
                    rows.append(
                        {
                            "axis": axis,
                            "bits": sensor.bits_per_pixel,
                            "gain": sensor.gain,
                            "image": names[number],
                            "method": method,
                            "psnr": jl.metrics.psnr(estimate, image),
                            "ssim": jl.metrics.ssim(estimate, image),
                        }
                    )
            return Outcome(rows)

        return run

    exposures = [sensor_of(settings["bits"], gain=float(gain)) for gain in settings["gains"]]
    return [
        *(Part(f"gain{s.gain:g}", 60, one_sensor("exposure", s)) for s in exposures),
        *(
            Part(f"k{bits}", 35, one_sensor("bits", sensor_of(bits)))
            for bits in settings["many_bits"]
        ),
    ]


def section(results: Results) -> Section:
    """Both sets of curves, and which method wins where."""
    settings = results.settings
    bits = settings["bits"]
    exposures = [gain / bits for gain in settings["gains"]]
    by_exposure = {
        gain / bits: _means(results, axis="exposure", gain=gain) for gain in settings["gains"]
    }
    by_bits = {k: _means(results, axis="bits", bits=k) for k in settings["many_bits"]}
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"{len(results.distinct('image'))} test images of BSDS300 in grey, their middle "
        f"{settings['side']} × {settings['side']}, by every method that is installed, with the "
        "strengths that it has by default. Above by exposure, α / K: photons per jot where the "
        f"scene has intensity 1, K = {bits}; below by K with α = K. The network is learned for "
        "each exposure by the default recipe from the training images, and that of the package "
        "where it fits.",
        "jotlight reproduce gain",
        tables=[
            _table(f"PSNR in dB by exposure α / K, K = {bits}", by_exposure),
            _winners("photons per jot, α / K", by_exposure, _fast(results)),
            _table("PSNR in dB by bits per pixel K, α = K", by_bits),
            _winners("bits per pixel K", by_bits, _fast(results)),
        ],
        curves=[
            Curves(
                "gain-exposure",
                f"PSNR by exposure, K = {bits}",
                draw([_axes(by_exposure, "photons per jot at intensity 1, α / K", exposures)]),
            ),
            Curves(
                "gain-bits",
                "PSNR by bits per pixel, α = K",
                draw([_axes(by_bits, "bits per pixel K", settings["many_bits"])]),
            ),
        ],
    )


def _means(results: Results, **where: Any) -> dict[str, float]:
    return {
        method: float(results.numbers("psnr", method=method, **where).mean())
        for method in results.distinct("method")
    }


def _axes(means: dict[float, dict[str, float]], x: str, ticks: list[float]) -> Axes:
    found = next(iter(means.values()))
    lines = [
        Line(
            METHODS[method].title,
            list(means),
            [row[method] for row in means.values()],
            color=COLOURS[method],
            marker="o" if method == "network-two-layer" else ".",
        )
        for method in found
    ]
    return Axes(lines, x=x, y="PSNR, dB", x_log=True, ticks=ticks)


def _table(title: str, means: dict[float, dict[str, float]]) -> Table:
    found = next(iter(means.values()))
    return Table(
        title,
        [Column("method"), *(Column(f"{value:g}", 2, "highest") for value in means)],
        [[METHODS[method].title, *(row[method] for row in means.values())] for method in found],
    )


def _fast(results: Results) -> set[str]:
    """The methods that `timing` found to be fast; none where it was not run."""
    time = results.others.get("timing")
    if time is None:
        return set()
    cores = time.distinct("cores")[0]
    return {
        method
        for method in time.distinct("method")
        if np.median(time.numbers("milliseconds", cores=cores, method=method)) < _FAST
    }


def _winners(first: str, means: dict[float, dict[str, float]], fast: set[str]) -> Table:
    """The best method, and the best of some."""
    groups: dict[str, Callable[[str], bool]] = {
        "best": lambda name: True,
        "best under a free licence": lambda name: METHODS[name].required_package != "bm3d",
    }
    if fast:
        groups[f"best in less than {_FAST:g} ms"] = lambda name: name in fast
    rows: list[list[Any]] = []
    for value, row in means.items():
        cells: list[Any] = [int(value) if value == int(value) else value]
        for belongs in groups.values():
            best = max(filter(belongs, row), key=row.__getitem__)
            cells += [METHODS[best].title, row[best]]
        rows.append(cells)
    columns = [Column(first)]
    for title in groups:
        columns += [Column(title), Column("PSNR, dB", 2)]
    return Table(
        f"Which to take, by {first}",
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
    needs=("bsds300",),
)
