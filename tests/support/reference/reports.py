"""A report like those of the experiments, with real drawings, photographs, and long tables."""

import io

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image

from jotlight.experiments.report.content import (
    Claim,
    Column,
    Curves,
    Report,
    Scene,
    SceneImage,
    Section,
    Table,
)

INK, QUIET = "#1d2733", "#5b6876"


def realistic_report() -> Report:
    from skimage import data

    rng = np.random.default_rng(0)
    camera, portrait = data.camera(), data.astronaut()
    return Report(
        "Images from 1-bit measurements: the paper's experiments, run again",
        "Every experiment of the paper, repeated with this package on the paper's data where they "
        "are available. Each section describes an experiment, its command, and its results. The "
        "table below compares the results with the paper's claims.",
        [
            ("jotlight", "0.2.0, commit 1a2b3c4"),
            ("Processor", "2 cores, AMD EPYC 7763"),
            ("Data", "BSDS300, 100 test images of 481 × 321 pixels; five captures"),
            ("Time", "41 minutes in all"),
            ("Libraries", "Python 3.11.4, NumPy 2.4.6, SciPy 1.17.1, scikit-image 0.26.0"),
        ],
        [
            oversampling_section(camera, rng),
            robustness_section(portrait, rng),
            captures_section(),
        ],
    )


def oversampling_section(camera: np.ndarray, rng: np.random.Generator) -> Section:
    return Section(
        "oversampling",
        "Quality and time against the number of trials per pixel",
        "100 images of the BSDS300 test set, each exposed once at K = 9, 16, …, 100 bits "
        "per pixel. Every method gets the same bits; times are medians of five runs.",
        "jotlight experiments oversampling --data shared/data --images 100",
        claims=[
            Claim(
                "The network reaches 28.9 dB at K = 16, 0.4 dB above total variation.",
                "28.71 dB, 0.35 dB above total variation",
                "reproduced",
            ),
            Claim(
                "Reconstruction takes 4.1 s for an image.",
                "12 ms",
                "better",
                "Compiled code on two cores instead of MATLAB on one.",
            ),
        ],
        tables=[
            Table(
                "Mean over 100 images, K = 16",
                [
                    Column("Method"),
                    Column("PSNR, dB", ".2f", "highest"),
                    Column("SSIM", ".3f", "highest"),
                    Column("Time, ms", ".1f", "lowest"),
                    Column("Steps"),
                    Column("Source"),
                ],
                [
                    ["maximum likelihood", 21.337, 0.4181, 0.84, None, "paper, (7)"],
                    ["non-iterative, Gaussian", 27.914, 0.7702, 4.2, None, "paper, (12)"],
                    ["non-iterative, total variation", 28.36, 0.81, 212.0, 100, None],
                    ["ADMM, total variation", 28.902, 0.8264, 655.31, 214, "Chan 2014"],
                    ["network", 28.71, 0.803, 11.9, None, "paper, (21)"],
                ],
                note="Bold is the best value of a column. A dash means no value.",
            ),
            hundred_images(rng),
        ],
        curves=[
            Curves("psnr-k", "PSNR against trials per pixel", drawing(), "Shaded: quartiles"),
            Curves("time-k", "Time against trials per pixel", drawing(logarithmic=True)),
        ],
        scenes=[
            noisy_scene("Cameraman, 256 × 256, K = 16", camera[::2, ::2], rng),
        ],
    )


def robustness_section(portrait: np.ndarray, rng: np.random.Generator) -> Section:
    return Section(
        "robustness",
        "Robustness to a wrong gain",
        "The assumed gain of the sensor is wrong by up to a factor of two.",
        "jotlight experiments robustness",
        claims=[
            Claim(
                "A network trained for one gain loses less than 1 dB at half of it.",
                "It loses 2.3 dB.",
                "not reproduced",
                "The paper does not say how its test images were scaled; with images "
                "scaled to the full range the loss is as here.",
            ),
            Claim(
                "With BM3D the loss is the same.",
                "–",
                "not tested",
                "BM3D is for non-commercial use only.",
            ),
        ],
        curves=[Curves("gain", "PSNR against the gain", drawing(width=9.5))],
        scenes=[
            noisy_scene("Portrait, in color", portrait[:480:2, 60:380:2], rng),
            noisy_scene("Landscape, in color", portrait[20:260:2, 40:500:2], rng),
        ],
    )


