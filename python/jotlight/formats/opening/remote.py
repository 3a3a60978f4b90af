"""Captures at URLs, which are read in ranges or fetched.

The readers of this package expect local files. So a file at a URL is opened as a stub, see
:mod:`jotlight.formats.files.remote_files`. Descriptions, and streams of gzip, which can only be
read from their beginning, are copied into a temporary folder.
"""

import contextlib
import shutil
import tempfile
import weakref
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from jotlight.formats.files.file_systems import (
    current_info,
    explained,
    is_remote_folder,
    open_file_system,
)
from jotlight.formats.files.remote_files import RemoteFile, add_stub, remove_stubs
from jotlight.formats.npy.description import description_path, find_description

_MAX_FILES = 1_000_000
"""Maximum number of files in a folder."""

_METADATA = ("zarr.json", ".zarray", ".zgroup", ".zattrs", "jotlight.json", "transforms.json")
"""Names of descriptions, which are fetched as a whole."""

_FETCHED = (".json", ".gz")
"""Endings of other files that are fetched as a whole."""


class LocalCopy:
    """The stubs and copies of the files at a URL, in a folder that is deleted with this object.

    Parameters
    ----------
    url : str
    storage_options : mapping, optional
        Options of the file system.

    Raises
    ------
    OSError, ValueError
        When the files cannot be read, or do not fit on the disk.
    """

    def __init__(self, url: str, storage_options: Mapping[str, Any] | None = None) -> None:
        self.url = url
        self._fs, root = open_file_system(url, storage_options)
        folder = Path(tempfile.mkdtemp(prefix="jotlight-"))
        self._stubs: list[Path] = []
        weakref.finalize(self, _delete, folder, self._stubs)
        name = PurePosixPath(root.rstrip("/")).name or "capture"
        self.path = folder / name
        """The local path that stands for the URL."""
        with explained(url):
            is_folder = is_remote_folder(self._fs, root) or self._is_zarr(root)
        if is_folder:
            self._copy_folder(root)
            return
        self._copy(root, self.path)
        if name.lower().endswith((".npy", ".npy.gz")):
            self._copy_companions(root)

    @contextlib.contextmanager
    def named_in_errors(self) -> Iterator[None]:
        """Raise errors of the block that name the URL in place of the local path."""

        def named(text: object) -> str:
            return str(text).replace(str(self.path), self.url)

        try:
            yield
        except (OSError, ValueError) as error:
            if isinstance(error, OSError) and error.filename is not None:
                error.filename = named(error.filename)
            else:
                error.args = (named(error),)
            raise

    def _is_zarr(self, root: str) -> bool:
        return any(self._fs.exists(f"{root.rstrip('/')}/{name}") for name in _METADATA[:3])

    def _copy_folder(self, root: str) -> None:
        with explained(self.url):
            found = self._fs.find(root, detail=True)
        if len(found) > _MAX_FILES:
            raise ValueError(f"{self.url}: expected at most {_MAX_FILES} files, got more")
        self.path.mkdir()
        base = root.rstrip("/") + "/"
        for remote, info in sorted(found.items()):
            relative = PurePosixPath(str(remote).removeprefix(base))
            if relative.is_absolute() or ".." in relative.parts:
                raise ValueError(f"{self.url}: the name {relative} leads out of the folder")
            local = self.path / relative
            local.parent.mkdir(parents=True, exist_ok=True)
            self._copy(remote, local, info)

    def _copy_companions(self, root: str) -> None:
        """Fetch the description beside a cube, and the maps that it names."""
        names = [description_path(self.path).name]
        if self.path.suffix.lower() == ".gz":
            names.append(description_path(self.path.with_suffix("")).name)
        parent = root.rpartition("/")[0]
        for name in names:
            remote = f"{parent}/{name}"
            with explained(self.url):
                exists = self._fs.exists(remote)
            if exists:
                self._copy(remote, self.path.with_name(name))
        description = find_description(self.path)
        for file, _ in description.map_files().values() if description else ():
            relative = file.relative_to(self.path.parent).as_posix()
            file.parent.mkdir(parents=True, exist_ok=True)
            self._copy(f"{parent}/{relative}", file)

    def _copy(self, remote: str, local: Path, info: Mapping[str, Any] | None = None) -> None:
        """Fetch a file, or make a stub of it."""
        url = self.url if local == self.path else f"{self.url} ({local.name})"
        if info is None or info.get("size") is None:
            with explained(url):
                info = current_info(self._fs, remote)
        file = RemoteFile(self._fs, remote, url, info)
        size = file.size
        if local.name not in _METADATA and not local.name.lower().endswith(_FETCHED):
            self._stubs.append(local)
            add_stub(local, file)
            return
        if size > shutil.disk_usage(local.parent).free:
            raise OSError(f"{url}: its {size} bytes do not fit in {tempfile.gettempdir()}")
        with explained(url):
            self._fs.get_file(remote, str(local))
        if local.stat().st_size != size:
            raise OSError(f"{url}: expected {size} bytes, got {local.stat().st_size}")
        file.check_unchanged()


def _delete(folder: Path, stubs: list[Path]) -> None:
    """Delete the local copy of a URL."""
    remove_stubs(stubs)
    shutil.rmtree(folder, ignore_errors=True)
