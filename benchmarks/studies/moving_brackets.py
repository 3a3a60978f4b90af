"""Compare images of moving scenes from brackets of exposures, with and without their motion.

    python benchmarks/studies/moving_brackets.py [--cycles 96]
    python benchmarks/studies/moving_brackets.py --figure docs/guide/moving_bracket.jpg

The scenes are two photographs that come with scikit-image, at 192 x 192 pixels. The exposures of a
bracket repeat in cycles. The first table shows the mean PSNR in dB, without a border of 8 pixels,
by the network "medium": of all frames without alignment, along the motion that `jotlight.align`
finds, and of the same photographs standing still, from all their bits and from the sums of cycles.
*bias* is the relative error of the mean intensity of the merged images. *film* and *network* are
images of causal films of half the frames, by "medium" and by the film network, which does not take
maps of thresholds. *photons* is the mean number per jot and frame.

In the second table, the intensities of the photographs rise by a factor of 1,000 from left to
right. It shows the root mean square error of log intensity in each quarter of the width, of images
along the motion that is found, from a bracket and from as many equal frames with as much light.
"""

import argparse
from pathlib import Path

import numpy as np
from borders import INNER, psnr_inside

import jotlight as jl
from jotlight.motion.films.estimates import FilmEstimates
from jotlight.motion.films.film import film

PHOTOGRAPHS = "camera", "coffee"
SIZE = 192, 192
METHOD = "network-medium"
KINDS = [
    # relative gains of a cycle, thresholds, photons per jot and frame, read noise
    ((1.0, 4.0), 1, 0.5, 0.0),
    ((1.0, 4.0), 1, 4.0, 0.0),
    ((1.0, 8.0, 64.0), 1, 0.5, 0.0),
    ((1.0, 8.0, 64.0), 1, 8.0, 0.0),
    ((1.0, 1.0), (1, 4), 2.0, 0.0),
    ((1.0, 1.0), 1, 0.5, 0.3),
    ((1.0, 1.0), "checkerboard 1, 4", 2.0, 0.0),
]
BOARD = np.where(np.indices(SIZE).sum(axis=0) % 2, 4, 1)
RANGE = 1000.0


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cycles", type=int, default=96)
    parser.add_argument("--figure", type=Path, help="a figure of the scene with a wide range")
    options = parser.parse_args()
    cycles = options.cycles
    if options.figure is not None:
        draw(options.figure, cycles)
        return
    names = "all frames", "merged", "bias", "still", "sums", "film", "network"
    print(f"| gains | thresholds | read noise | photons | scene | {' | '.join(names)} |")
    print("| --- | --- | ---: | ---: | --- |" + " ---: |" * len(names))
    for gains, thresholds, photons, noise in KINDS:
        sensor = bracket(gains, thresholds, noise, cycles)
        for motion in ("shake", "layers"):
            rows = [measure(sensor, motion, name, photons, len(gains)) for name in PHOTOGRAPHS]
            whole, merged, bias, still, sums, by_medium, by_network = np.mean(rows, axis=0)
            print(
                f"| {' : '.join(f'{gain:g}' for gain in gains)} | {thresholds} | {noise:g} | "
                f"{photons:g} | {motion} | {whole:.2f} | {merged:.2f} | {bias:+.1%} | "
                f"{still:.2f} | {sums:.2f} | {by_medium:.2f} | {by_network:.2f} |",
                flush=True,
            )
    print("\n| frames, scene | dark | | | bright |\n| --- | ---: | ---: | ---: | ---: |")
    for motion in ("shake", "layers"):
        for title, gains in (("1 : 8 : 64", (1.0, 8.0, 64.0)), ("equal", (1.0, 1.0, 1.0))):
            sensor = bracket(gains, 1, 0.0, cycles)
            errors = np.mean([wide_range(sensor, motion, name) for name in PHOTOGRAPHS], axis=0)
            print(f"| {title}, {motion} | {' | '.join(f'{each:.2f}' for each in errors)} |")


