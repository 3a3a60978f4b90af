"""Every command that writes files, when a write fails: one line, and everything is as before."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from conversions import BITS, COUNTS, NEEDS, path_for
from folders import size_limit

pytest.importorskip("resource", reason="needs limits of the operating system")

pytestmark = pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")

RECONSTRUCT = "reconstruct IN/bits.npy --method mle -o"
FILM = "film IN/bits.npy --method mle -o"
MOTION = "reconstruct IN/bits.npy --method mle --motion --motion-file IN/motion.safetensors -o"
TRAIN = "train IN/photos --steps 2 --batch 2 --patch 16 --restart -o out.safetensors"

CONVERSIONS = {
    f"{kind} to {name}": f"convert IN/{source} -o {path_for(Path(), name)} --to {name}"
    for kind, source, names in (("bits", "bits.npy", BITS), ("counts", "counts.tif", COUNTS))
    for name in names
}

COMMANDS = CONVERSIONS | {
    "simulate": "simulate IN/photo.png --frames 40 --dark-counts IN/dark.npy -o out.npy",
    "png of 8 bits": f"{RECONSTRUCT} out.png",
    "png of 16 bits": f"{RECONSTRUCT} out.png --depth 16",
    "jpg": f"{RECONSTRUCT} out.jpg",
    "tif": f"{RECONSTRUCT} out.tif",
    "exr": f"{RECONSTRUCT} out.exr",
    "npy": f"{RECONSTRUCT} out.npy",
    "preview": f"{RECONSTRUCT} out.jpg --preview preview.jpg",
    "uncertainty npz": f"{RECONSTRUCT} out.jpg --uncertainty u.npz",
    "uncertainty npy": f"{RECONSTRUCT} out.jpg --uncertainty u.npy",
    "uncertainty tif": f"{RECONSTRUCT} out.jpg --uncertainty u.tif",
    "maps npz": f"{MOTION} out.jpg --maps maps.npz",
    "film npy": f"{FILM} out.npy --window 2",
    "film mp4": f"{FILM} out.mp4 --window 1",
    "film gif": f"{FILM} out.gif --window 1",
    "film folder": f"{FILM} out --window 2",
    "calibrate": "calibrate IN/bits.npy -o out.safetensors",
    "calibrate --plot": "calibrate IN/bits.npy -o out.safetensors --plot out.png",
    "record of a calibration": f"{RECONSTRUCT} out.png --calibration IN/calibration.safetensors",
    "train": TRAIN,
    "train --plot png": f"{TRAIN} --plot out.png",
    "train --plot pdf": f"{TRAIN} --plot out.pdf",
    "train --plot svg": f"{TRAIN} --plot out.svg",
    "evaluate": "evaluate IN/photos --method mle -o out.csv",
    "compare": "compare IN/photo.png --method mle -o out.jpg",
    "plan": "plan 0.1:1 --frames 100 --plot out.png",
    "info --plot": "info IN/calibration.safetensors --plot out.png",
}

FAST = ("bits to npy", "bits to hdf5", "bits to visionsim", "counts to zarr", "jpg", "exr")
"""Commands whose libraries crash or lie if they are used carelessly. The others take longer."""

SIMILAR = (
    "png of 16 bits", "tif", "uncertainty npy", "uncertainty tif", "film gif", "calibrate",
    "train", "train --plot pdf", "train --plot svg",
)  # fmt: skip
"""Commands that write with the code of others."""

PACKAGES = {"exr": "OpenEXR", "film mp4": "imageio_ffmpeg"} | {
    f"{kind} to {name}": package for name, package in NEEDS.items() for kind in ("bits", "counts")
}


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    """Return a folder with the files that the commands read."""
    folder = tmp_path_factory.mktemp("material")
    rng = np.random.default_rng(0)
    bits = jl.Bits.from_array(rng.random((4, 512, 512)) < 0.3)
    jl.save(bits, folder / "bits.npy")
    jl.save(jl.Bits(bits.packed[:, :256], bits.width), folder / "half.npy")
    jl.save(rng.integers(0, 9, (50, 60), np.int32), folder / "counts.tif")
    np.save(folder / "dark.npy", np.full((96, 128), 0.01, np.float32))
    jl.calibrate(bits.counts(1), frames=4).save(folder / "calibration.safetensors")
    jl.align(bits, model="none").save(folder / "motion.safetensors")
    (folder / "photos").mkdir()
    for path in (folder / "photo.png", folder / "photos/1.png", folder / "photos/2.png"):
        Image.fromarray(rng.integers(0, 256, (24, 32), np.uint8)).save(path)
    return folder


def snapshot(folder):
    """Return the inode and the content of every file below a folder."""
    return {
        path.relative_to(folder): (path.stat().st_ino, path.is_file() and path.read_bytes())
        for path in folder.rglob("*")
    }


def marks(name):
    return [pytest.mark.slow] * (name not in FAST) + [pytest.mark.exhaustive] * (name in SIMILAR)


@pytest.mark.parametrize("name", [pytest.param(name, marks=marks(name)) for name in COMMANDS])
def test_a_failed_write_is_one_line_and_changes_nothing(name, run, material, tmp_path):
    package = PACKAGES.get(name)
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"needs {package}")
    command = COMMANDS[name].replace("IN/", f"{material}/")
    if name == "bits to swissspad2":
        command = command.replace("bits.npy", "half.npy")
    status, output = run(*command.split())
    assert status == 0, output
    # A run of training also writes a checkpoint, which it deletes at its end.
    outputs = {*tmp_path.iterdir(), tmp_path / "out.checkpoint.safetensors"}
    sizes = {path: path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()}
    for path in tmp_path.iterdir():
        if path.is_dir():
            # Folders are never overwritten.
            shutil.rmtree(path)
    before = snapshot(tmp_path)
    # The figure of `compare` states times, so its size varies.
    largest = max(sizes.values()) - (name == "compare") * 10_000
    for limit in (largest - 1, largest // 2, 1):
        with size_limit(limit):
            status, output = run(*command.split())
        assert status == 1, (limit, output)
        errors = [line for line in output.splitlines() if "File too large" in line]
        assert len(errors) == 1, output
        assert "Traceback" not in output
        assert ".jotlight-" not in output
        failed = errors[0].partition("cannot write ")[2].removesuffix(": File too large")
        assert (tmp_path / failed) in outputs, output
        assert snapshot(tmp_path) == before
