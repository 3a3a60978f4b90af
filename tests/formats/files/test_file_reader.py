"""Reading of parts of a file, and captures that change after they were opened."""

import os
import subprocess
import sys

import numpy as np
import pytest

from examples.encodings import npy_bytes
from jotlight.formats.files.file_reader import FileReader

CONTENT = bytes(range(256)) * 40


def shorten(path):
    os.truncate(path, len(CONTENT) // 2)


def lengthen(path):
    path.write_bytes(CONTENT + b"x")


def replace(path):
    status = path.stat()
    path.with_suffix(".new").write_bytes(CONTENT)
    os.utime(path.with_suffix(".new"), ns=(status.st_atime_ns, status.st_mtime_ns))
    path.with_suffix(".new").replace(path)


def rewrite(path):
    path.write_bytes(CONTENT[::-1])
    os.utime(path, ns=(1, 1))


def delete(path):
    path.unlink()


@pytest.mark.parametrize(("position", "size"), [(0, 10_240), (0, 0), (10_240, 0), (77, 5000)])
def test_any_part_of_a_file_is_read(tmp_path, position, size):
    path = tmp_path / "a.bin"
    path.write_bytes(CONTENT)
    assert FileReader(path).read(position, size).tobytes() == CONTENT[position : position + size]


@pytest.mark.parametrize("change", [shorten, lengthen, replace, rewrite, delete])
def test_a_file_that_changed_is_refused_by_name(tmp_path, change):
    path = tmp_path / "a.bin"
    path.write_bytes(CONTENT)
    file = FileReader(path)
    file.read(0, 10)
    change(path)
    with pytest.raises(OSError, match=r"a\.bin"):
        file.read(0, 10)


def test_a_part_beyond_the_end_is_refused_before_memory_is_allocated(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(CONTENT)
    with pytest.raises(OSError, match=r"a\.bin: expected 1000000000001 bytes, got 10240"):
        FileReader(path).read(1, 10**12)


PREPARE = """
import os, sys
from pathlib import Path
import numpy as np
import jotlight as jl

frames = np.random.default_rng(0).random((40, 256, 512)) < 0.5
bits = jl.Bits.from_array(frames)
name, options = sys.argv[1], eval(sys.argv[2])
if name == "counts.tif":
    import tifffile
    tifffile.imwrite(name, frames.view(np.uint8), photometric="minisblack")
elif name == "counts.npz":
    np.savez(name, frames)
elif name.endswith(".bin.gz"):
    import gzip
    jl.save(bits, "plain.bin", format="swissspad2")
    Path(name).write_bytes(gzip.compress(Path("plain.bin").read_bytes()))
else:
    jl.save(bits, name, format=options.pop("save", options.get("format")))
opened = jl.open(name, **options)
file = max((each for each in Path().rglob("*") if each.is_file() and each.name != "plain.bin"),
           key=lambda each: each.stat().st_size)
maps = Path("/proc/self/maps")
if maps.exists():
    assert str(file.resolve()) not in maps.read_text(), "the file is mapped into memory"
"""

SHRINK = """
os.truncate(file, file.stat().st_size // 2)
try:
    opened.counts()
except (OSError, ValueError) as error:
    assert name in str(error) or file.name in str(error), f"no name: {error}"
    print("refused")
"""

SHRINK_WHILE_COUNTING = """
import jotlight.chunks
jotlight.chunks._MAX_JOTS = 1 << 19
done = []
def progress(fraction):
    done.append(fraction)
    os.truncate(file, 10_000)
try:
    opened.counts(progress=progress)
except OSError as error:
    assert name in str(error)
    print("refused after", len(done))
"""


def run_in_child(folder, script, name, options=None):
    """Return the output of a child process, whose death is an error, also by SIGBUS."""
    child = subprocess.run(
        [sys.executable, "-c", PREPARE + script, name, repr(options or {})],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.returncode == 0, child.stderr
    return child.stdout


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("capture.npy", {}),
        pytest.param("folder", {"save": "visionsim"}, marks=pytest.mark.slow),
        pytest.param("capture.bin", {"format": "swissspad2"}, marks=pytest.mark.slow),
        pytest.param("capture.bin.gz", {"format": "swissspad2"}, marks=pytest.mark.slow),
        pytest.param("capture.npy.gz", {}, marks=pytest.mark.slow),
        pytest.param("capture.h5", {}, marks=pytest.mark.slow),
        pytest.param("capture.zarr", {}, marks=pytest.mark.slow),
        pytest.param("capture", {"save": "matlab"}, marks=pytest.mark.slow),
        pytest.param("counts.tif", {"unpacked": True}, marks=pytest.mark.slow),
        pytest.param("counts.npz", {}, marks=pytest.mark.slow),
    ],
)
def test_a_capture_that_shrinks_after_it_was_opened_raises_an_error(tmp_path, name, options):
    assert run_in_child(tmp_path, SHRINK, name, options) == "refused\n"


@pytest.mark.slow
def test_a_capture_that_shrinks_while_it_is_counted_raises_an_error(tmp_path):
    assert run_in_child(tmp_path, SHRINK_WHILE_COUNTING, "capture.npy") == "refused after 1\n"


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("array", [np.float32(3), np.arange(5.0), np.eye(3) > 0, np.zeros((2, 0))])
def test_arrays_of_every_shape_and_order_are_read(tmp_path, array, order):
    from jotlight.formats.npy.arrays import read_npy

    array = np.asarray(array, order=order)
    (tmp_path / "a.npy").write_bytes(npy_bytes(array))
    read = read_npy(tmp_path / "a.npy")
    assert (read.dtype, read.shape) == (array.dtype, array.shape)
    np.testing.assert_array_equal(read, array)
