"""Figure 6b: PSNR by K on CIFAR-10 in gray, before and after learning."""

from collections.abc import Callable
from typing import Any

from jotlight.evaluation.evaluate import evaluate
from jotlight.experiments import psnr_by_bits
from jotlight.experiments.experiment import Experiment, Part, Results, RunContext, command_of
from jotlight.experiments.report.content import Claim, Section
from jotlight.sensing.sensor import Sensor


def parts(context: RunContext) -> list[Part]:
    """Return one part for each K, and the paper's descent."""

    def measure(run: Callable[..., Any], sensor: Sensor) -> float:
        tests = context.data.cifar10("test", context.settings["test_images"])
        return evaluate(run, tests, sensor, threads=context.threads).mean("psnr")

    return psnr_by_bits.psnr_parts(
        context, lambda: context.data.cifar10("train"), measure, (25, 110)
    )


def section(results: Results) -> Section:
    """Return the curves and the gains."""
    settings = results.settings
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        "CIFAR-10 in gray, α = K. Intensities are gray levels over 255, which is how we read the "
        f"paper's “normalized intensity”. Data: {settings['data']['cifar10']}, without the lossy "
        "images that some copies hold. “Learned” means by the default training, "
        "Gauss-Newton, with one weight for all jots of a pixel. Values are mean PSNR over the "
        f"first {settings['test_images']:,} test images.",
        command_of(EXPERIMENT.name, settings),
        ["fig6b.csv"],
        claims=[
            psnr_by_bits.every_gain_claim(
                results, "PSNR increases by learning for all K (figure 6b)."
            ),
            _more_than_synthetic(results),
            psnr_by_bits.largest_gain_claim(results, 3.2),
        ],
        tables=[psnr_by_bits.psnr_table(results), psnr_by_bits.descent_table(results)],
        curves=[
            psnr_by_bits.psnr_curves(results, "fig6b", "PSNR by trials per pixel, CIFAR-10 in gray")
        ],
    )


def _more_than_synthetic(results: Results) -> Claim:
    statement = "The improvement is more prominent than on the synthetic scenes."
    if "fig6a" not in results.others:
        return Claim(statement, "fig6a was not run.", "not tested")
    sigmas = results.settings["sigmas"]
    synthetic = results.others["fig6a"]
    pairs = {
        sigma: tuple(psnr_by_bits.gains(each, sigma)[9] for each in (results, synthetic))
        for sigma in sigmas
    }
    larger = [sigma for sigma, (cifar, uniform) in pairs.items() if cifar > uniform]
    found = ", ".join(f"{a:.2f} against {b:.2f} dB over σ = {s}" for s, (a, b) in pairs.items())
    return Claim(statement, f"For K = 9: {found}.", *psnr_by_bits.verdict_of(larger, sigmas))


EXPERIMENT = Experiment(
    "fig6b",
    "Figure 6b: learning on CIFAR-10",
    {**psnr_by_bits.SETTINGS, "test_images": 1000},
    {**psnr_by_bits.QUICK_SETTINGS, "test_images": 32},
    parts,
    section,
    datasets=("cifar10",),
)
