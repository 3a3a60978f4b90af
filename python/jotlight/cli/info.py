"""`jotlight info`: what is in a file."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from jotlight.bits import Bits
from jotlight.cli.console import out, progress
from jotlight.files import spare_inputs, written_whole
from jotlight.formats.npy import is_cube, load_bits, npz_names, read_npy, read_npz
from jotlight.network import Network
from jotlight.pictures import read_picture
from jotlight.training import History


def info(
    file: Annotated[
        Path, typer.Argument(help="Bits or counts (.npy), a network (.safetensors), a picture.")
    ],
    width: Annotated[
        int | None, typer.Option(help="True width in jots, where no .json tells.")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(help="A figure of a learned network and its run: .png, .pdf or .svg."),
    ] = None,
) -> None:
    """Say what a file holds: shape, sensor, share of ones, range."""
    if plot is not None:
        _draw(file, plot)
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in _facts(file, width):
        table.add_row(name, value)
    out.print(table)


def _draw(file: Path, plot: Path) -> None:
    from jotlight import plots

    plots.check_figure(plot)
    network = Network.load(file)
    if "records" not in network.history:
        raise ValueError(f"{file}: this network has no history of a run to draw")
    spare_inputs(plot, [file])
    with written_whole(plot) as temporary:
        history = History.from_json(network.history["records"])
        plots.training(network, history).savefig(temporary, dpi=110)


def _facts(file: Path, width: int | None) -> list[tuple[str, str]]:
    if file.suffix.lower() == ".safetensors":
        return _network_facts(Network.load(file))
    if file.suffix.lower() == ".npy":
        array = read_npy(file)
        if is_cube(array):
            return _bits_facts(load_bits(file, width=width))
        kind = "counts" if array.dtype.kind in "iu" else "array"
        return [("kind", kind), ("shape", _by(array.shape)), *_range(np.asarray(array))]
    if file.suffix.lower() == ".npz":
        facts = [("kind", "archive of arrays")]
        for name in npz_names(file):
            array = read_npz(file, name)
            facts.append((name, f"{array.dtype}, {_by(array.shape)}"))
        return facts
    picture = read_picture(file)
    return [("kind", "picture"), ("shape", _by(picture.shape)), *_range(picture)]


def _bits_facts(bits: Bits) -> list[tuple[str, str]]:
    with progress(1) as begin:
        ones = int(bits.counts(1, progress=begin("counting")).sum(dtype=np.int64))
    frames, height, width, *channels = bits.shape
    facts = [
        ("kind", "bits" if not channels else f"bits of {channels[0]} channels"),
        ("frames", str(frames)),
        ("jots", f"{height} x {width}"),
        ("size", f"{bits.packed.nbytes / 1e6:.3g} MB packed"),
        ("ones", f"{ones / np.prod(bits.shape, dtype=float):.3%}"),
    ]
    if bits.sensor is None:
        return [*facts, ("sensor", "not told; the width is taken to be a multiple of 8")]
    pixels = f"{height // bits.sensor.oversampling} x {width // bits.sensor.oversampling}"
    return [
        *facts,
        ("sensor", repr(bits.sensor)),
        ("pixels", f"{pixels}, {bits.sensor.bits_per_pixel} bits each"),
    ]


def _network_facts(network: Network) -> list[tuple[str, str]]:
    facts = [("kind", "network"), ("sensor", repr(network.sensor))]
    for index, layer in enumerate(network.layers):
        facts.append(
            (
                f"layer {index}",
                f"filters {_by(layer.filters.shape)}, splines of {layer.coefficients.shape[1]} "
                f"coefficients on [{layer.start:.3g}, "
                f"{layer.start + layer.spacing * (layer.coefficients.shape[1] - 3):.3g}]",
            )
        )
    history = network.history
    facts += [(name, str(history[name])) for name in ("start", "trained on") if name in history]
    if "run" in history and "records" in history:
        facts.append(("learned", _course(history["run"], History.from_json(history["records"]))))
    return facts


def _course(run: dict[str, Any], history: History) -> str:
    course = (
        f"{len(history) - 1} steps of {run.get('optimiser')}, seed {run.get('seed')}; cost "
        f"{history.loss[0]:.4g} to {history.loss[-1]:.4g}"
    )
    measured = history.test_psnr[np.isfinite(history.test_psnr)]
    if len(measured):
        course += f", test PSNR {measured[0]:.2f} to {measured[-1]:.2f} dB"
    return course


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _range(array: np.ndarray) -> list[tuple[str, str]]:
    if array.size == 0 or array.dtype.kind not in "biuf":
        return [("values", str(array.dtype))]
    return [("values", f"{array.dtype}, {array.min():.4g} to {array.max():.4g}")]
