"""What an experiment is: settings, parts that are run one by one, and what is shown of them."""

import dataclasses
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight import datasets
from jotlight.experiments.report.section import Section, Value

Row = dict[str, Value]
Image = npt.NDArray[np.float32]
Update = Callable[[float], object]
"""Takes the share of a part that is done."""


class Data:
    """BSDS300 and CIFAR-10, each read once.

    Parameters
    ----------
    folder : Path, optional
        Where they are. Default: they are fetched, once.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._photographs: dict[str, tuple[list[str], list[Image]]] = {}
        self._small: dict[str, Image] = {}

    def photographs(
        self, split: str, first: int | None = None, progress: Update | None = None
    ) -> tuple[list[str], list[Image]]:
        """Names, without ending, and grey images (H, W) of BSDS300."""
        if split not in self._photographs:
            names, images = datasets.bsds300(split, self._folder, progress=progress)
            self._photographs[split] = [Path(name).stem for name in names], images
        names, images = self._photographs[split]
        return names[:first], images[:first]

    def small_images(
        self, split: str, first: int | None = None, progress: Update | None = None
    ) -> Image:
        """Grey images of CIFAR-10 (N, 32, 32)."""
        if split not in self._small:
            self._small[split] = datasets.cifar10(split, self._folder, progress=progress)
        return self._small[split][:first]

    def digest(self, name: str) -> str:
        """Tell a data set: how many images of each split, and a checksum of names and pixels."""
        words = []
        for split in ("train", "test"):
            if name == "bsds300":
                names, images = self.photographs(split)
            else:
                images = list(self.small_images(split))
                names = []
            checksum = zlib.crc32("\n".join(names).encode())
            for image in images:
                checksum = zlib.crc32(image.tobytes(), checksum)
            words.append(f"{len(images)} {split} images ({checksum:08x})")
        return ", ".join(words)

    def read(self, needs: Sequence[str], begin: Callable[[str], Update]) -> None:
        """Read data sets now, so that what lacks is found before any work is done.

        `needs` are "bsds300" and "cifar10"; `begin` is told what is read, and gives the function
        that is told the share of it that is done.
        """
        for name in needs:
            for split in ("train", "test"):
                read = {"bsds300": self.photographs, "cifar10": self.small_images}[name]
                read(split, progress=begin(f"{name}, {split}"))


@dataclasses.dataclass(frozen=True)
class Lab:
    """Where the parts of an experiment are run."""

    settings: Mapping[str, Any]
    """The experiment's `full` or `quick`."""
    folder: Path
    """For networks that later parts need, and checkpoints."""
    data: Data
    threads: int | None = None


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a part found: rows for its experiment's table, and files such as pictures."""

    rows: Sequence[Row]
    files: Mapping[str, bytes] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Part:
    """A piece of work that is not done again once it is done."""

    name: str
    """Also of the file that keeps its outcome."""
    seconds: float
    """About how long it takes on two cores, so that one bar can tell of all parts."""
    run: Callable[[Update], Outcome]


@dataclasses.dataclass(frozen=True)
class Results:
    """What the parts of an experiment found, in their order."""

    settings: Mapping[str, Any]
    rows: Sequence[Row]
    files: Path | None = None
    """The folder of the parts' files; None where only the table was kept."""
    others: Mapping[str, "Results"] = dataclasses.field(default_factory=dict)
    """Those of other experiments, by name, as far as they are there."""

    def where(self, **values: Value) -> list[Row]:
        """Give the rows that have these values."""
        return [row for row in self.rows if all(row[key] == values[key] for key in values)]

    def numbers(self, column: str, **values: Value) -> npt.NDArray[np.float64]:
        """Give a column of the rows that have these values."""
        return np.array([row[column] for row in self.where(**values)], np.float64)

    def distinct(self, column: str) -> list[Any]:
        """Give the values of a column, each once, in their order."""
        return list(dict.fromkeys(row[column] for row in self.rows))


@dataclasses.dataclass(frozen=True)
class Experiment:
    """A figure or table of the paper, or one that it lacks."""

    name: str
    title: str
    full: Mapping[str, Any]
    """All numbers that settle what is done; JSON can hold them."""
    quick: Mapping[str, Any]
    """The same for a look within seconds."""
    parts: Callable[[Lab], list[Part]]
    section: Callable[[Results], Section]
    needs: Sequence[str] = ()
    """Data sets: "bsds300", "cifar10"."""
