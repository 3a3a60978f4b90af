"""Videos and counts of windows as zarr arrays, which many processes write image by image.

While a video is made, it lies in a folder `NAME.zarr.part`:

* `run.json` states what the video is made of, and how. Another run refuses to add to it.
* `video.zarr` is the array. Each image is one chunk, a file that ends in its CRC-32C.
* `groups` has a file for each group of images that is complete.

When all groups are complete, the array receives its record as an attribute and its final name. All
steps can be repeated: a killed run continues where it stopped.
"""

import contextlib
import dataclasses
import json
import math
import os
import shutil
import uuid
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.dask.image_files import is_intact, map_in_threads, write_image
from jotlight.dask.records import ATTRIBUTE, Record, check_same_run, read_json, read_record
from jotlight.dask.streaming import Checksum
from jotlight.files import (
    create_parent,
    explained_creation,
    explained_failure,
    flush_to_disk,
    write_file,
)
from jotlight.formats.safe_paths import check_inside
from jotlight.formats.zarr.writing import import_zarr
from jotlight.temporary_names import reserve_temporary

PART = ".part"
"""Ending of the folder in which an array is made."""


@dataclasses.dataclass(frozen=True)
class VideoStore:
    """One zarr array of images, which may be unfinished.

    Parameters
    ----------
    path : path
        The folder of the array, which ends in `.zarr`.
    run : dict
        What the array is made of, and how. Values that JSON can hold.
    shape : tuple of int
        (N, H, W) or (N, H, W, C).
    dtype : str
        ``"float32"`` or ``"int32"``.
    group : int
        Number of images that are made at a time.
    """

    path: Path
    run: Record
    shape: tuple[int, ...]
    dtype: str
    group: int

    @property
    def part(self) -> Path:
        """The folder in which the array is made."""
        return self.path.with_name(self.path.name + PART)

    @property
    def groups(self) -> int:
        """Number of groups."""
        return -(-self.shape[0] // self.group)

    @property
    def nbytes(self) -> int:
        """Number of bytes of the array."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize

    def is_complete(self) -> bool:
        """Return whether the finished array exists.

        Raises
        ------
        AnotherRunError
            When the array, finished or not, is that of another run.
        ValueError
            When images of the finished array are missing, for example in an interrupted copy.
        """
        if self.path.exists():
            check_same_run(self.path, read_record(self.path).get("run"), self.run)
            self.check_files()
            return True
        if self.part.exists():
            stored = read_json(self.part / "run.json")
            check_same_run(self.part, stored.get("run"), self.run)
        return False

    def check_files(self) -> None:
        """Raise ValueError unless each image of the finished array has a file of its size."""
        expected = self.nbytes // self.shape[0] + 4
        with os.scandir(self.path) as entries:
            sizes = {entry.name: entry.stat().st_size for entry in entries}
        names = map(self._chunk_name, range(self.shape[0]))
        missing = [name for name in names if sizes.get(name) != expected]
        self._refuse_images(missing, "are missing or incomplete")

    def check_images(self, progress: Callable[[float], object] = lambda fraction: None) -> None:
        """Raise ValueError unless each image of the finished array matches its checksum.

        `progress` is called repeatedly with the completed fraction, from 0 to 1.
        """
        self.check_files()
        number, damaged = self.shape[0], []
        paths = (self.path / self._chunk_name(index) for index in range(number))
        for index, intact in enumerate(map_in_threads(self._is_intact, paths)):
            if not intact:
                damaged.append(self._chunk_name(index))
            progress((index + 1) / number)
        self._refuse_images(damaged, "do not match their checksums")

    def _refuse_images(self, names: list[str], reason: str) -> None:
        """Raise ValueError if there are files of images to refuse for a reason."""
        if names:
            raise ValueError(
                f"{self.path}: {len(names)} of its {self.shape[0]} images {reason}, such as "
                f"{names[0]}; restore it from a copy, or delete it to make it again"
            )

    def resumed(self) -> "VideoStore":
        """Return the store with the size of the groups with which the same run began it."""
        if not self.path.exists() and (self.part / "run.json").exists():
            begun = open_unfinished(self.part)
            if (begun.run, begun.shape) == (self.run, self.shape):
                return begun
        return self

    def create(self) -> None:
        """Create the unfinished array, unless it exists. Several processes may do so at once.

        Raises
        ------
        AnotherRunError
            When another run has created it.
        OSError
            When it cannot be written.
        """
        if self.is_complete() or self.part.exists():
            return
        create_parent(self.path)
        with contextlib.ExitStack() as stack:
            with explained_creation(self.path):
                temporary = stack.enter_context(reserve_temporary(self.part))
                temporary.mkdir()
            try:
                with explained_failure(self.path, temporary):
                    self._create_in(temporary)
                temporary.rename(self.part)
            except OSError:
                if not (self.is_complete() or self.part.exists()):
                    raise  # otherwise, another process was faster, with the same run

    def _create_in(self, temporary: Path) -> None:
        """Create the array, and the files that describe it, in a new folder."""
        zarr = import_zarr()
        codecs = zarr.codecs
        (temporary / "groups").mkdir()
        zarr.create_array(
            str(temporary / "video.zarr"),
            shape=self.shape,
            chunks=(1, *self.shape[1:]),
            dtype=self.dtype,
            compressors=[codecs.Crc32cCodec()],
            # Folders for the rows and columns of each image would take as long as counting it.
            chunk_key_encoding={"name": "default", "separator": "."},
        )
        content = {"run": self.run, "group": self.group, "shape": list(self.shape)}
        write_file(temporary / "run.json", json.dumps(content, indent=1), output=self.path)

    def write_image(self, index: int, image: npt.NDArray[Any]) -> None:
        """Write an image. Its file is a chunk of the array.

        The file gets its name when it is whole, so another process that computes the same image,
        or completes the array, never finds a part of it.
        """
        temporary = self.part / f"image-{uuid.uuid4().hex}"
        content = np.ascontiguousarray(image, np.dtype(self.dtype).newbyteorder("<"))
        with explained_failure(self.path, temporary):
            write_image(temporary, content)
            temporary.replace(self._chunk(index))

    def _chunk(self, index: int) -> Path:
        return self.part / "video.zarr" / self._chunk_name(index)

    def _chunk_name(self, index: int) -> str:
        return ".".join(["c", str(index), *["0"] * len(self.shape[1:])])

    def _is_intact(self, path: Path) -> bool:
        return is_intact(path, self.nbytes // self.shape[0])

    @property
    def missing_nbytes(self) -> int:
        """Number of bytes of the groups of images that are not complete."""
        images = sum(len(self.images_of(group)) for group in self.missing())
        return images * (self.nbytes // self.shape[0])

    def images_of(self, group: int) -> range:
        """Return the numbers of the images of a group."""
        first = group * self.group
        return range(first, min(first + self.group, self.shape[0]))

    def mark(self, group: int, facts: Record) -> None:
        """Note that a group is complete. `facts` are its checksum, size, minimum, and maximum.

        Nothing waits for the disk: :meth:`finish` finds what a power failure has damaged.
        """
        # The folder of an interrupted run may come from a stranger.
        marker = check_inside(self._marker(group), self.part)
        write_file(marker, json.dumps(facts), durable=False, output=self.path)

    def missing(self) -> list[int]:
        """Return the numbers of the groups that are not complete."""
        done = {path.stem for path in (self.part / "groups").glob("[0-9]*.json")}
        return [group for group in range(self.groups) if str(group) not in done]

    def finish(self) -> None:
        """Write the record of a complete array, and rename it.

        Raises
        ------
        OSError, ValueError
            When a group is missing or damaged, or a file cannot be written.
        """
        if self.is_complete():
            shutil.rmtree(self.part, ignore_errors=True)
            return
        if missing := self.missing():
            raise ValueError(
                f"{self.part}: {len(missing)} of its {self.groups} groups of images are missing"
            )
        record = {"run": self.run, **_summary(self._checked_facts())}
        zarr = import_zarr()
        array = self.part / "video.zarr"
        with explained_failure(self.path, array):
            zarr.open_array(str(array), mode="r+").attrs[ATTRIBUTE] = record
        files = (Path(folder, name) for folder, _, names in os.walk(array) for name in names)
        for _ in map_in_threads(flush_to_disk, files):
            pass
        try:
            array.rename(self.path)
        except OSError:
            if not self.is_complete():  # another process was faster, with the same run
                raise
        flush_to_disk(self.path.parent)
        shutil.rmtree(self.part, ignore_errors=True)

    def _checked_facts(self) -> list[Record]:
        """Return the facts of all groups, after comparing the checksum of each image."""
        facts, damaged = [], set()
        for group in range(self.groups):
            try:
                facts.append(read_json(self._marker(group)))
            except ValueError:
                damaged.add(group)
        chunks = map(self._chunk, range(self.shape[0]))
        for index, intact in enumerate(map_in_threads(self._is_intact, chunks)):
            if not intact:
                damaged.add(index // self.group)
        for group in damaged:
            self._marker(group).unlink(missing_ok=True)
        if damaged:
            raise ValueError(
                f"{self.part}: {len(damaged)} of its {self.groups} groups of images were damaged, "
                "for example by a power failure; run the command again, which makes them again"
            )
        return facts

    def _marker(self, group: int) -> Path:
        return self.part / "groups" / f"{group}.json"


def open_unfinished(part: Path) -> VideoStore:
    """Return the store of a folder `NAME.zarr.part`.

    Raises
    ------
    OSError, ValueError
        When the folder is damaged, or is something else.
    """
    content = read_json(part / "run.json")
    path = part.with_name(part.name.removesuffix(PART))
    if store := _store(path, content, content.get("run"), content.get("group")):
        return store
    raise ValueError(f"{part}: expected an unfinished video of jotlight; it is damaged")


def open_finished(path: Path) -> VideoStore:
    """Return the store of a finished array, whose images are not checked.

    Raises
    ------
    OSError, ValueError
        When its description is damaged, or is that of something else.
    """
    if store := _store(path, read_json(path / "zarr.json"), read_record(path).get("run"), 1):
        return store
    raise ValueError(f"{path}: expected a video of jotlight; its zarr.json is damaged")


def _store(path: Path, content: Record, run: Any, group: Any) -> VideoStore | None:
    """Return a store whose description has a shape, or None if values are damaged."""
    shape = content.get("shape")
    if (
        isinstance(run, dict)
        and run.get("values") in ("float32", "int32")
        and isinstance(group, int)
        and group > 0
        and isinstance(shape, list)
        and len(shape) in (3, 4)
        and all(isinstance(size, int) and 0 < size < 2**31 for size in shape)
    ):
        return VideoStore(path, run, tuple(shape), run["values"], group)
    return None


def _summary(facts: Iterable[Record]) -> Record:
    """Return the checksum of all frames that were read, and the range of the values."""
    total, low, high = Checksum(), math.inf, -math.inf
    for each in facts:
        total.append(int(each["crc32"], 16), int(each["bytes"]))
        low, high = min(low, each["minimum"]), max(high, each["maximum"])
    return {
        "input": {"packed_bytes": total.size, "packed_crc32": f"{total.value:08x}"},
        "minimum": low,
        "maximum": high,
    }
