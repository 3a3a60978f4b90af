"""What an experiment is: settings, parts that run one by one, and a section of the report."""

import dataclasses
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.datasets import bsds300, cifar10
from jotlight.datasets.fetch import Progress
from jotlight.experiments.report.content import Section, Value

Row = dict[str, Value]


class Data:
    """BSDS300 and CIFAR-10, each read once.

    Parameters
    ----------
    folder : Path, optional
        The folder that holds them. By default they are downloaded once.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        self._bsds300: dict[str, tuple[list[str], list[Image]]] = {}
        self._cifar10: dict[str, Image] = {}

    def bsds300(
        self, split: str, first: int | None = None, progress: Progress | None = None
    ) -> tuple[list[str], list[Image]]:
        """Return names, without extension, and gray images (H, W) of BSDS300."""
        if split not in self._bsds300:
            names, images = bsds300(split, self._folder, progress=progress)
            self._bsds300[split] = [Path(name).stem for name in names], images
        names, images = self._bsds300[split]
        return names[:first], images[:first]

    def cifar10(
        self, split: str, first: int | None = None, progress: Progress | None = None
    ) -> Image:
        """Return gray images (N, 32, 32) of CIFAR-10."""
        if split not in self._cifar10:
            self._cifar10[split] = cifar10(split, self._folder, progress=progress)
        return self._cifar10[split][:first]

    def digest(self, name: str) -> str:
        """Return the number of images of each split and a checksum of names and pixels."""
        digests = []
        for split in ("train", "test"):
            if name == "bsds300":
                names, images = self.bsds300(split)
            else:
                images = list(self.cifar10(split))
                names = []
            checksum = zlib.crc32("\n".join(names).encode())
            for image in images:
                checksum = zlib.crc32(image.tobytes(), checksum)
            digests.append(f"{len(images)} {split} images ({checksum:08x})")
        return ", ".join(digests)

    def load(self, names: Sequence[str], begin: Callable[[str], Progress]) -> None:
        """Read data sets at once, so missing files are found before any work is done.

        Parameters
        ----------
        names : sequence of str
            "bsds300" and "cifar10".
        begin : callable
            Takes a title and returns the function that takes the finished share.
        """
        for name in names:
            read = {"bsds300": self.bsds300, "cifar10": self.cifar10}[name]
            for split in ("train", "test"):
                read(split, progress=begin(f"{name}, {split}"))


@dataclasses.dataclass(frozen=True)
class RunContext:
    """What the parts of an experiment work with."""

    settings: Mapping[str, Any]
    """The experiment's full or quick settings."""
    folder: Path
    """The folder for checkpoints and for networks that later parts need."""
    data: Data
    threads: int | None = None
    own: Sequence[str] = ()
    """Functions of the caller to compare, each as ``MODULE:FUNCTION``."""


@dataclasses.dataclass(frozen=True)
class PartResult:
    """What a part returns: rows of its experiment's table, and files such as images."""

    rows: Sequence[Row]
    files: Mapping[str, bytes] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Part:
    """A piece of work that runs once."""

    name: str
    """The part's name and that of the file that keeps its result."""
    seconds: float
    """Approximate duration on two cores, for a progress bar over all parts."""
    run: Callable[[Progress], PartResult]


@dataclasses.dataclass(frozen=True)
class Results:
    """The rows that the parts of an experiment returned, in their order."""

    settings: Mapping[str, Any]
    rows: Sequence[Row]
    files: Path | None = None
    """The folder of the parts' files, or None where only the table was kept."""
    others: Mapping[str, "Results"] = dataclasses.field(default_factory=dict)
    """The results of other experiments, by name, where they exist."""

    def rows_where(self, **values: Value) -> list[Row]:
        """Return the rows with these values."""
        return [row for row in self.rows if all(row[key] == values[key] for key in values)]

    def column(self, name: str, /, **values: Value) -> npt.NDArray[np.float64]:
        """Return a column of the rows with these values."""
        return np.array([row[name] for row in self.rows_where(**values)], np.float64)

    def unique(self, name: str) -> list[Any]:
        """Return the different values of a column, in the order of their first rows."""
        return list(dict.fromkeys(row[name] for row in self.rows))


@dataclasses.dataclass(frozen=True)
class Experiment:
    """A figure or table of the paper, or a further comparison.

    Parameters
    ----------
    name : str
        Its name on the command line.
    title : str
        Its title in the report.
    full_settings : dict
        Every number that determines the results. JSON can hold them.
    quick_settings : dict
        The same for a run of seconds.
    parts : callable
        A function from a run to its parts.
    section : callable
        A function from the results to a section of the report.
    compares_methods : bool
        Whether it compares all methods, and so those of the caller, too.
    datasets : sequence of str
        The data sets that the parts read: "bsds300", "cifar10".
    """

    name: str
    title: str
    full_settings: Mapping[str, Any]
    quick_settings: Mapping[str, Any]
    parts: Callable[[RunContext], list[Part]]
    section: Callable[[Results], Section]
    compares_methods: bool = False
    datasets: Sequence[str] = ()


def command_of(name: str, settings: Mapping[str, Any]) -> str:
    """Return the command that repeats the run of an experiment with some settings.

    Examples
    --------
    >>> command_of("fig7", {"quick": True, "methods": {"mine:denoise": "5c1f"}})
    'jotlight reproduce fig7 --quick --method mine:denoise'
    """
    options = ["--quick"] if settings["quick"] else []
    options += [f"--method {method}" for method in settings.get("methods", ())]
    return " ".join(["jotlight reproduce", name, *options])
