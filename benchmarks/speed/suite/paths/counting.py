"""Counting the ones of a long capture."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import jotlight as jl
from suite import probes
from suite.case import Case, Rival

HEIGHT, WIDTH, AT_ONCE = 256, 512, 100
SAME_BYTES = "reading the same bytes"


def cases(quick: bool) -> Iterator[Case]:
    frames = 2_000 if quick else 20_000
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        write(path, frames)
        bits = jl.open(path)
        words = bits.packed.reshape(-1).view(np.uint64)
        rivals = [
            Rival("NumPy, unpack and sum", lambda _: lambda: unpack_and_sum(bits.packed)),
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
            words=f"The ones of each jot in {frames:,} frames of {HEIGHT} × {WIDTH}, a photon cube "
            "mapped from a file that is in memory. photoncube offers means of frames "
            "as pictures of 8 bits, which it writes to files; these were compared with ours.",
            items=frames,
            unit="frames",
            ours=lambda threads: bits.counts(threads=threads),
            rivals=rivals,
            difference=lambda ours, theirs: float(np.abs(ours - theirs).max()),
            agreement="largest difference of a count",
            tolerance=0,
            slots=5 * bits.packed.nbytes / 4,
            bytes=bits.packed.nbytes + 4 * HEIGHT * WIDTH,
            counted="every byte read once; a carry-save adder's five operations on 32 bits",
            parts={SAME_BYTES: lambda threads: probes.read_words(words, threads)},
        )


def write(path: Path, frames: int) -> None:
    rng = np.random.default_rng(0)
    shape = (frames, HEIGHT, WIDTH // 8)
    cube = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=shape)
    for start in range(0, frames, AT_ONCE):
        stop = min(start + AT_ONCE, frames)
        cube[start:stop] = rng.integers(0, 256, (stop - start, *shape[1:]), np.uint8)
    cube.flush()


def unpack_and_sum(packed: np.ndarray) -> np.ndarray:
    total = np.zeros((HEIGHT, WIDTH), np.int64)
    for start in range(0, len(packed), AT_ONCE):
        part = np.unpackbits(packed[start : start + AT_ONCE], axis=2)
        total += part.sum(axis=0, dtype=np.int64)
    return total


def means(package: Any, path: Path, frames: int, folder: Path) -> Callable[[], None]:
    """photoncube's means, after a look at whether they are those of our counts."""
    from jotlight.images.io import read_image

    cube = package.PhotonCube.open(str(path))
    cube.set_range(0, None, frames)
    cube.save_images(str(folder / "means"))
    bits = jl.open(path)
    for index, file in enumerate(sorted((folder / "means").glob("*.png"))):
        ours = bits[index * frames : (index + 1) * frames].counts() / frames
        picture = read_image(file, gray=True)
        # It rounds to 8 bits, towards nought.
        assert np.abs(picture - ours).max() < 1.01 / 255, "photoncube's means differ"
    return lambda: cube.save_images(str(folder / "means"))
