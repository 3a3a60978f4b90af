"""Counting the ones of a long capture."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import jotlight as jl
from suite import probes
from suite.case import Case, Rival

HEIGHT, WIDTH = 256, 512
CHUNK = 100
"""Frames that are written or unpacked in one step."""

NUMPY = "NumPy, unpack and sum"
SAME_BYTES = "reading the same bytes"


def cases(quick: bool) -> Iterator[Case]:
    frames = 2_000 if quick else 20_000
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        write(path, frames)
        bits = jl.open(path)
        cube = np.load(path, mmap_mode="r")
        words = cube.reshape(-1).view(np.uint64)
        rivals = [
            Rival(NUMPY, lambda _: lambda: unpack_and_sum(cube)),
            Rival(
                "photoncube, means of twentieths",
                lambda package: means(package, path, frames // 20, Path(folder)),
                "photoncube",
                same=False,
            ),
        ]
        yield Case(
            name="counting",
            title="Counting",
            description=f"The ones of each jot in {frames:,} frames of {HEIGHT} × {WIDTH}, a "
            "photon cube in a file that the operating system keeps in memory. photoncube writes "
            "means of frames to files as images of 8 bits. These agree with jotlight's.",
            items=frames,
            unit="frames",
            run=lambda threads: bits.counts(threads=threads),
            rivals=rivals,
            difference=lambda result, other: float(np.abs(result - other).max()),
            agreement="largest difference of a count",
            tolerance=0,
            operations=5 * bits.packed.nbytes / 4,
            bytes=bits.packed.nbytes + 4 * HEIGHT * WIDTH,
            operations_note="every byte is read once; a carry-save adder takes five operations on "
            "32 bits",
            parts={SAME_BYTES: lambda threads: probes.read_words(words, threads)},
        )


def write(path: Path, frames: int) -> None:
    rng = np.random.default_rng(0)
    shape = (frames, HEIGHT, WIDTH // 8)
    cube = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=shape)
    for start in range(0, frames, CHUNK):
        stop = min(start + CHUNK, frames)
        cube[start:stop] = rng.integers(0, 256, (stop - start, *shape[1:]), np.uint8)
    cube.flush()


def unpack_and_sum(packed: np.ndarray) -> np.ndarray:
    total = np.zeros((HEIGHT, WIDTH), np.int64)
    for start in range(0, len(packed), CHUNK):
        part = np.unpackbits(packed[start : start + CHUNK], axis=2)
        total += part.sum(axis=0, dtype=np.int64)
    return total


def means(package: Any, path: Path, frames: int, folder: Path) -> Callable[[], None]:
    """Return the function that makes photoncube's means, after comparing them with counts."""
    from jotlight.images.io import read_image

    cube = package.PhotonCube.open(str(path))
    cube.set_range(0, None, frames)
    cube.save_images(str(folder / "means"))
    bits = jl.open(path)
    for index, file in enumerate(sorted((folder / "means").glob("*.png"))):
        expected = bits[index * frames : (index + 1) * frames].counts() / frames
        image = read_image(file, gray=True)
        # photoncube rounds down to 8 bits.
        assert np.abs(image - expected).max() < 1.01 / 255, "photoncube's means differ"
    return lambda: cube.save_images(str(folder / "means"))
