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
import uuid
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.files import create_parent, flush_to_disk, write_file
from jotlight.formats.files.safe_paths import check_inside
from jotlight.output_links import follow_link
from jotlight.runs.image_files import ImageFiles, write_image
from jotlight.runs.markers import Markers, summarize
from jotlight.runs.records import ATTRIBUTE, Record, check_same_run, read_json, read_record
from jotlight.temporary_names import reserve_temporary
from jotlight.write_errors import explained_creation, explained_failure

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
    def markers(self) -> Markers:
        """The files that note which groups are complete."""
        return Markers(self.part, self.groups)

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
        if not self.part.exists():
            return False
        try:
            stored = read_json(check_inside(self.part / "run.json", self.part))
        except FileNotFoundError as error:
            if not self.part.exists():  # another process has completed the video meanwhile
                return self.is_complete()
            raise ValueError(
                f"{self.part}: expected a file run.json in it; delete it to make the video again"
            ) from error
        check_same_run(self.part, stored.get("run"), self.run)
        return False

    def check_files(self) -> None:
        """Raise ValueError unless each image of the finished array has a file of its size."""
        self._files(self.path).check_sizes()

    def check_images(self, progress: Callable[[float], object] = lambda fraction: None) -> None:
        """Raise ValueError unless each image of the finished array matches its checksum.

        `progress` is called repeatedly with the completed fraction, from 0 to 1.
        """
        self._files(self.path).check_checksums(progress)

    def resumed(self) -> "VideoStore":
        """Return the store with the size of the groups with which the same run began it.

        If the path is a symbolic link, the store lies where it leads.
        """
        store = dataclasses.replace(self, path=follow_link(self.path))
        if not store.path.exists() and (store.part / "run.json").exists():
            begun = open_unfinished(store.part)
            if (begun.run, begun.shape) == (self.run, self.shape):
                return begun
        return store

    def create(self) -> None:
        """Create the unfinished array, unless it exists. Several processes may do so at once.

        Raises
        ------
        AnotherRunError
            When another run has created it.
        OSError
            When it cannot be written.
        """
        if self.is_complete():
            return
        if self.part.exists():
            self._check_folders()
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
        (temporary / "groups").mkdir()
        (temporary / "video.zarr").mkdir()
        description = self._files(temporary / "video.zarr").describe({})
        write_file(temporary / "video.zarr" / "zarr.json", description, output=self.path)
        content = {"run": self.run, "group": self.group, "shape": list(self.shape)}
        write_file(temporary / "run.json", json.dumps(content, indent=1), output=self.path)

    def write_image(self, index: int, image: npt.NDArray[Any]) -> None:
        """Write an image. Its file is a chunk of the array."""
        content = np.ascontiguousarray(image, np.dtype(self.dtype).newbyteorder("<"))
        with self._temporary_file() as temporary:
            write_image(temporary, content)
            temporary.replace(self._files(self._array()).path(index))

    @contextlib.contextmanager
    def _temporary_file(self) -> Iterator[Path]:
        """Yield the path of a new file, which the block renames into the array when it is whole.

        So another process that writes the same file, or completes the array, never finds a part of
        it.
        """
        temporary = self.part / uuid.uuid4().hex
        try:
            with explained_failure(self.path, temporary):
                yield temporary
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise

    def _array(self) -> Path:
        """Return the unfinished array. Its folder may come from a stranger."""
        return check_inside(self.part / "video.zarr", self.part)

    def _check_folders(self) -> None:
        """Raise ValueError unless the folders of the unfinished video exist, and are no links."""
        # A link would get the final name of the array, and its target would be deleted.
        for folder in (self.part / "groups", self.part / "video.zarr"):
            check_inside(folder, self.part)
            is_usable = folder.is_dir() and not folder.is_symlink()
            if not (is_usable or self.is_complete()):  # another process may have completed it
                raise ValueError(
                    f"{self.part}: expected a folder {folder.name} in it, which is no link; "
                    "delete it to make the video again"
                )

    def _files(self, array: Path) -> ImageFiles:
        return ImageFiles(array, self.shape, self.dtype)

    @property
    def missing_nbytes(self) -> int:
        """Number of bytes of the groups of images that are not complete."""
        images = sum(len(self.images_of(group)) for group in self.missing())
        return images * (self.nbytes // self.shape[0])

    def images_of(self, group: int) -> range:
        """Return the numbers of the images of a group."""
        return range(self.shape[0])[group * self.group : (group + 1) * self.group]

    def mark(self, group: int, facts: Record) -> None:
        """Note that a group is complete. `facts` are its checksum, size, minimum, and maximum.

        Nothing waits for the disk: :meth:`finish` finds what a power failure has damaged.
        """
        self.markers.write(group, facts, self.path)

    def missing(self) -> list[int]:
        """Return the numbers of the groups that are not complete."""
        done = self.markers.done()
        return [group for group in range(self.groups) if group not in done]

    def finish(self) -> None:
        """Write the record of a complete array, and rename it.

        Raises
        ------
        OSError, ValueError
            When a group is missing or damaged, or a file cannot be written.
        """
        if self.is_complete():
            self._delete_part()
            return
        self._check_folders()
        if missing := self.groups - len(self.markers.done()):
            raise ValueError(
                f"{self.part}: {missing} of its {self.groups} groups of images are missing"
            )
        array = self._array()
        self._write_record({"run": self.run, **summarize(self._checked_facts(array))}, array)
        self._files(array).flush()
        try:
            array.rename(self.path)
        except OSError:
            if not self.is_complete():  # another process was faster, with the same run
                raise
        flush_to_disk(self.path.parent)
        self._delete_part()

    def _delete_part(self) -> None:
        """Delete the folder of the unfinished video.

        It loses its name first, so that no other process with the same run adds files to it.
        """
        with contextlib.suppress(OSError), reserve_temporary(self.part) as temporary:
            self.part.rename(temporary)

    def _write_record(self, record: Record, array: Path) -> None:
        """Replace the description of an array by one that has a record as an attribute."""
        with self._temporary_file() as temporary:
            temporary.write_bytes(self._files(array).describe({ATTRIBUTE: record}))
            flush_to_disk(temporary)
            temporary.replace(array / "zarr.json")

    def _checked_facts(self, array: Path) -> list[Record]:
        """Return the facts of all groups, after comparing the checksum of each image."""
        files = self._files(array)
        found = sorted(files.find())
        intact = Counter(
            index // self.group
            for index, is_whole in zip(found, files.are_intact(found), strict=True)
            if is_whole
        )
        facts, damaged = [], []
        for group in range(self.groups):
            known = self.markers.read(group)
            if known is None or intact[group] < len(self.images_of(group)):
                damaged.append(group)
            else:
                facts.append(known)
        for group in damaged:
            self.markers.delete(group)
        if damaged:
            raise ValueError(
                f"{self.part}: {len(damaged)} of its {self.groups} groups of images were damaged, "
                "for example by a power failure; run the command again, which makes them again"
            )
        return facts


def open_unfinished(part: Path) -> VideoStore:
    """Return the store of a folder `NAME.zarr.part`.

    Raises
    ------
    OSError, ValueError
        When the folder is damaged, or is something else.
    """
    content = read_json(check_inside(part / "run.json", part))
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
        and type(group) is int
        and group > 0
        and isinstance(shape, list)
        and len(shape) in (3, 4)
        and all(type(size) is int and 0 < size < 2**31 for size in shape)
    ):
        return VideoStore(path, run, tuple(shape), run["values"], group)
    return None
