"""The optimizers beside each other; the paper's own descent is in ``jotlight reproduce fig5``.

    python benchmarks/studies/optimizers.py path/to/data [curves] [recipe] [sets] [limits]

``curves``: photographs, K = 16, PSNR of 20 test images against time, some ten minutes on two cores.
``recipe``: how far the default recipe is from a run of five times as many steps.
``limits``: how near the two fast ones come to the posterior mean on synthetic scenes.
``sets``: what it costs that splines may not fall, and how negative learned filters are.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.training import Adam, GaussNewton, ProjectedGradient, Record, SafeSet

# The paper's 5e-8 for 481 x 321 pixels is this for the 50 x 50 that count in a patch of 64 x 64.
PAPERS_STEP = 3e-6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("parts", nargs="*", metavar="part", help="Default: all.")
    parser.add_argument("--figures", type=Path, default=Path())
    options = parser.parse_args()
    parts = {"curves": curves, "recipe": recipe, "sets": sets, "limits": limits}
    for name in options.parts or parts:
        parts[name](options.data, options.figures)


class Clock:
    """Seconds and test PSNR of a run; the tests take a few of these seconds."""

    def __init__(self) -> None:
        self.begun = time.perf_counter()
        self.seconds: list[float] = []
        self.psnr: list[float] = []

    def __call__(self, record: Record) -> None:
        if record.test_psnr is not None:
            self.seconds.append(time.perf_counter() - self.begun)
            self.psnr.append(record.test_psnr)


def curves(data: Path, figures: Path) -> None:
    """Every optimizer with its own number of steps."""
    _, scenes = read_image_set(data / "bsds300/train")
    _, tests = read_image_set(data / "bsds300/test", first=20)
    start = jl.Network.initial(jl.Sensor(oversampling=4))
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    print("\n| optimizer | steps | seconds | start, dB | end, dB | seconds to 24.25 dB |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name, optimizer in {
        "Gauss-Newton": GaussNewton(),
        "projected Adam": Adam(),
        "projected gradient, the paper's step": ProjectedGradient(PAPERS_STEP),
    }.items():
        clock = Clock()
        jl.train(start, scenes, optimizer=optimizer, rng=0, test=tests, callback=clock)
        there = [s for s, psnr in zip(clock.seconds, clock.psnr, strict=True) if psnr >= 24.25]
        first = f"{there[0]:.1f}" if there else "not reached"
        print(
            f"| {name} | {optimizer.steps} | {clock.seconds[-1]:.0f} | {clock.psnr[0]:.2f} "
            f"| {clock.psnr[-1]:.2f} | {first} |",
            flush=True,
        )
        axes.plot(clock.seconds, clock.psnr, label=name)
    axes.set_xscale("log")
    axes.set_xlabel("seconds, two cores")
    axes.set_ylabel("PSNR of 20 test images, dB")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    figure.savefig(figures / "optimizers.png", dpi=100)


def recipe(data: Path, _: Path) -> None:
    """The default number of steps and five times as many."""
    _, scenes = read_image_set(data / "bsds300/train")
    _, tests = read_image_set(data / "bsds300/test", first=20)
    sensor = jl.Sensor(oversampling=4)
    print("\n| steps | seconds | first 20 test images, dB |\n| ---: | ---: | ---: |")
    for steps in (GaussNewton.steps, 5 * GaussNewton.steps):
        begun = time.perf_counter()
        learned, _ = jl.train(jl.Network.initial(sensor), scenes, steps=steps, rng=0)
        seconds = time.perf_counter() - begun
        psnr = np.mean(jl.evaluate(learned, tests, sensor).values("psnr"))
        print(f"| {steps} | {seconds:.0f} | {psnr:.3f} |", flush=True)


def sets(data: Path, _: Path) -> None:
    """The default set with and without its last condition."""
    _, scenes = read_image_set(data / "bsds300/train")
    _, tests = read_image_set(data / "bsds300/test", first=20)
    sensor = jl.Sensor(oversampling=4)
    print(
        "\n| splines may not fall | first 20 test images, dB | largest fall of a spline "
        "| sum of negative taps |"
    )
    print("| --- | ---: | ---: | ---: |")
    for monotone in (True, False):
        learned, _ = jl.train(
            jl.Network.initial(sensor), scenes, admissible=SafeSet(monotone=monotone), rng=0
        )
        psnr = jl.evaluate(learned, tests, sensor).mean("psnr")
        falls = [fall_of(layer.coefficients[0]) for layer in learned.layers]
        negative = np.minimum(learned.layers[1].filters, 0).sum()
        shown = " and ".join(f"{fall:.2f}" for fall in falls)
        print(f"| {monotone} | {psnr:.3f} | {shown} | {negative:.4f} |", flush=True)


def limits(_: Path, __: Path) -> None:
    """Synthetic scenes: PSNR of the mean square error below that of the posterior mean."""
    scenes = jl.datasets.uniform_scenes(np.random.default_rng(99), 2048)
    print("\n| K | optimizer | seconds | from the limit, dB |\n| ---: | --- | ---: | ---: |")
    for side, limit in ((3, 14.816), (10, 22.636)):
        start = jl.Network.initial(jl.Sensor(oversampling=side))
        for name in ("adam", "gauss-newton"):
            begun = time.perf_counter()
            learned, _ = jl.train(start, jl.datasets.uniform_scenes, optimizer=name, rng=0)
            seconds = time.perf_counter() - begun
            errors = [
                np.mean((learned.reconstruct(start.sensor.expose(scene, rng=index)) - scene) ** 2)
                for index, scene in enumerate(scenes)
            ]
            psnr = -10 * np.log10(np.mean(errors))
            print(f"| {side**2} | {name} | {seconds:.0f} | {psnr - limit:+.3f} |", flush=True)


def fall_of(coefficients: np.ndarray) -> float:
    """How far a spline's coefficients fall below one that came before, at most."""
    return float(np.max(np.maximum.accumulate(coefficients) - coefficients))


if __name__ == "__main__":
    main()
