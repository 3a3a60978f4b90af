"""The captures of a run, and the names of their results."""

import dataclasses
import glob
import itertools
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from jotlight.formats.opening.locations import find_matches, is_glob, is_url, without_companions

NAME_PLACE = "{name}"
"""What stands for the name of a capture in the pattern of outputs."""


@dataclasses.dataclass(frozen=True)
class Part:
    """One of several parts of a run, which separate processes compute: `number` of `total`.

    Examples
    --------
    >>> part = Part.parse("3/64")
    >>> part.number, part.total
    (3, 64)
    >>> [Part(1, 2).has(capture, unit=5, captures=2) for capture in (0, 1)]
    [True, False]
    """

    number: int
    total: int

    @classmethod
    def parse(cls, text: str) -> "Part":
        """Return the part of a text such as ``3/64``.

        Raises
        ------
        ValueError
            When the text does not name a part.
        """
        match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text.strip(), re.ASCII)
        if match is None or not 1 <= int(match[1]) <= int(match[2]):
            raise ValueError(
                f"part: expected a part such as 3/64, from 1/64 to 64/64, or slurm, got {text!r}"
            )
        return cls(int(match[1]), int(match[2]))

    @classmethod
    def requested(
        cls, text: str | None, environment: Mapping[str, str] = os.environ
    ) -> "Part | None":
        """Return the part that a text such as ``3/64`` or ``slurm`` requests, or None for all.

        A task of a Slurm job array may be one of many that share the captures, or have captures of
        its own. Nothing but the text says which.

        Raises
        ------
        ValueError
            When the text is no part, or is missing in a job array.

        Examples
        --------
        >>> Part.requested("slurm", {"SLURM_ARRAY_TASK_ID": "7", "SLURM_ARRAY_TASK_MIN": "5",
        ...                          "SLURM_ARRAY_TASK_COUNT": "4"})
        Part(number=3, total=4)
        """
        if text is not None:
            return cls._of_slurm(environment) if text == "slurm" else cls.parse(text)
        total = environment.get("SLURM_ARRAY_TASK_COUNT")
        if environment.get("SLURM_ARRAY_TASK_ID") and total != "1":
            raise ValueError(
                "part: is needed in a Slurm job array; pass --part slurm to divide these captures "
                "among all tasks, or --part 1/1 to process all of them in this task"
            )
        return None

    @classmethod
    def _of_slurm(cls, values: Mapping[str, str]) -> "Part":
        """Return the part of this task of a Slurm job array."""
        task, total = (values.get(f"SLURM_ARRAY_TASK_{name}") for name in ("ID", "COUNT"))
        if not task or not total:
            missing = "COUNT" if task else "ID"
            raise ValueError(
                f"part: expected a Slurm job array for slurm, but SLURM_ARRAY_TASK_{missing} is "
                "not set; pass a part such as --part 3/64"
            )
        first, last = (
            int(values.get(f"SLURM_ARRAY_TASK_{name}", default))
            for name, default in (("MIN", "1"), ("MAX", task))
        )
        step = int(values.get("SLURM_ARRAY_TASK_STEP", "1"))
        if (last - first) // step + 1 > int(total):
            raise ValueError(
                f"part: expected a job array without gaps, such as --array=1-{total}, got {total} "
                f"tasks from {first} to {last}; pass a part such as --part 3/64"
            )
        return cls.parse(f"{(int(task) - first) // step + 1}/{total}")

    def has_capture(self, capture: int, captures: int) -> bool:
        """Return whether the part has units of a capture, by its number among all captures."""
        return not self.divides_captures(captures) or capture % self.total == self.number - 1

    def has(self, capture: int, unit: int, captures: int) -> bool:
        """Return whether the part has a unit of a capture."""
        if self.divides_captures(captures):
            return self.has_capture(capture, captures)
        return (capture + unit) % self.total == self.number - 1

    def divides_captures(self, captures: int) -> bool:
        """Return whether each capture belongs to one part as a whole, if there are enough."""
        return captures >= self.total