def bracket(gains, thresholds, noise: float, cycles: int) -> jl.Sensor:
    """Return a sensor whose exposures repeat in cycles."""
    frames = cycles * len(gains)
    return jl.Sensor(
        frames=frames,
        gain=np.tile(gains, cycles),
        threshold=BOARD if isinstance(thresholds, str) else np.resize(thresholds, frames),
        read_noise=noise,
    )


def record(image, motion: str, sensor: jl.Sensor, photons: float):
    """Return a moving scene and its bits, all in memory."""
    scene = jl.datasets.moving(image, motion, sensor=sensor, shape=SIZE, photons=photons, rng=0)
    return scene, jl.Bits(np.asarray(scene.bits.packed), SIZE[1], scene.bits.sensor)


def measure(
    sensor: jl.Sensor, motion: str, name: str, photons: float, cycle: int
) -> tuple[float, ...]:
    """Return the numbers of a row for one photograph."""
    image = jl.datasets.photograph(name, gray=True).astype(float)
    (scene, bits), (static, still) = (
        record(image, kind, sensor, photons) for kind in (motion, "static")
    )
    found = jl.align(bits)
    truth, at_rest = scene.image(found.reference), static.image()
    estimate = jl.reconstruct(jl.merge(bits, motion=found), method=METHOD)
    estimates, rows = FilmEstimates(), []
    window = len(bits) // (2 * cycle) * cycle
    for shown in film(bits, window=window, step=window // 8 // cycle * cycle, causal=True):
        known = scene.image(shown.time)
        by_medium = psnr_inside(jl.reconstruct(shown.data, method=METHOD), known)
        by_network = psnr_inside(estimates.add(shown), known) if shown.nearest else np.nan
        rows.append((by_medium, by_network))
    return (
        psnr_inside(jl.reconstruct(bits, method=METHOD), truth),
        psnr_inside(estimate, truth),
        float(estimate.mean() / truth.mean()) - 1,
        psnr_inside(jl.reconstruct(still, method=METHOD), at_rest),
        psnr_inside(jl.reconstruct(jl.merge(still), method=METHOD), at_rest),
        *np.mean(rows, axis=0),
    )


def wide_range(sensor: jl.Sensor, motion: str, name: str) -> list[float]:
    """Return the errors of log intensity in the quarters of a scene with a wide range of light."""
    scene, bits = record(widened(name), motion, sensor, 8.0)
    found = jl.align(bits)
    estimate = jl.reconstruct(jl.merge(bits, motion=found), method=METHOD)[INNER]
    truth = scene.image(found.reference)[INNER]
    errors = np.log(np.maximum(estimate, 1e-9)) - np.log(truth)
    return [float(np.sqrt(np.mean(part**2))) for part in np.array_split(errors, 4, axis=1)]


def widened(name: str) -> np.ndarray:
    """Return a photograph whose intensities rise by a factor of 1,000 from left to right."""
    image = jl.datasets.photograph(name, gray=True).astype(float)
    return (0.2 + 0.8 * image) * RANGE ** np.linspace(-1, 0, image.shape[1])


def draw(path: Path, cycles: int) -> None:
    """Write a figure of log intensities: all frames, the bracket, equal frames, and the scene."""
    from jotlight.figures import Figure

    sensor = bracket((1.0, 8.0, 64.0), 1, 0.0, cycles)
    scene, bits = record(widened("camera"), "shake", sensor, 8.0)
    equal = record(widened("camera"), "shake", bracket((1.0, 1.0, 1.0), 1, 0.0, cycles), 8.0)[1]
    motion = jl.align(bits)
    images = {
        "all frames": jl.reconstruct(bits, method=METHOD),
        "1 : 8 : 64, merged": jl.reconstruct(jl.merge(bits, motion=motion), method=METHOD),
        "equal frames, merged": jl.reconstruct(jl.merge(equal), method=METHOD),
        "scene": scene.image(motion.reference),
    }
    limits = np.log(np.quantile(images["scene"], (0.01, 0.999)))
    figure = Figure(12.0, 3.3)
    for place, (title, image) in zip(figure.subplots(1, 4), images.items(), strict=True):
        shown = np.log(np.maximum(image, 1e-9))
        place.imshow(shown, cmap="gray", vmin=limits[0], vmax=limits[1])
        place.set_title(title)
        place.set_axis_off()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
