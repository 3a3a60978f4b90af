"""Figure 7: Berkeley images at K = 16, by every method: bits, pictures, PSNR, SNR and SSIM."""

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight import plots
from jotlight.evaluation.methods import DEEP_NETWORKS, METHODS
from jotlight.experiments.by_bits import TOLERANCE
from jotlight.experiments.experiment import (
    Experiment,
    Image,
    Lab,
    Outcome,
    Part,
    Results,
    Row,
    Update,
)
from jotlight.experiments.learning import learn, sensor_of
from jotlight.experiments.names import ALGEBRAIC, title
from jotlight.experiments.report.section import (
    Claim,
    Column,
    Picture,
    Scene,
    Section,
    Table,
    Verdict,
)

NETWORK = "network.safetensors"

SETTINGS = {
    "bits": 16,
    "images": 100,
    "side": None,
    "shown": ["101085", "126007", "302008", "86000"],
    "learning_images": 200,
    "learning_steps": None,
    "learning_batch": None,
    "seed": 0,
}

MEASURES = ("psnr", "snr", "ssim")


def parts(lab: Lab) -> list[Part]:
    """The learning, then one for each image."""
    sensor = sensor_of(lab.settings["bits"])
    names, images = lab.data.photographs("test", lab.settings["images"])
    path = lab.folder / NETWORK
    # Other copies of the data may have other names.
    shown = [name for name in lab.settings["shown"] if name in names] or names[:4]

    def train(update: Update) -> Outcome:
        _, scenes = lab.data.photographs("train", lab.settings["learning_images"])
        learned, _ = learn(lab, "network", sensor, scenes, update)
        learned.history["trained on"] = "BSDS300 train, grey"
        learned.save(path)
        return Outcome([])

    def one_image(number: int, name: str, image: Image) -> Callable[[Update], Outcome]:
        def run(update: Update) -> Outcome:
            network = jl.Network.load(path)
            bits = sensor.expose(image, number, threads=lab.threads)
            estimates = {}
            runs = methods(network)
            for done, (method, reconstruct) in enumerate(runs.items()):
                update(done / len(runs))
                estimates[method] = reconstruct(bits, sensor, threads=lab.threads)
            rows = [_row(name, method, estimate, image) for method, estimate in estimates.items()]
            if name not in shown:
                return Outcome(rows)
            jots = bits[:1].to_array()[0]
            files = {"photograph": encoded(image), "bits": encoded(jots)}
            files |= {method: encoded(estimate) for method, estimate in estimates.items()}
            return Outcome(rows, {f"{name}-{which}.png": file for which, file in files.items()})

        return run

    return [
        Part("learning", 30, train),
        *(
            Part(f"image-{name}", 7, one_image(number, name, part_of(image, lab.settings["side"])))
            for number, (name, image) in enumerate(zip(names, images, strict=True))
        ),
    ]


def methods(network: jl.Network) -> dict[str, Callable[..., Image]]:
    """Every method that is installed, with this network as the learned one.

    BM3D is run once for both of its inverses.
    """
    runs = {
        name: method.run
        for name, method in METHODS.items()
        if method.available and name not in ("mle-iterative", "network-two-layer", *DEEP_NETWORKS)
    }
    if "noniterative-bm3d" in runs:
        kept: list[Image] = []

        def denoise(z: Image) -> Image:
            kept[:] = [jl.denoise.bm3d(z)]
            return kept[0]

        def exact(bits: jl.Bits, sensor: jl.Sensor, **options: Any) -> Image:
            return jl.noniterative(bits, sensor, denoiser=denoise, **options)

        def algebraic(bits: jl.Bits, sensor: jl.Sensor, **options: Any) -> Image:
            return jl.noniterative(
                bits, sensor, denoiser=lambda _: kept[0], inverse="algebraic", **options
            )

        runs["noniterative-bm3d"] = exact
        runs[ALGEBRAIC] = algebraic
    runs["network-two-layer"] = network.reconstruct
    return runs


def part_of(image: Image, side: int | None) -> Image:
    """The middle of an image, so many pixels in square; all of it without a side."""
    if side is None:
        return image
    top, left = ((length - side) // 2 for length in image.shape)
    return np.ascontiguousarray(image[top : top + side, left : left + side])


def encoded(picture: npt.NDArray[Any]) -> bytes:
    """A picture of 8 bits, or of one, as PNG."""
    from PIL import Image as Pillow

    levels = picture if picture.dtype == bool else np.rint(np.clip(picture, 0, 1) * 255)
    levels = levels if levels.dtype == bool else levels.astype(np.uint8)
    file = io.BytesIO()
    Pillow.fromarray(levels).save(file, "png", optimize=True)
    return file.getvalue()


def decoded(file: bytes, name: str) -> npt.NDArray[np.float32]:
    """Undo :func:`encoded`; `name` is for the message where it is damaged."""
    from PIL import Image as Pillow

    try:
        with Pillow.open(io.BytesIO(file)) as picture:
            levels = np.asarray(picture)
    except OSError as error:
        raise ValueError(f"{name}: damaged; forget these results with --restart") from error
    return levels.astype(np.float32) / np.float32(1 if levels.dtype == bool else 255)


def section(results: Results) -> Section:
    """Pictures, means over all images, and each image's own figures."""
    settings = results.settings
    names, found = results.distinct("image"), results.distinct("method")
    means = {method: _means(results, method) for method in found}
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"The first {len(names)} test images of BSDS300 in grey, K = α = {settings['bits']}, one "
        f"frame. Data: {settings['data']['bsds300']}. The learned network is learned in this run "
        "from patches of the training images, by our recipe, Gauss-Newton, with one weight for all "
        "jots of a pixel (the paper descends on whole images, with μ = 5·10⁻⁸); the initial one "
        "has σ = 0.7. PSNR, SNR and SSIM of each image, and their means.",
        "jotlight reproduce fig7",
        claims=_claims(means),
        tables=[
            *(
                Table(
                    f"Means over {'all' if first == len(names) else 'the first'} {first} images",
                    [Column("method"), *_measure_columns()],
                    [[title(method), *_means(results, method, first)] for method in found],
                )
                for first in sorted({len(names), min(20, len(names))}, reverse=True)
            ),
            *(_by_image(results, measure) for measure in MEASURES),
        ],
        scenes=[] if results.files is None else _scenes(results),
        picture="fig7.jpg",
    )


