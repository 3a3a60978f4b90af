"""Measure quality, distance from the optimum, and speed of the iterative estimators.

    python benchmarks/studies/iterative_estimators.py path/to/data [cubic] [lbfgs] [small] [speed]

The folder holds ``bsds300/test/*.jpg``. Without names, all parts run.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import jotlight as jl
import jotlight._engine as engine
from jotlight.estimators.iterative.problem_building import build_problem
from jotlight.images.io import read_image


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []])
    options = parser.parse_args()
    if engine.DEBUG_BUILD:
        parser.error("this is a debug build of the engine: measure a release build")
    paths = sorted((options.data / "bsds300/test").glob("*.jpg"))[:20]
    if not paths:
        parser.error(f"{options.data}: expected bsds300/test/*.jpg")
    images = [read_image(path, gray=True) for path in paths]
    for name in options.parts or PARTS:
        PARTS[name](images)


def cubic(images: list[np.ndarray]) -> None:
    """Measure intensities and light on the jots for a cubic kernel, K̂ = 4."""
    names = "mle, dB", "mle-iterative, dB", "admm-tv, dB"
    columns = [*names, *(f"light: {name}" for name in names)]
    print(f"\n| frames | {' | '.join(columns)} |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for frames in (4, 64, 1024):
        sensor = jl.Sensor(oversampling=4, frames=frames, kernel="cubic")
        box = sensor.replace(kernel="box")
        rows = []
        for seed, image in enumerate(images[:5]):
            image = image[96:224, 96:224]
            bits = sensor.expose(image, rng=seed)
            box_estimate = jl.mle(bits, box)
            estimates = [jl.mle_iterative(bits, sensor), jl.admm_tv(bits, sensor)]
            # In units of intensity: a uniform image of intensity 1 puts 1 on each jot.
            scale = sensor.trials / sensor.gain
            light = [scale * sensor.rate(estimate) for estimate in estimates]
            light.insert(0, np.kron(box_estimate, np.ones((4, 4), np.float32)))
            truth = scale * sensor.rate(image)
            rows.append(
                [jl.metrics.psnr(estimate, image) for estimate in (box_estimate, *estimates)]
                + [jl.metrics.psnr(one, truth) for one in light]
            )
        print(f"| {frames} | " + " | ".join(f"{x:.2f}" for x in np.mean(rows, axis=0)) + " |")


def lbfgs(images: list[np.ndarray]) -> None:
    """Compare with SciPy's L-BFGS-B, which gets the same gradient: 64 x 64 pixels, cubic, K̂ = 4."""
    print("\n| frames | Newton, s | L-BFGS-B, s | ratio | relative difference of the objective |")
    print("| ---: | ---: | ---: | ---: | ---: |")
    for frames in (1, 4, 16):
        sensor = jl.Sensor(oversampling=4, frames=frames, kernel="cubic")
        rows = []
        for seed, image in enumerate(images[:5]):
            bits = sensor.expose(image[100:164, 100:164], rng=seed)
            start = time.perf_counter()
            _, history = jl.mle_iterative(bits, sensor, return_history=True)
            newton = time.perf_counter() - start
            start = time.perf_counter()
            lbfgs_objective = minimize_by_lbfgs(bits, sensor)
            lbfgs_seconds = time.perf_counter() - start
            difference = (history.objective - lbfgs_objective) / abs(lbfgs_objective)
            rows.append((newton, lbfgs_seconds, lbfgs_seconds / newton, abs(difference)))
        newton, lbfgs_seconds, ratio, _ = np.median(rows, axis=0)
        worst = max(row[3] for row in rows)
        print(
            f"| {frames} | {newton:.2f} | {lbfgs_seconds:.2f} | {ratio:.1f} | {worst:.1e} |",
            flush=True,
        )


def minimize_by_lbfgs(bits: jl.Bits, sensor: jl.Sensor) -> float:
    problem = build_problem(bits, sensor, None)
    shape = problem.operator.input_shape

    def cost(flat: np.ndarray) -> tuple[float, np.ndarray]:
        # Without this lower bound a trial step to no light would have infinite cost.
        light = np.maximum(problem.operator.forward(flat.reshape(shape)), 1e-12)
        gradient, _ = problem.likelihood.gradient_and_curvature(light)
        return -problem.likelihood.value(light), -problem.operator.adjoint(gradient).ravel()

    found = minimize(
        cost,
        np.full(np.prod(shape), problem.constant_estimates()[0]),
        jac=True,
        method="L-BFGS-B",
        bounds=[(0, sensor.max_intensity)] * int(np.prod(shape)),
        options={"maxiter": 10_000, "maxfun": 50_000, "ftol": 1e-13, "gtol": 1e-6},
    )
    return float(found.fun)


def small(images: list[np.ndarray]) -> None:
    """Measure how far above the minimum `admm_tv` ends on 16 x 16 pixels."""
    sensors = (
        jl.Sensor(oversampling=4),
        jl.Sensor(oversampling=2),
        jl.Sensor(frames=64),
        jl.Sensor(frames=30, threshold=2, gain=60.0),
        jl.Sensor(frames=20, dark_counts=0.1, gain=5.0),
    )
    print("\n| tol | iterations | relative excess: median | worst |")
    print("| ---: | ---: | ---: | ---: |")
    for tol in (1e-3, 3e-4, 1e-4):
        iterations, excess = [], []
        for seed, image in enumerate(images):
            for sensor in sensors:
                bits = sensor.expose(image[150:166, 150:166], rng=seed)
                _, history = jl.admm_tv(bits, sensor, tol=tol, return_history=True)
                _, exact = jl.admm_tv(
                    bits,
                    sensor,
                    tol=1e-7,
                    max_iter=5000,
                    weight=history.weight,
                    return_history=True,
                )
                iterations.append(history.iterations)
                excess.append((history.objective - exact.objective) / abs(exact.objective))
        print(
            f"| {tol:g} | {np.mean(iterations):.0f} | {np.median(excess):.1e} | "
            f"{np.max(excess):.1e} |",
            flush=True,
        )


def speed(images: list[np.ndarray]) -> None:
    """Measure the time for 481 x 321 pixels, K = 16, two threads."""
    sensor = jl.Sensor(oversampling=4)
    bits = [sensor.expose(image, rng=seed) for seed, image in enumerate(images)]
    jl.admm_tv(bits[0], sensor, threads=2)
    print("\n| method | median, s | slowest image, s | iterations |")
    print("| --- | ---: | ---: | ---: |")
    seconds: dict[str, list[float]] = {"admm-tv": [], "noniterative-tv": []}
    iterations = []
    for one in bits:
        start = time.perf_counter()
        _, history = jl.admm_tv(one, sensor, threads=2, return_history=True)
        middle = time.perf_counter()
        jl.noniterative(one, sensor, denoiser="tv", threads=2)
        seconds["admm-tv"].append(middle - start)
        seconds["noniterative-tv"].append(time.perf_counter() - middle)
        iterations.append(history.iterations)
    for name, times in seconds.items():
        span = f"{min(iterations)} to {max(iterations)}" if name == "admm-tv" else ""
        print(f"| {name} | {np.median(times):.2f} | {np.max(times):.2f} | {span} |")


PARTS = {"cubic": cubic, "lbfgs": lbfgs, "small": small, "speed": speed}

if __name__ == "__main__":
    main()
