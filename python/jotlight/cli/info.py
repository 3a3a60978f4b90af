"""``jotlight info``: the contents of a file."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from rich.table import Table

from jotlight.calibration import Calibration
from jotlight.calibration.result import FORMAT as CALIBRATION
from jotlight.cli.captures.jot_checks import jot_remarks
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.common_options import convert_file
from jotlight.cli.reports.capture_facts import bits_facts, notes, readings_facts
from jotlight.cli.reports.network_facts import layers_table, network_facts, training_runs
from jotlight.cli.reports.origins import (
    film_facts,
    is_film,
    origin_facts,
    verify_result,
    verify_video,
    video_facts,
)
from jotlight.cli.terminal.console import out, progress, shape_text, with_options_only
from jotlight.files import check_outputs
from jotlight.formats import open_capture
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.frames.labels import COUNTS, parse_label
from jotlight.formats.images.tiff_directories import open_checked_tiff, shape_of
from jotlight.formats.npy.archives import describe_npz_arrays, read_npz_label
from jotlight.formats.npy.arrays import open_npy_array
from jotlight.formats.opening.detect import PHOTOGRAPH_EXTENSIONS, detect_format
from jotlight.formats.opening.locations import check_exists, is_url
from jotlight.formats.verification import verify_capture
from jotlight.images.io import read_image
from jotlight.layout import is_single_image
from jotlight.motion.motion import FORMAT as MOTION
from jotlight.motion.motion import Motion
from jotlight.networks.files.network_files import refuse_onnx
from jotlight.networks.loading import load_network
from jotlight.progress.bars import printable
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import stored_format

_LOADERS: dict[str, Callable[[Path], Calibration | Motion]] = {
    CALIBRATION: Calibration.load,
    MOTION: Motion.load,
}
"""The kinds of `.safetensors` files that hold no network, by the format that they state."""


def info(
    file: Annotated[
        str,
        Parameter(
            converter=convert_file,
            help="A capture of bits or counts, a file, a folder, or a URL; a network, a "
            "calibration, or a motion (.safetensors); or an image.",
        ),
    ],
    /,
    *,
    capture: CaptureOptions = CaptureOptions(),
    plot: Annotated[
        Path | None,
        Parameter(
            help="A figure of a calibration, a motion, or a trained network: .png, .pdf, or .svg. "
            "Default: none."
        ),
    ] = None,
    verify: Annotated[
        bool,
        Parameter(
            help="Compare all checksums of a capture, a video, or a film, and read all of its "
            "frames or images."
        ),
    ] = False,
) -> None:
    """Show the contents of a file: kind, shape, sensor, fraction of ones, range."""
    if is_url(file):
        if verify or plot is not None:
            raise ValueError("--verify and --plot are for files on this machine, not for URLs")
        out.print(_table(_capture_facts(capture.open(file))))
        return
    path = Path(file)
    if not _has_capture_options(capture):
        refuse_onnx(path)
    verified = [("verified", _verify(path, capture))] if verify else []
    if plot is not None:
        _draw(path, plot)
    out.print(_table([*_facts(path, capture), *verified]))
    if path.suffix.lower() == ".safetensors" and stored_format(path) not in _LOADERS:
        out.print(layers_table(load_network(path).layers))


def _table(rows: list[tuple[str, str]]) -> Table:
    """Return a table of names and values."""
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in rows:
        table.add_row(printable(name), printable(with_options_only(value)))
    return table


def _verify(file: Path, capture: CaptureOptions) -> str:
    if file.suffix.lower() == ".safetensors":
        raise ValueError(f"{file}: --verify is for captures and videos, not for .safetensors files")
    with progress(1) as begin:
        update = begin("verifying")
        options = dataclasses.replace(capture, frame_range=None, region=None).to_options()
        return (
            verify_video(file, update)
            or verify_result(file)
            or verify_capture(file, progress=update, **options.stated())
        )


def _draw(file: Path, plot: Path) -> None:
    import jotlight.plots as plots

    plots.check_figure(plot)
    if load := _LOADERS.get(stored_format(file)):
        check_outputs([plot], [file])
        plots.save_figure(load(file).plot(), plot)
        return
    network = load_network(file)
    runs = training_runs(file, network)
    if not runs:
        raise ValueError(f"{file}: this network has no history of a training run to draw")
    check_outputs([plot], [file])
    plots.save_figure(plots.training(network, runs[-1]), plot)


def _facts(file: Path, capture: CaptureOptions) -> list[tuple[str, str]]:
    """Return the rows of the table: names and values."""
    ending = file.suffix.lower()
    if ending == ".safetensors":
        if load := _LOADERS.get(stored_format(file)):
            return _facts_of(load(file))
        return network_facts(file, load_network(file))
    if file.is_dir() and (video := video_facts(file)):
        return video
    if not _has_capture_options(capture) and (film := film_facts(file)):
        return film
    if ending == ".csv" and (scores := origin_facts(file)):
        return [("kind", "scores"), *scores]
    content, origin = _content_facts(file, capture), origin_facts(file)
    if is_film(origin) and not _has_capture_options(capture):
        content[0] = ("kind", "film")
    # A copy states its provenance, which its record repeats.
    repeated = {(name, text) for name in ("provenance", "") for _, text in content}
    return [*content, *(row for row in origin if row not in repeated)]


def _has_capture_options(capture: CaptureOptions) -> bool:
    """Return whether there is an option that only captures have, so that a file is a capture."""
    return dataclasses.replace(capture, isolate=True) != CaptureOptions()


def _content_facts(file: Path, capture: CaptureOptions) -> list[tuple[str, str]]:
    """Return the rows about the content of a capture or an image."""
    check_exists(file)
    ending = file.suffix.lower()
    if not _has_capture_options(capture) and file.is_file():
        if ending == ".npz" and read_npz_label(file) is None:
            arrays = describe_npz_arrays(file)
            if len(arrays) > 1 or not _may_be_capture(*next(iter(arrays.values()))):
                facts = [
                    (name, f"{dtype}, {shape_text(shape)}")
                    for name, (shape, dtype) in arrays.items()
                ]
                return [("kind", "archive of arrays"), *facts]
        if ending == ".npy" and (stored := open_npy_array(file)).dtype.kind not in "biu":
            return [
                ("kind", "array"),
                ("shape", shape_text(stored.shape)),
                *_range(np.asarray(stored)),
            ]
        if _is_image(file):
            return _image_facts(file)
    return _capture_facts(capture.open(file))


def _may_be_capture(shape: tuple[int, ...], dtype: np.dtype[Any]) -> bool:
    """Return whether an array may hold bits or counts, (H, W) to (T, H, W, C)."""
    return dtype.kind in "biu" and len(shape) in (2, 3, 4)


def _image_facts(file: Path) -> list[tuple[str, str]]:
    image = read_image(file)
    size = ("shape", shape_text(image.shape))
    try:
        capture = open_capture(file)
    except (OSError, ValueError):  # color images and floats are no captures
        return [("kind", "image"), size, *_range(image)]
    if isinstance(capture, Bits):
        kind, levels = "bits", capture.counts(1)
    else:
        kind, levels = "counts", np.asarray(capture.images)
    return [
        ("kind", f"{kind}, or an image"),
        size,
        (kind, f"{levels.min():g} to {levels.max():g}"),
        ("image", _range(image)[0][1]),
        ("", f"--{kind} shows it as a capture"),
    ]


def _is_image(file: Path) -> bool:
    """Return whether a file is an image rather than a capture, as far as its content shows."""
    ending = file.suffix.lower()
    if ending in (".tif", ".tiff"):
        try:
            with open_checked_tiff(file) as tiff:
                series = tiff.series[0]
                shape, dtype = shape_of(series), series.dtype
                if parse_label(tiff.pages[0].description, COUNTS) is not None:
                    return False
                return bool(dtype.kind == "f" or (dtype == np.uint8 and is_single_image(shape)))
        except Exception:  # reading the file reports the error
            return True
    try:
        return detect_format(file) == "png"
    except ValueError:
        return ending in (*PHOTOGRAPH_EXTENSIONS, ".exr")


def _capture_facts(capture: Capture) -> list[tuple[str, str]]:
    if isinstance(capture, CountStack) and capture.sensor is not None:
        return [*readings_facts(capture.readings()), *notes(capture)]
    if isinstance(capture, CountStack):
        number = len(capture.images)
        with progress(1) as begin:
            counts = capture.sum(begin("summing"))
        trials = capture.total_trials
        jots = [] if trials is None else jot_remarks(counts, trials, Sensor(frames=trials))
        facts = [("kind", "counts"), ("format", capture.provenance.format)]
        facts += [("images", str(number))] if number > 1 else []
        return [
            *facts,
            ("shape", shape_text(counts.shape)),
            *_range(counts),
            *notes(capture),
            *jots,
        ]
    return [*bits_facts(capture), *notes(capture)]


def _facts_of(stored: Calibration | Motion) -> list[tuple[str, str]]:
    from jotlight.calibration.figure import facts

    if isinstance(stored, Motion):
        return [("kind", "motion"), *stored.facts().items()]
    captures = [(name, str(capture)) for name, capture in stored.provenance.items()]
    return [("kind", "calibration"), *captures, *facts(stored)]


def _range(array: np.ndarray) -> list[tuple[str, str]]:
    if array.size == 0 or array.dtype.kind not in "biuf":
        return [("values", str(array.dtype))]
    return [("values", f"{array.dtype}, {array.min():.4g} to {array.max():.4g}")]