def _claims(means: dict[str, list[float]]) -> list[Claim]:
    said = (
        "The learned network (MMSE) yields results comparable with the non-iterative method with "
        "BM3D (figure 7, K = 16).",
        "It better preserves the scene's structure than the non-iterative method with BM3D, by "
        "SSIM.",
    )
    if ALGEBRAIC not in means:
        return [Claim(words, "BM3D was not installed.", "not tested") for words in said]
    ours, theirs, exact = means["network-two-layer"], means[ALGEBRAIC], means["noniterative-bm3d"]
    psnr, ssim = ours[0] - theirs[0], ours[2] - theirs[2]
    comparable: Verdict = "reproduced" if abs(psnr) <= TOLERANCE else "not reproduced"
    if psnr > TOLERANCE:
        comparable = "better"
    return [
        Claim(
            said[0],
            f"Mean PSNR {ours[0]:.2f} dB, {abs(psnr):.2f} dB {'above' if psnr > 0 else 'below'} "
            f"BM3D with the algebraic inverse ({theirs[0]:.2f} dB; with the exact one "
            f"{exact[0]:.2f}); maximum likelihood has {means['mle'][0]:.2f} dB. Comparable would "
            f"be within {TOLERANCE} dB.",
            comparable,
            "A linear filter between two curves cannot follow edges. The paper does not give the "
            "strength of its BM3D; here it has the noise level that the transform settles."
            if comparable == "not reproduced"
            else "",
        ),
        Claim(
            said[1],
            f"Mean SSIM {ours[2]:.3f} against {theirs[2]:.3f}; maximum likelihood has "
            f"{means['mle'][2]:.3f}.",
            "reproduced" if ssim > 0 else "not reproduced",
            "" if ssim > 0 else "As above.",
        ),
    ]


def _means(results: Results, method: str, first: int | None = None) -> list[float]:
    return [float(results.numbers(m, method=method)[:first].mean()) for m in MEASURES]


def _measure_columns() -> list[Column]:
    return [
        Column("PSNR, dB", 2, "highest"),
        Column("SNR, dB", 2, "highest"),
        Column("SSIM", 3, "highest"),
    ]


def _by_image(results: Results, measure: str) -> Table:
    found = results.distinct("method")
    columns = {method: results.numbers(measure, method=method) for method in found}
    digits = 3 if measure == "ssim" else 2
    return Table(
        f"{measure.upper()}{'' if measure == 'ssim' else ', dB'}, of each image",
        [Column("image"), *(Column(title(method), digits) for method in found)],
        [
            [str(name), *(float(columns[method][row]) for method in found)]
            for row, name in enumerate(results.distinct("image"))
        ],
    )


def _scenes(results: Results) -> list[Scene]:
    assert results.files is not None
    scenes = []
    for name in results.distinct("image"):
        photograph = results.files / f"{name}-photograph.png"
        if not photograph.exists():
            continue
        truth = decoded(photograph.read_bytes(), str(photograph))
        height, width = truth.shape
        pictures = [
            Picture("photograph", f"{width} × {height} pixels", photograph.read_bytes()),
            Picture(
                "bits",
                f"{results.settings['bits']} per pixel",
                (results.files / f"{name}-bits.png").read_bytes(),
            ),
        ]
        for row in results.where(image=name):
            words = f"{row['psnr']:.2f} dB, SSIM {row['ssim']:.3f}"
            file = (results.files / f"{name}-{row['method']}.png").read_bytes()
            pictures.append(Picture(title(str(row["method"])), words, file))
        scenes.append(Scene(f"Image {name}", truth.shape, plots.find_detail(truth), pictures))
    return scenes


def _row(name: str, method: str, estimate: Image, image: Image) -> Row:
    return {
        "image": name,
        "method": method,
        "psnr": jl.metrics.psnr(estimate, image),
        "snr": jl.metrics.snr(estimate, image),
        "ssim": jl.metrics.ssim(estimate, image),
    }


EXPERIMENT = Experiment(
    "fig7",
    "Figure 7: Berkeley images",
    SETTINGS,
    {
        **SETTINGS,
        "images": 2,
        "side": 128,
        "shown": ["101085", "101087"],
        "learning_images": 8,
        "learning_steps": 3,
        "learning_batch": 16,
    },
    parts,
    section,
    needs=("bsds300",),
)
