"""Figure 6a: PSNR by K on synthetic scenes, before and after learning, and the limit."""

from collections.abc import Callable
from typing import Any

import numpy as np

from jotlight.datasets import uniform_scenes
from jotlight.datasets.fetch import Progress
from jotlight.experiments import psnr_by_bits
from jotlight.experiments.experiment import (
    Experiment,
    Part,
    PartResult,
    Results,
    RunContext,
    command_of,
)
from jotlight.experiments.posterior_mean import posterior_mean_psnr
from jotlight.experiments.psnr_by_bits import psnr_of
from jotlight.experiments.report.content import Claim, Section
from jotlight.sensing.sensor import Sensor


def parts(context: RunContext) -> list[Part]:
    """Return one part for each K, the paper's descent, and the limits."""
    scenes = uniform_scenes(
        np.random.default_rng([context.settings["seed"], 1]), context.settings["test_scenes"]
    )

    def measure(run: Callable[..., Any], sensor: Sensor) -> float:
        """Return the PSNR of the mean square error over all scenes, as the limit is defined."""
        error = 0.0
        for number, scene in enumerate(scenes):
            bits = sensor.expose(scene, number, threads=context.threads)
            estimate = run(bits, sensor, threads=context.threads)
            error += float(np.mean((estimate - scene) ** 2)) / len(scenes)
        return -10 * float(np.log10(error))

    def limits(progress: Progress) -> PartResult:
        return PartResult(
            [
                {
                    "bits": bits,
                    "estimator": "limit",
                    "sigma": None,
                    "psnr": posterior_mean_psnr(bits),
                }
                for bits in context.settings["bits"]
            ]
        )

    return [
        *psnr_by_bits.psnr_parts(context, lambda: uniform_scenes, measure, (40, 110)),
        Part("limit", 1, limits),
    ]


def section(results: Results) -> Section:
    """Return the curves, and how far the learned network is from the limit."""
    settings = results.settings
    limits = psnr_by_bits.limits_of(results) or {}
    gap = max(limit - psnr_of(results, bits, "learned") for bits, limit in limits.items())
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        "Scenes of 32 × 32 with intensities uniform in [0, 1] and independent, α = K. PSNR of the "
        f"mean square error over {settings['test_scenes']:,} new scenes. “Learned” means by the "
        "default training, Gauss-Newton, with one weight for all jots of a pixel. No estimator has "
        "a higher PSNR than the posterior mean. Quadrature computes its exact value, the limit. "
        f"For each K the learned network ends at most {gap:.3f} dB below the limit.",
        command_of(EXPERIMENT.name, settings),
        ["fig6a.csv"],
        claims=[
            psnr_by_bits.every_gain_claim(
                results, "PSNR increases by learning for all K (figure 6a)."
            ),
            _grows_with_bits(results),
            psnr_by_bits.largest_gain_claim(results, 1.7),
        ],
        tables=[psnr_by_bits.psnr_table(results), psnr_by_bits.descent_table(results)],
        curves=[
            psnr_by_bits.psnr_curves(results, "fig6a", "PSNR by trials per pixel, synthetic scenes")
        ],
    )


def _grows_with_bits(results: Results) -> Claim:
    bits = results.settings["bits"]
    learned = [psnr_of(results, k, "learned") for k in bits]
    grows = bool(np.all(np.diff(learned) > 0))
    return Claim(
        "PSNR improves naturally for large oversampling values.",
        f"The learned network goes from {learned[0]:.2f} dB at K = {bits[0]} to {learned[-1]:.2f} "
        f"dB at K = {bits[-1]}. It " + ("rises" if grows else "does not rise") + " with each K.",
        "reproduced" if grows else "not reproduced",
    )


EXPERIMENT = Experiment(
    "fig6a",
    "Figure 6a: learning on synthetic scenes",
    {**psnr_by_bits.SETTINGS, "test_scenes": 2048},
    {**psnr_by_bits.QUICK_SETTINGS, "test_scenes": 64},
    parts,
    section,
)
