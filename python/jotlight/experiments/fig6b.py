"""Figure 6b: PSNR by K on CIFAR-10 in grey, before and after learning."""

from collections.abc import Callable
from typing import Any

import jotlight as jl
from jotlight.experiments import by_bits
from jotlight.experiments.experiment import Experiment, Lab, Part, Results
from jotlight.experiments.report.section import Claim, Section


def parts(lab: Lab) -> list[Part]:
    """One for each K, and the paper's descent."""

    def measure(run: Callable[..., Any], sensor: jl.Sensor) -> float:
        tests = lab.data.small_images("test", lab.settings["test_images"])
        return jl.evaluate(run, tests, sensor, threads=lab.threads).mean("psnr")

    return by_bits.parts(lab, lambda: lab.data.small_images("train"), measure, (25, 110))


def section(results: Results) -> Section:
    """The curves and the gains."""
    settings = results.settings
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        "CIFAR-10 in grey, grey levels over 255 as intensities (the paper's “normalized "
        "intensity”, as we read it), α = K. Data: "
        f"{settings['data']['cifar10']}; a copy of the data may hold lossy images too, which are "
        "left out. “Learned” is by our recipe, Gauss-Newton, with one weight for all jots of a "
        f"pixel; mean PSNR over the first {settings['test_images']:,} test images.",
        "jotlight reproduce fig6b",
        claims=[
            by_bits.every_gain_claim(results, "PSNR increases by learning for all K (figure 6b)."),
            _more_than_synthetic(results),
            by_bits.largest_gain_claim(results, 3.2),
        ],
        tables=[by_bits.table(results), by_bits.descents(results)],
        curves=[by_bits.curves(results, "fig6b", "PSNR by bits per pixel, CIFAR-10 in grey")],
    )


def _more_than_synthetic(results: Results) -> Claim:
    said = "The improvement is more prominent than on the synthetic scenes."
    if "fig6a" not in results.others:
        return Claim(said, "fig6a was not run.", "not tested")
    sigmas = results.settings["sigmas"]
    pairs = {
        sigma: tuple(by_bits.gains(which, sigma)[9] for which in (results, results.others["fig6a"]))
        for sigma in sigmas
    }
    more = [sigma for sigma, (ours, synthetic) in pairs.items() if ours > synthetic]
    words = ", ".join(f"{a:.2f} against {b:.2f} dB over σ = {s}" for s, (a, b) in pairs.items())
    return Claim(said, f"For K = 9: {words}.", *by_bits.verdict_of(more, sigmas))


EXPERIMENT = Experiment(
    "fig6b",
    "Figure 6b: learning on CIFAR-10",
    {**by_bits.SETTINGS, "test_images": 1000},
    {**by_bits.QUICK, "test_images": 32},
    parts,
    section,
    needs=("cifar10",),
)