def captures_section() -> Section:
    return Section(
        "captures",
        "Real captures of a SPAD camera",
        "Five captures with no truth to compare with.",
        "jotlight experiments captures --frames 30 --data /a/long/path/to/the/captures/of/"
        "the/camera --output /another/long/path/report",
        tables=[Table("Captures", [Column("Name"), Column("Frames")], [["street", 30]])],
    )


def hundred_images(rng: np.random.Generator) -> Table:
    return Table(
        "PSNR of every image, dB",
        [
            Column("Image"),
            *[
                Column(name, ".2f", "highest")
                for name in ("MLE", "TV", "ADMM", "Network", "Another")
            ],
        ],
        [
            [f"image {number}", *rng.normal(27, 2, 4), float(number % 7) if number % 3 else None]
            for number in range(1, 101)
        ],
    )


def drawing(*, logarithmic: bool = False, width: float = 6.4) -> str:
    """Return curves as the experiments draw them, with text, a clipped area, and markers."""
    with rc_context({"svg.fonttype": "none"}):
        figure = Figure(figsize=(width, 4), layout="constrained")
        figure.patch.set_alpha(0)
        axes = figure.subplots()
        axes.patch.set_alpha(0)
        bits = np.array([9, 16, 25, 36, 49, 64, 81, 100])
        for index, name in enumerate(("maximum likelihood", "total variation", "network")):
            level = bits ** (1.0 + index / 3) if logarithmic else 18 + index * 3 + np.log(bits)
            axes.plot(bits, level, marker="o", label=name, color=f"C{index}")
            axes.fill_between(bits, level * 0.97, level * 1.03, alpha=0.2, color=f"C{index}")
        if logarithmic:
            axes.set_yscale("log")
            axes.set_xscale("log")
        axes.set_xlabel("trials per pixel, K", color=INK)
        axes.set_ylabel("ms" if logarithmic else "dB", color=INK)
        axes.grid(color=QUIET, alpha=0.25)
        axes.tick_params(which="both", color=QUIET, labelcolor=INK)
        axes.spines[:].set_color(QUIET)
        axes.legend(frameon=False, labelcolor=INK)
        file = io.StringIO()
        figure.savefig(file, format="svg")
        return file.getvalue()


def noisy_scene(title: str, photograph: np.ndarray, rng: np.random.Generator) -> Scene:
    """Return a photograph, its bits at a finer scale, and two noisy images."""
    height, width = photograph.shape[:2]
    finer = np.kron(photograph, np.ones((4, 4) + (1,) * (photograph.ndim - 2), np.uint8))
    bits = (rng.random(finer.shape) < finer / 255).astype(np.uint8) * 255
    noisy = [
        np.clip(photograph + rng.normal(0, sigma, photograph.shape), 0, 255).astype(np.uint8)
        for sigma in (40, 12)
    ]
    return Scene(
        title,
        (height, width),
        (height // 8, width // 3, height // 5, width // 4),
        [
            SceneImage("truth", "the photograph itself", encoded(photograph)),
            SceneImage("bits", "4 × 4 jots per pixel", encoded(bits)),
            SceneImage("maximum likelihood", "21.34 dB, SSIM 0.418", encoded(noisy[0], "JPEG")),
            SceneImage("network", "28.71 dB, SSIM 0.803", encoded(noisy[1], "WEBP")),
        ],
    )


def encoded(image: np.ndarray, kind: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(image).save(file, format=kind)
    return file.getvalue()
