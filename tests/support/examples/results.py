"""Examples of the results of experiments."""

import json
from pathlib import Path

import numpy as np

import jotlight as jl
from examples.encodings import PNG_CHECKSUMS
from examples.models import save_calibration
from examples.reader import Reader
from jotlight.cli.captures.applied_calibration import AppliedCalibration
from jotlight.experiments import EXPERIMENTS
from jotlight.experiments.experiment import Data, RunContext
from jotlight.experiments.png import decode_png, encode_png
from jotlight.experiments.runner import Folder, collect, prepare, settings_of
from jotlight.experiments.tables import read_results, write_facts, write_table


def _results(path):
    path.mkdir()
    write_table(path / "fig5.csv", [{"image": "a", "psnr": 1.5}, {"image": "b", "psnr": 2}])
    settings = json.dumps({"quick": True, "BM3D": "4.0.3"})
    facts = {"seconds": "1", "date": "2026-01-01", "machine": "a", "settings": settings}
    write_facts(path / "run.csv", {"fig5": facts})


def _read_results(path):
    return read_results(path, lambda name: None)


FIG5 = EXPERIMENTS["fig5"]
CONTEXT = RunContext(settings_of(FIG5, True, Data()), Path(), Data())


def _reproduction(path):
    folder = Folder(path)
    prepare(FIG5, folder, quick=True, restart=False, data=Data(), threads=1)
    outcome = {"rows": [{"cost": 1.5, "step": 2}], "seconds": 1, "date": "2026-01-01"}
    for part in FIG5.parts(CONTEXT):
        folder.part_file(FIG5, part).write_text(json.dumps({**outcome, "machine": "a"}))


def _collect(path):
    return collect(FIG5, CONTEXT, Folder(path))


def _prepare(path):
    return prepare(FIG5, Folder(path), quick=True, restart=False, data=Data(), threads=1)


def _image(path):
    path.write_bytes(encode_png(np.eye(5)))


def _read_record(path):
    """Read the calibration of an image, which may replace the record beside it."""
    return AppliedCalibration.read(path.with_name("calibration.safetensors"), path)


def _record(path):
    save_calibration(path.with_name("calibration.safetensors"))
    description = _read_record(path).description(jl.Sensor(), "mle", "a", None)
    path.with_name(f"{path.name}.json").write_text(json.dumps(description, indent=2) + "\n")


RESULTS = {
    "results-part": Reader(
        "a", _collect, (_reproduction,), file="a/parts/fig5/descent-0.7.json", json=True
    ),
    "results-settings": Reader(
        "a", _prepare, (_reproduction,), file="a/parts/fig5/settings", json=True
    ),
    "results-image": Reader(
        "a.png", lambda path: decode_png(path.read_bytes(), str(path)), (_image,), **PNG_CHECKSUMS
    ),
    "image-record": Reader("a.tif", _read_record, (_record,), file="a.tif.json", json=True),
    "results-facts": Reader("a", _read_results, (_results,), file="a/run.csv"),
    "results-table": Reader("a", _read_results, (_results,), file="a/fig5.csv"),
}
"""Readers of results, by the file that is damaged."""
