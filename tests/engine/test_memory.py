"""The memory that long calls need."""

import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

# The numbers come from /proc, because getrusage includes the peak of the parent process. The peak
# may be older than the call, so the measured growth is an upper bound.
MEASURE = """
from pathlib import Path

import numpy as np

import jotlight as jl


def memory(kind):
    status = Path("/proc/self/status").read_text()
    return int(status.split(kind + ":")[1].split()[0]) * 1024


def growth(call):
    before = memory("VmRSS")
    result = call()
    return memory("VmHWM") - before, result
"""

EXPOSE = """
sensor = jl.Sensor(oversampling={oversampling}, frames={frames}, kernel={kernel!r})
image = np.full({shape}, 0.5, np.{dtype})
axis = None if image.ndim == 2 else -1
sensor.expose(image[:64, :64], rng=0, channel_axis=axis)
grown, bits = growth(lambda: sensor.expose(image, rng=0, channel_axis=axis))
print((grown - bits.packed.nbytes) * 8 / np.prod(bits.shape))
"""

COUNT = """
packed = np.full((64, 4096, 512), 0xAA, np.uint8)
bits = jl.Bits(packed)
bits[:1].counts(4)
grown, counts = growth(lambda: bits.counts(4))
assert (counts == 64 * 8).all()
print((grown - counts.nbytes) * 8 / np.prod(bits.shape))
"""


def printed_number(code):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", MEASURE + code],
        check=True,
        capture_output=True,
        text=True,
    )
    return float(done.stdout)


@pytest.mark.parametrize(
    ("oversampling", "frames", "kernel", "shape", "dtype"),
    [
        (8, 1, "box", (4096, 4096), "float32"),
        (4, 1, "box", (4096, 4096), "float64"),
        (4, 1, "cubic", (2048, 1024), "float32"),
        (1, 16, "box", (4096, 4096), "float32"),
        (2, 4, "box", (2048, 2048, 3), "float32"),
        (2, 1, "box", (2048, 2048, 3), "float32"),
        (1, 2048, "box", (4096, 8), "float32"),
    ],
)
def test_exposing_needs_less_than_two_bits_per_jot_besides_image_and_bits(
    oversampling, frames, kernel, shape, dtype
):
    code = EXPOSE.format(
        oversampling=oversampling, frames=frames, kernel=kernel, shape=shape, dtype=dtype
    )
    assert printed_number(code) < 2


def test_counting_needs_less_than_a_twentieth_of_a_bit_per_jot_besides_bits_and_counts():
    assert printed_number(COUNT) < 0.05


MILLION = """
import contextlib
import sys
from jotlight.cli import app
from jotlight.formats.writing import write_capture
from jotlight.sensing.bits.frames import Frames

shape = (1_000_000, 16, 8)
frames = Frames(shape, lambda a, b: np.full((b - a, *shape[1:]), 0x55, np.uint8))
write_capture(jl.Bits(frames[:2]), Path("small" + {ending!r}), {name!r})
written, _ = growth(lambda: write_capture(jl.Bits(frames), Path("million" + {ending!r}), {name!r}))


def run(*words):
    sys.argv = ["jotlight", *words]
    with contextlib.suppress(SystemExit):
        app.main()


sys.stdout = sys.stderr
run("reconstruct", "small" + {ending!r}, "-o", "small.tif", "-m", "mle")
grown, _ = growth(
    lambda: run("reconstruct", "million" + {ending!r}, "-o", "million.tif", "-m", "mle", {turn})
)
sys.stdout = sys.__stdout__
assert Path("million.tif").exists()
print(max(written, grown) / (1 << 20))
"""


@pytest.mark.parametrize(
    ("name", "ending", "turn"), [("npy.gz", ".npy.gz", '"--rotate", "90"'), ("npy", ".npy", "")]
)
def test_a_million_frames_are_written_and_reconstructed_in_little_memory(
    tmp_path, monkeypatch, name, ending, turn
):
    # There are 128 MB of packed bits, in four chunks of 32 MB.
    monkeypatch.chdir(tmp_path)
    assert printed_number(MILLION.format(name=name, ending=ending, turn=turn)) < 64


WHOLE = """
import numpy as np
import jotlight as jl

# 20,000 frames in 328 MB. The file is sparse, so it takes almost no space on the disk.
shape = (20_000, 256, 64)
with open("cube.npy", "wb") as file:
    header = {"descr": "|u1", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, header)
    file.write(bytes([0b01010101]) * 64)
    file.truncate(file.tell() - 64 + np.prod(shape))
assert jl.open("cube.npy").counts().sum() == 4 * 64
status = open("/proc/self/status").read()
print(int(status.split("VmHWM:")[1].split()[0]) / 1024)
"""


def test_counting_twenty_thousand_frames_needs_a_process_of_less_than_200_mib(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    command = [sys.executable, "-W", "error", "-c", WHOLE]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert float(done.stdout) < 200


ESTIMATE = """
sensor = jl.Sensor(frames=16)
network = jl.pretrained(sensor, {quality!r})
counts = np.full(({rows}, 1024), 8, np.int32)
network.reconstruct(counts[:512], sensor, threads=1)
grown, estimate = growth(lambda: network.reconstruct(counts, sensor, threads=1))
print((grown - estimate.nbytes) / (1 << 20))
"""


@pytest.mark.parametrize("quality", ["small", "medium"])
def test_deep_networks_need_no_more_memory_for_larger_images(quality):
    small, large = (printed_number(ESTIMATE.format(quality=quality, rows=n)) for n in (4096, 8192))
    # A second copy of the larger estimate would add 16 MiB.
    assert large - small < 8
