"""The frames of a folder of files, and warnings about frames that its files seem to lack."""

import itertools
import operator
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy.typing as npt

from jotlight.errors import counted, warn
from jotlight.sensing.bits.frames import Frames, concatenate


def describe_files(
    path: Path, files: Sequence[Path], order: str = "the natural order of their names"
) -> str:
    """Return a note about the files of a folder. It shows if the first or the last one is missing.

    Examples
    --------
    >>> describe_files(Path("a"), [Path("a/x/f9.bin"), Path("a/y/f9.bin")])
    '2 files in the natural order of their names, from x/f9.bin to y/f9.bin'
    """
    first, last = (file.relative_to(path).as_posix() for file in (files[0], files[-1]))
    return f"{len(files)} files in {order}, from {first} to {last}"


def join_files(
    path: Path,
    files: Sequence[Path],
    parts: Sequence[npt.NDArray[Any] | Frames],
    *,
    numbers: Sequence[int] | None = None,
    finished: Sequence[bool] | None = None,
) -> npt.NDArray[Any] | Frames:
    """Return the frames of all files as one stack.

    Warns about gaps in the numbers of the files, and about a file with fewer frames than the others
    that is not the last one. If some files are `finished`, it also warns about those that are not.

    Parameters
    ----------
    path : path
        The folder, for messages.
    files : sequence of paths
        The files in the order of their frames.
    parts : sequence of ndarray or Frames
        The frames of each file.
    numbers : sequence of int, optional
        The numbers in the names, which count the files. By default, they are the only numbers in
        which the names differ. They must look as if they counted the files or their frames: their
        most frequent step divides all others.
    finished : sequence of bool, optional
        Whether each file has the end that the camera writes last. Default: unknown.
    """
    if len(files) > 1:
        if numbers is not None:
            _warn_about_gaps(path, files, numbers, 1)
        elif found := _counting_numbers(files):
            _warn_about_gaps(path, files, *found)
        _warn_about_short_files(files, [len(part) for part in parts])
        if finished is not None and any(finished):
            unfinished = list(itertools.compress(files, map(operator.not_, finished)))
            _warn_about(
                unfinished,
                "unlike other files, it does not end with the bytes that the camera writes last",
            )
    return concatenate(parts)


def _counting_numbers(files: Sequence[Path]) -> tuple[list[int], int] | None:
    """Return the numbers in which names differ, and their step, or None if they count nothing.

    Times of images, for example, have no step that divides all others. If more files seem to be
    missing than there are, numbers are dates, times, or exposures.

    Examples
    --------
    >>> _counting_numbers([Path("a_1_x7.png"), Path("a_2_x7.png"), Path("a_5_x7.png")])
    ([1, 2, 5], 1)
    """
    split = [re.split(r"([0-9]+)", file.name) for file in files]
    if len({(*each[::2],) for each in split}) != 1:
        return None
    columns = list(zip(*(map(int, each[1::2]) for each in split), strict=True))
    differing = [column for column in columns if len(set(column)) > 1]
    if len(differing) != 1:
        return None
    numbers = list(differing[0])
    steps = Counter(b - a for a, b in itertools.pairwise(numbers))
    step, times = min(steps.items(), key=lambda each: (-each[1], each[0]))
    if min(steps) < 1 or 2 * times < len(numbers) - 1 or any(each % step for each in steps):
        return None
    missing = (numbers[-1] - numbers[0]) // step + 1 - len(numbers)
    return None if missing > len(numbers) else (numbers, step)


def _warn_about_gaps(path: Path, files: Sequence[Path], numbers: Sequence[int], step: int) -> None:
    gaps = [index for index, (a, b) in enumerate(itertools.pairwise(numbers)) if b - a > step]
    if gaps:
        missing = sum((numbers[index + 1] - numbers[index]) // step - 1 for index in gaps)
        before = files[gaps[0]].relative_to(path).as_posix()
        warn(
            f"{path}: expected {len(files) + missing} files with numbers from {numbers[0]} to "
            f"{numbers[-1]}, got {len(files)}; the first gap is after {before}, so "
            "check whether files are lost"
        )


def _warn_about_short_files(files: Sequence[Path], lengths: Sequence[int]) -> None:
    """Warn about files that hold fewer frames than most others. The last one may be shorter."""
    usual, times = max(Counter(lengths).items(), key=lambda each: (each[1], each[0]))
    if 2 * times < len(files):
        usual = 1  # there is no usual number, but no file should be empty
    short = [index for index, number in enumerate(lengths[:-1]) if number < usual]
    if short:
        text = (
            f"expected at least {counted(usual, 'frame')}, as in other files, got "
            f"{lengths[short[0]]}"
        )
        _warn_about([files[index] for index in short], text)


def _warn_about(files: Sequence[Path], text: str) -> None:
    """Warn about the first one of some files, and state how many others there are."""
    if files:
        others = counted(len(files) - 1, "other file")
        also = f", as may {others}" if len(files) > 1 else ""
        warn(f"{files[0]}: {text}; the file may lack frames{also}")