def find_captures(
    patterns: Iterable[str], storage_options: dict[str, Any] | None = None
) -> list[str]:
    """Return the captures that paths, URLs, and globs name, without repetition.

    Descriptions and maps that belong to captures are left out. A shell may have named them.

    `storage_options` are those of the file systems of URLs.

    Raises
    ------
    FileNotFoundError
        When a pattern matches nothing.
    """
    found = dict.fromkeys(
        each for pattern in patterns for each in find_matches(pattern, storage_options)
    )
    return without_companions(list(found))


def name_captures(captures: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Return a different name for each capture: its path below a folder, without its ending.

    The folder is the one that all patterns share: of a glob, the folders before the first one with
    a wildcard, and of another path, its own folder. So the name of a capture does not depend on
    which others match, unless they differ only in their endings. Then both keep their endings.

    Raises
    ------
    ValueError
        When a name would lead out of the folder of the results, or two would be equal.

    Examples
    --------
    >>> name_captures(["data/a/1.npy"], ["data/*/*.npy"])
    ['a/1']
    >>> name_captures(["s3://bucket/day/1.npy", "s3://bucket/day/1.bin"], ["s3://bucket/day/*"])
    ['1.npy', '1.bin']
    >>> name_captures(["data/capture.npy"], ["data/capture.npy"])
    ['capture']
    """
    folders = [_fixed_folder(pattern) for pattern in patterns]
    pairs = itertools.takewhile(lambda level: len(set(level)) == 1, zip(*folders, strict=False))
    shared = len(list(pairs))
    # Paths and URLs share no folder.
    names = [PurePosixPath(*_parts(each)[shared or -1 :]) for each in captures]
    for each, name in zip(captures, names, strict=True):
        if ".." in name.parts:
            raise ValueError(f"{each}: expected a path without .. in a run, got {name}")
    short = [name.with_name(_stem(name.name)).as_posix() for name in names]
    found = Counter(short)
    complete = [name.as_posix() for name in names]
    chosen = [
        brief if found[brief] == 1 else name for brief, name in zip(short, complete, strict=True)
    ]
    if len(set(chosen)) < len(chosen):
        chosen = complete
    if twice := [name for name, number in Counter(chosen).items() if number > 1]:
        raise ValueError(
            f"captures: expected different names of files, because paths and URLs share no folder, "
            f"got several {twice[0]}; run them one after the other"
        )
    return chosen


def _fixed_folder(pattern: str) -> tuple[str, ...]:
    """Return the parts of the folder of a path, or of a glob those before the first wildcard."""
    *folder, _ = _parts(pattern)
    if is_glob(pattern):
        folder = list(itertools.takewhile(lambda part: not glob.has_magic(part), folder))
    return tuple(folder)


def _parts(path: str) -> tuple[str, ...]:
    if is_url(path):
        return PurePosixPath(path).parts
    # Without "..", but with symbolic links.
    return PurePosixPath(Path(os.path.normpath(Path(path).absolute())).as_posix()).parts


def _stem(name: str) -> str:
    for ending in (".npy.gz", ".bin.gz"):
        if name.lower().endswith(ending):
            return name[: -len(ending)]
    return PurePosixPath(name).stem


def name_outputs(pattern: Path, names: Sequence[str]) -> list[Path]:
    """Return the path of each result: the pattern, in which ``{name}`` stands for the capture.

    Raises
    ------
    ValueError
        When there are several captures, but the pattern has no place for their names.

    Examples
    --------
    >>> [path.as_posix() for path in name_outputs(Path("films/{name}.zarr"), ["a/1", "b/1"])]
    ['films/a/1.zarr', 'films/b/1.zarr']
    """
    text = pattern.as_posix()
    if NAME_PLACE not in text and len(names) > 1:
        example = pattern.with_name(f"{NAME_PLACE}{pattern.suffix or '.zarr'}")
        raise ValueError(
            f"output: expected a name with {NAME_PLACE} for the {len(names)} captures, such as "
            f"{example}, got {pattern}"
        )
    return [Path(text.replace(NAME_PLACE, name)) for name in names]
