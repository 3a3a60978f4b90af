"""`jotlight evaluate`: a model or method on many images."""

import contextlib
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from jotlight.cli import sensor_options
from jotlight.cli.console import out, progress
from jotlight.evaluation.evaluate import METRICS, Evaluation
from jotlight.evaluation.evaluate import evaluate as measure
from jotlight.evaluation.methods import DEFAULT_METHOD, METHODS
from jotlight.files import atomic_write, refuse_overwrite
from jotlight.images.sets import read_image_set
from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor


@sensor_options.takes_sensor()
def evaluate(
    images: Annotated[
        Path,
        typer.Argument(help="A folder of photographs, or an array (N, H, W) in .npy or .npz."),
    ],
    *,
    method: Annotated[
        str | None,
        typer.Option("--method", "-m", help=f"One of {', '.join(METHODS)}. Default: network."),
    ] = None,
    model: Annotated[Path | None, typer.Option(help="A network of your own, .safetensors.")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .csv with a row for each image.")
    ] = None,
    first: Annotated[int | None, typer.Option(help="Only so many images, by name.")] = None,
    key: sensor_options.Key = None,
    given: dict[str, Any],
    inputs: list[Path],
    seed: sensor_options.Seed = 0,
    white: sensor_options.White = None,
    threads: sensor_options.Threads = None,
) -> None:
    """Expose every image, reconstruct it, and tell how close the estimates come.

    The sensor is the model's, changed by the options given here; without a model, or with one for
    any sensor, it has 4 x 4 jots per pixel and one frame. Colour photographs are turned into grey.
    """
    if model is not None and method not in (None, "network-two-layer"):
        raise ValueError(f"model: is for the method network-two-layer, not for {method}")
    method = method or (DEFAULT_METHOD if model is None else "network-two-layer")
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    if output is not None:
        if output.suffix.lower() != ".csv":
            raise ValueError(f"{output}: expected a name that ends in .csv")
        pictures = list(images.iterdir()) if images.is_dir() else [images]
        refuse_overwrite(output, [model, *inputs, *pictures])
    network = None if model is None else Network.load(model)
    if network is None or network.trials_range is not None:
        sensor = Sensor(**{"oversampling": 4, **given})
    else:
        sensor = network.sensor.replace(**given)
    if network is not None:
        title, run = str(model), network.reconstruct
    elif (reason := METHODS[method].unsupported_reason(sensor)) is not None:
        raise ValueError(reason)
    else:
        title, run = METHODS[method].title, METHODS[method].run
    with contextlib.ExitStack() as files:
        # Made now, so that a place that cannot be written to is found before any work is done.
        temporary = files.enter_context(atomic_write(output)) if output is not None else None
        begin = files.enter_context(progress(2))
        names, scenes = read_image_set(
            images, key=key, white=white, first=first, progress=begin("reading the images")
        )
        result = measure(
            run,
            scenes,
            sensor,
            names=names,
            rng=seed,
            threads=threads,
            progress=begin("reconstructing"),
        )
        if temporary is not None:
            result.write_csv(temporary)
    out.print(
        f"{title}, {len(names)} image{'s' * (len(names) > 1)}, {sensor!r}",
        soft_wrap=True,
        markup=False,
    )
    out.print(_table(result))
    if output is not None:
        out.print(f"Each image: [bold]{output}[/]", soft_wrap=True)


def _table(result: Evaluation) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("")
    for column in ("PSNR", "SNR", "SSIM"):
        table.add_column(column, justify="right")
    rows = {
        "mean": result.mean,
        "worst 5 %": lambda name: result.mean_of_worst(name, 0.05),
        "worst 1 %": lambda name: result.mean_of_worst(name, 0.01),
    }
    for title, value in rows.items():
        psnr, snr, ssim = (value(name) for name in METRICS)
        shown = "none" if math.isnan(ssim) else f"{ssim:.3f}"
        table.add_row(title, f"{psnr:.2f} dB", f"{snr:.2f} dB", shown)
    return table
