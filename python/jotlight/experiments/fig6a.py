"""Figure 6a: PSNR by K on synthetic scenes, before and after learning, and the limit."""

from collections.abc import Callable
from typing import Any

import numpy as np

import jotlight as jl
from jotlight import datasets
from jotlight.experiments import by_bits
from jotlight.experiments.experiment import Experiment, Lab, Outcome, Part, Results, Update
from jotlight.experiments.limit import posterior_mean_psnr
from jotlight.experiments.report.section import Claim, Section


def parts(lab: Lab) -> list[Part]:
    """One for each K, and the paper's descent."""
    scenes = datasets.uniform_scenes(
        np.random.default_rng([lab.settings["seed"], 1]), lab.settings["test_scenes"]
    )

    def measure(run: Callable[..., Any], sensor: jl.Sensor) -> float:
        """PSNR of the mean square error over all scenes, which is what the limit is."""
        error = 0.0
        for number, scene in enumerate(scenes):
            bits = sensor.expose(scene, number, threads=lab.threads)
            estimate = run(bits, sensor, threads=lab.threads)
            error += float(np.mean((estimate - scene) ** 2)) / len(scenes)
        return -10 * float(np.log10(error))

    def limits(update: Update) -> Outcome:
        return Outcome(
            [
                {
                    "bits": bits,
                    "estimator": "limit",
                    "sigma": None,
                    "psnr": posterior_mean_psnr(bits),
                }
                for bits in lab.settings["bits"]
            ]
        )

    return [
        *by_bits.parts(lab, lambda: datasets.uniform_scenes, measure, (40, 110)),
        Part("limit", 1, limits),
    ]


def section(results: Results) -> Section:
    """The curves, and how far from the limit the learned network is."""
    settings = results.settings
    limits = by_bits.limits_of(results) or {}
    short = max(limit - by_bits.psnr(results, bits, "learned") for bits, limit in limits.items())
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        "Scenes of 32 × 32 with intensities uniform in [0, 1] and independent, α = K. PSNR of the "
        f"mean square error over {settings['test_scenes']:,} new scenes. “Learned” is by our "
        "recipe, Gauss-Newton, with one weight for all jots of a pixel. No estimator has a higher "
        "PSNR than the posterior mean, whose value is exact, by quadrature: the limit. For each "
        f"K the learned network ends at most {short:.3f} dB below it.",
        "jotlight reproduce fig6a",
        claims=[
            by_bits.every_gain_claim(results, "PSNR increases by learning for all K (figure 6a)."),
            _grows_with_bits(results),
            by_bits.largest_gain_claim(results, 1.7),
        ],
        tables=[by_bits.table(results), by_bits.descents(results)],
        curves=[by_bits.curves(results, "fig6a", "PSNR by bits per pixel, synthetic scenes")],
    )


def _grows_with_bits(results: Results) -> Claim:
    bits = results.settings["bits"]
    learned = [by_bits.psnr(results, k, "learned") for k in bits]
    grows = bool(np.all(np.diff(learned) > 0))
    return Claim(
        "PSNR improves naturally for large oversampling values.",
        f"The learned network goes from {learned[0]:.2f} dB at K = {bits[0]} to {learned[-1]:.2f} "
        f"dB at K = {bits[-1]}, " + ("rising with each K." if grows else "not with each K."),
        "reproduced" if grows else "not reproduced",
    )


EXPERIMENT = Experiment(
    "fig6a",
    "Figure 6a: learning on synthetic scenes",
    {**by_bits.SETTINGS, "test_scenes": 2048},
    {**by_bits.QUICK, "test_scenes": 64},
    parts,
    section,
)
