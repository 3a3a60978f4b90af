"""Captures at URLs, which are read in ranges or fetched.

The readers of this package expect local files. So a file at a URL is opened as a stub, see
:mod:`jotlight.formats.stubs`. Formats that read files in other ways, such as archives, get a
complete copy in a temporary folder.
"""

import shutil
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from jotlight.formats.description import description_path, find_description
from jotlight.formats.file_systems import explained, open_file_system
from jotlight.formats.stubs import RemoteFile, add_stub, remove_stub

_ENDS_BYTES = 1 << 16
"""Number of bytes at the beginning and the end of a file that a stub contains."""

_MAX_FILES = 1_000_000
"""Maximum number of files in a folder."""

_STUBS = (".npy", ".bin")
"""Endings of files that are read in ranges."""

_METADATA = ("zarr.json", ".zarray", ".zgroup", ".zattrs", "jotlight.json", "transforms.json")
"""Names of files that are fetched from a folder as a whole."""

_FETCHED = (".json", ".npz", ".gz", ".h5", ".hdf5", ".mat", ".png", ".tif", ".tiff")
"""Endings of files that are fetched from a folder as a whole."""


class LocalCopy:
    """The stubs and copies of the files at a URL, in a folder that is deleted with this object.

    Parameters
    ----------
    url : str
    storage_options : mapping, optional
        Options of the file system.
    whole : bool
        Whether the file is fetched as a whole, whatever its ending.

    Raises
    ------
    OSError, ValueError
        When the files cannot be read, or do not fit on the disk.
    """

    def __init__(
        self, url: str, storage_options: Mapping[str, Any] | None = None, *, whole: bool = False
    ) -> None:
        self.url = url
        self._fs, root = open_file_system(url, storage_options)
        folder = Path(tempfile.mkdtemp(prefix="jotlight-"))
        self._stubs: list[Path] = []
        weakref.finalize(self, _delete, folder, self._stubs)
        with explained(url):
            info = self._fs.info(root)
        name = PurePosixPath(root.rstrip("/")).name or "capture"
        self.path = folder / name
        """The local path that stands for the URL."""
        if info.get("type") == "directory" or self._is_zarr(root):
            self._copy_folder(root)
            return
        size = info.get("size")
        if size is None:
            raise OSError(f"{url}: its server does not state the size of the file")
        is_stub = not whole and name.lower().endswith(_STUBS)
        self._copy(root, self.path, int(size), stub=is_stub)
        if name.lower().endswith((".npy", ".npy.gz")):
            self._copy_companions(root)

    def _is_zarr(self, root: str) -> bool:
        with explained(self.url):
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
            fetched = local.name in _METADATA or local.suffix.lower() in _FETCHED
            self._copy(remote, local, int(info.get("size") or 0), stub=not fetched)

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
                size = int(self._fs.info(remote).get("size") or 0) if exists else 0
            if exists:
                self._copy(remote, self.path.with_name(name), size, stub=False)
        description = find_description(self.path)
        for file, _ in description.map_files().values() if description else ():
            relative = file.relative_to(self.path.parent).as_posix()
            with explained(self.url):
                info = self._fs.info(f"{parent}/{relative}")
            file.parent.mkdir(parents=True, exist_ok=True)
            self._copy(f"{parent}/{relative}", file, int(info.get("size") or 0), stub=False)

    def _copy(self, remote: str, local: Path, size: int, *, stub: bool) -> None:
        url = self.url if local == self.path else f"{self.url} ({local.name})"
        file = RemoteFile(self._fs, remote, url, size)
        if not stub or size <= 2 * _ENDS_BYTES:
            if size > shutil.disk_usage(local.parent).free:
                raise OSError(f"{url}: its {size} bytes do not fit in {tempfile.gettempdir()}")
            with explained(url):
                self._fs.get_file(remote, str(local))
            if local.stat().st_size != size:
                raise OSError(f"{url}: expected {size} bytes, got {local.stat().st_size}")
            return
        with local.open("wb") as out:
            out.write(file.read(0, _ENDS_BYTES))
            out.seek(size - _ENDS_BYTES)
            out.write(file.read(size - _ENDS_BYTES, size))
        self._stubs.append(local)
        add_stub(local, file)


def _delete(folder: Path, stubs: list[Path]) -> None:
    """Delete the local copy of a URL."""
    for stub in stubs:
        remove_stub(stub)
    shutil.rmtree(folder, ignore_errors=True)
