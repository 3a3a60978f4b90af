"""Compare counts along a motion with plain counting, on one thread.

    python benchmarks/speed/shifted_counts.py [--frames 256] [--rounds 9]

The frames have 256 x 512 jots. All cases run in turn, round by round, so all of them meet the same
state of the machine. The table shows the best time of each case, and its ratio to that of plain
counting. The smooth motions are given at the centers of tiles of 16 pixels, as by the alignment. It
counts a block of 8 to 31 frames in a call.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.motion.tiles import TILE, tile_counts

SIZE = 256, 512
DENSITY = 0.2
"""Share of ones."""

Fields = npt.NDArray[np.float32]
"""Displacements at two times."""

Motion = Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]]
"""A function from times in [-1, 1] to displacements (n, 2, rows, columns)."""


def main() -> None:
    """Time all cases, and print the table."""
    options = arguments()
    rng = np.random.default_rng(0)
    bits = np.packbits(rng.random((options.frames, *SIZE), np.float32) < DENSITY, axis=2)
    valid = np.packbits(rng.random(SIZE) > 1e-2, axis=1)
    cases = {
        "plain counting": lambda: count_plainly(bits, options.frames),
        "plain counting, calls of 8 frames": lambda: count_plainly(bits, 8),
        "plain counting, calls of 4 frames": lambda: count_plainly(bits, 4),
    }
    for name, motion, length in motions(rng):
        calls = divide(motion, options.frames, min(length or options.frames, options.frames))
        cases[name] = lambda calls=calls: count(bits, calls, None)
        if name.startswith("rotation"):
            cases[f"{name}, 1 % dead jots"] = lambda calls=calls: count(bits, calls, valid)
    best = dict.fromkeys(cases, np.inf)
    for _ in range(options.rounds):
        for name, run in cases.items():
            start = time.process_time()
            run()
            best[name] = min(best[name], time.process_time() - start)
    plain = best["plain counting"]
    print("| motion | frames/s | ratio to plain counting |")
    print("| --- | ---: | ---: |")
    for name, seconds in best.items():
        print(f"| {name} | {options.frames / seconds:,.0f} | {seconds / plain:.1f} |")


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=256)
    parser.add_argument("--rounds", type=int, default=9)
    return parser.parse_args()


def motions(rng: np.random.Generator) -> list[tuple[str, Motion, int | None]]:
    """Return the name of each motion, the motion, and how many frames are counted in a call."""
    random = rng.uniform(-20, 20, (2, 2, *SIZE)).round()
    shifts_of_rows = random[..., :1] * np.ones(SIZE[1])
    shifts_of_blocks = random[..., ::16].repeat(16, axis=-1)
    noise = rng.normal(0, 2, (2, 2, *SIZE))

    def linear(fields: npt.NDArray[np.float64], speed: float) -> Motion:
        """Return a motion by `speed` times the second field."""
        return lambda times: fields[0] + np.multiply.outer(speed * times, fields[1])

    smooth = [("rotation of 2 degrees, shake of 20 pixels", rotation), ("layers", layers)]
    return [
        ("one shift per row, constant", linear(shifts_of_rows, 0.0), None),
        ("one shift per row, changing", linear(shifts_of_rows, 1.0), None),
        ("one shift per 16 pixels, constant", linear(shifts_of_blocks, 0.0), None),
        ("one shift per 16 pixels, changing", linear(shifts_of_blocks, 1.0), None),
        *(
            (f"{name}, calls of {length or 'all'} frames", motion, length)
            for name, motion in smooth
            for length in (None, 16, 8, 4)
        ),
        ("random shifts of pixels, changing", linear(noise, 1.0), None),
    ]


def rotation(times: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return a rotation by 2 degrees, and a smooth path of 20 pixels in both directions."""
    tiles = np.indices(tile_counts(SIZE))
    rows, columns = (index * TILE - length / 2 for index, length in zip(tiles, SIZE, strict=True))
    path = 10 * np.stack([np.sin(3 * times), np.sin(2 * times + 1)])
    rotated = np.multiply.outer(np.radians(times), np.stack([-columns, rows]))
    return rotated + path.T[:, :, None, None]


def layers(times: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return a background, and an object that moves in the opposite direction."""
    nodes = np.zeros((2, *tile_counts(SIZE)))
    nodes[0], nodes[1] = 6, 3
    nodes[0, 5:12, 10:17], nodes[1, 5:12, 10:17] = -16, -8
    return np.multiply.outer(times, nodes)


def divide(motion: Motion, frames: int, length: int) -> list[tuple[slice, Fields]]:
    """Return the frames of each call, and the fields before its first and after its last frame."""
    starts = range(0, frames, length)
    edges = 2 * np.array([*starts, frames]) / frames - 1
    fields = motion(edges).astype(np.float32)
    return [
        (slice(start, start + length), fields[index : index + 2])
        for index, start in enumerate(starts)
    ]


def count_plainly(bits: npt.NDArray[np.uint8], length: int) -> None:
    """Count the ones of all frames, some in each call."""
    counts = np.zeros(SIZE, np.int32)
    for start in range(0, len(bits), length):
        engine.add_block_counts([bits[start : start + length]], SIZE[1], 1, None, counts[None], 1)


def count(
    bits: npt.NDArray[np.uint8],
    calls: list[tuple[slice, Fields]],
    valid: npt.NDArray[np.uint8] | None,
) -> None:
    """Count the ones of all frames along a motion."""
    ones, trials = np.zeros((2, *SIZE), np.int32)
    remainders = np.zeros((SIZE[0], 2, SIZE[1] // 16), np.float32)
    for frames, fields in calls:
        part = bits[frames]
        tile = None if fields.shape[2:] == SIZE else TILE
        times = (np.arange(len(part)) + 0.5) / len(part)
        engine.count_shifted(part, SIZE[1], fields, tile, times, valid, ones, trials, remainders, 1)


if __name__ == "__main__":
    main()
