"""Single flipped bits in all files of a capture. Verification must refuse the capture.

A child process reads each damaged capture, because a C library may crash.
"""

import random
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import jotlight as jl
from damage.record import Row, report
from jotlight.formats.registry import WRITERS
from jotlight.formats.verification import verify_capture
from jotlight.formats.writing import write_capture
from jotlight.images.io import image_writer, read_image

SEED = 20
FLIPS = 400
QUICK_FLIPS = 20
QUICK = ("npy.gz", "zarr", "png")
NEEDS = {"hdf5": "h5py", "zarr": "zarr"}

REFUSED, SAME, OTHER = "refused", "same content", "other content"
"""Outcomes of reading a damaged capture. A crash or another exception has its own name."""

ONLY_VERIFIED = "npy:"
"""First letters of the names of captures whose data only verification compares with a checksum."""

NO_CHECKSUM = {
    "visionsim": "the layout of other software, without checksums",
    **dict.fromkeys(
        ("swissspad2", "swissspad2-full", "spad512s", "spad512s-sparse"),
        "raw frames in the layout of the camera, without checksums",
    ),
    ".tif, .exr, .npy, .jpg (images)": "the formats have no checksums",
    ".safetensors (networks, calibrations, checkpoints)": "the format has no checksums",
}
"""Formats that jotlight writes without a checksum, and the reason. Their files are not tested."""


def measure(*, quick: bool = False, only: str = "") -> list[Row]:
    """Return a row for each kind of capture in each format: how many flips were refused."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (name, needs, write) in enumerate(_captures()):
            if only not in name or (quick and not only and not name.startswith(QUICK)):
                continue
            if find_spec(needs) is None:
                rows.append({"part": "flips", "name": name, "flips": 0, "outcomes": {}})
                rows[-1]["violations"] = [f"{needs} is not installed"]
                continue
            parent = Path(folder, str(number))
            parent.mkdir()
            path = write(parent)
            rows.append(_flip(name, path, QUICK_FLIPS if quick else FLIPS))
            report(f"{name}: {rows[-1]['outcomes']}")
            for violation in rows[-1]["violations"]:
                report(f"  {violation}")
    return rows


def _captures() -> Iterator[tuple[str, str, Callable[[Path], Path]]]:
    """Yield the name of each kind of capture, the package it needs, and a function to write it."""
    rng = np.random.default_rng(SEED)
    shape = (24, 40)
    maps = jl.Sensor(frames=6, dark_counts=rng.random(shape) / 20, mask=rng.random(shape) < 0.01)
    data = {
        "bits": jl.Sensor(frames=6).expose(rng.random(shape), rng=1),
        "bits with maps": maps.expose(rng.random(shape), rng=2),
        "counts": rng.integers(0, 300, shape).astype(np.int32),
    }
    for name, writer in WRITERS.items():
        if name in NO_CHECKSUM:
            continue
        for kind, capture in data.items():
            is_counts = kind == "counts"
            if (is_counts and writer.counts) or (not is_counts and writer.bits):
                if kind == "bits with maps" and not writer.keeps_sensor:
                    continue
                ending = writer.extensions[0] if writer.extensions else ""
                yield f"{name}: {kind}", NEEDS.get(name, "numpy"), _writer(capture, ending, name)
    for depth in (8, 16):
        for channels in ((), (3,)):
            image = rng.random((*shape, *channels))
            kind = "color" if channels else "gray"
            yield f"png: {kind} image, {depth} bits", "numpy", _image_writer(image, depth)


def _writer(capture: jl.Bits | np.ndarray, ending: str, name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        data = capture
        if isinstance(data, jl.Bits) and not WRITERS[name].keeps_sensor:
            data = jl.Bits(data.packed, data.width)
        write_capture(data, folder / f"a{ending}", name)
        return folder / f"a{ending}"

    return write


def _image_writer(image: np.ndarray, depth: int) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        image_writer("a.png", depth=depth)(folder / "image.png", image)
        return folder / "image.png"

    return write


def _flip(name: str, path: Path, flips: int) -> Row:
    """Return the row of flips in all files of a capture, which are alone in their folder."""
    files = sorted(file for file in path.parent.rglob("*") if file.is_file())
    sizes = [file.stat().st_size for file in files]
    verify_capture(path) if path.name != "image.png" else None
    original = _content(path)
    rng = random.Random(f"{SEED} {name}")
    places = rng.sample(range(8 * sum(sizes)), min(flips, 8 * sum(sizes)))
    outcomes: Counter[str] = Counter()
    reads: Counter[str] = Counter()
    violations = []
    pool = _new_pool()
    for bit in places:
        file, offset = _locate(files, sizes, bit // 8)
        content = file.read_bytes()
        damaged = bytearray(content)
        damaged[offset] ^= 1 << bit % 8
        file.write_bytes(damaged)
        try:
            verified, read = pool.submit(_outcomes, path, original).result()
        except BrokenProcessPool:
            verified = read = "crashed"
            pool = _new_pool()
        file.write_bytes(content)
        outcomes[verified] += 1
        reads[read] += 1
        place = f"bit {bit % 8} of byte {offset} of {file.relative_to(path.parent)}"
        if verified != REFUSED:
            violations.append(f"{place}: {verified} when verified")
        if read not in (REFUSED, SAME) and not name.startswith(ONLY_VERIFIED):
            violations.append(f"{place}: {read} when read")
    pool.shutdown()
    row = {"part": "flips", "name": name, "bytes": sum(sizes), "files": len(files)}
    row |= {"flips": len(places), "outcomes": dict(outcomes), "reads": dict(reads)}
    return {**row, "violations": violations}


def _new_pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, initializer=warnings.simplefilter, initargs=("ignore",))


def _locate(files: list[Path], sizes: list[int], offset: int) -> tuple[Path, int]:
    """Return the file that contains a byte, and its offset there, from its offset in all files."""
    for file, size in zip(files, sizes, strict=True):
        if offset < size:
            return file, offset
        offset -= size
    raise IndexError(offset)


def _content(path: Path) -> object:
    """Return what a capture or an image contains."""
    if path.name == "image.png":
        return read_image(path).tobytes()
    data = jl.open(path)
    if isinstance(data, jl.Bits):
        sensor = data.sensor
        maps = {} if sensor is None else {k: v.tobytes() for k, v in sensor.maps().items()}
        return data.to_array().tobytes(), data.shape, repr(sensor), maps
    return data.tobytes(), data.shape


def _outcomes(path: Path, original: object) -> tuple[str, str]:
    """Return the outcomes of verifying and of reading a damaged capture."""
    read = _outcome(lambda: _content(path), original)
    if path.name == "image.png":
        return read, read
    return (REFUSED if _outcome(lambda: verify_capture(path)) == REFUSED else read), read


def _outcome(read: Callable[[], object], original: object = None) -> str:
    try:
        content = read()
    except (OSError, ValueError):
        return REFUSED
    except Exception as error:  # any type: this is what the table reports
        return type(error).__name__
    return SAME if content == original else OTHER
