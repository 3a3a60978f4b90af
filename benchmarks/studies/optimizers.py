"""Compare the optimizers. The paper's own descent is in ``jotlight reproduce fig5``.

    python benchmarks/studies/optimizers.py path/to/data [curves] [recipe] [sets] [limits]

``curves``: PSNR of 20 test images against time, K = 16, about ten minutes on two cores.
``recipe``: how far the default training is from a run of five times as many steps.
``limits``: how close the two fast optimizers come to the posterior mean on synthetic scenes.
``sets``: what monotone splines cost, and how negative trained filters are.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.training import Adam, GaussNewton, ProjectedGradient, Record, SafeSet

PAPER_LEARNING_RATE = 3e-6
"""The paper's 5e-8 for 481 x 321 pixels, scaled to the 50 x 50 central pixels of a patch."""


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
    """Seconds and test PSNR of a run. The tests take a few of these seconds."""

    def __init__(self) -> None:
        self.start_time = time.perf_counter()
        self.seconds: list[float] = []
        self.psnr: list[float] = []

    def __call__(self, record: Record) -> None:
        if record.test_psnr is not None:
            self.seconds.append(time.perf_counter() - self.start_time)
            self.psnr.append(record.test_psnr)


def curves(data: Path, figures: Path) -> None:
    """Run every optimizer with its own number of steps."""
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
        "projected gradient, the paper's step": ProjectedGradient(PAPER_LEARNING_RATE),
    }.items():
        clock = Clock()
        jl.train(start, scenes, optimizer=optimizer, rng=0, test=tests, callback=clock)
        reached = [s for s, psnr in zip(clock.seconds, clock.psnr, strict=True) if psnr >= 24.25]
        first = f"{reached[0]:.1f}" if reached else "not reached"
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
    """Train with the default number of steps and with five times as many."""
    _, scenes = read_image_set(data / "bsds300/train")
    _, tests = read_image_set(data / "bsds300/test", first=20)
    sensor = jl.Sensor(oversampling=4)
    print("\n| steps | seconds | first 20 test images, dB |\n| ---: | ---: | ---: |")
    for steps in (GaussNewton.steps, 5 * GaussNewton.steps):
        start_time = time.perf_counter()
        learned, _ = jl.train(jl.Network.initial(sensor), scenes, steps=steps, rng=0)
        seconds = time.perf_counter() - start_time
        psnr = np.mean(jl.evaluate(learned, tests, sensor).values("psnr"))
        print(f"| {steps} | {seconds:.0f} | {psnr:.3f} |", flush=True)


def sets(data: Path, _: Path) -> None:
    """Train with and without the condition that splines are monotone."""
    _, scenes = read_image_set(data / "bsds300/train")
    _, tests = read_image_set(data / "bsds300/test", first=20)
    sensor = jl.Sensor(oversampling=4)
    print(
        "\n| monotone splines | first 20 test images, dB | largest fall of a spline "
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
    """Measure how far below the posterior mean the PSNR on synthetic scenes is."""
    scenes = jl.datasets.uniform_scenes(np.random.default_rng(99), 2048)
    print("\n| K | optimizer | seconds | from the limit, dB |\n| ---: | --- | ---: | ---: |")
    for side, limit in ((3, 14.816), (10, 22.636)):
        start = jl.Network.initial(jl.Sensor(oversampling=side))
        for name in ("adam", "gauss-newton"):
            start_time = time.perf_counter()
            learned, _ = jl.train(start, jl.datasets.uniform_scenes, optimizer=name, rng=0)
            seconds = time.perf_counter() - start_time
            errors = [
                np.mean((learned.reconstruct(start.sensor.expose(scene, rng=index)) - scene) ** 2)
                for index, scene in enumerate(scenes)
            ]
            psnr = -10 * np.log10(np.mean(errors))
            print(f"| {side**2} | {name} | {seconds:.0f} | {psnr - limit:+.3f} |", flush=True)


def fall_of(coefficients: np.ndarray) -> float:
    """Return how far a spline's coefficients fall below an earlier one, at most."""
    return float(np.max(np.maximum.accumulate(coefficients) - coefficients))


if __name__ == "__main__":
    main()
