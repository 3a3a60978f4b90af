"""Captures at URLs, which are read in ranges or fetched.

The readers of this package expect local files. So a URL is opened as a *stub*: a sparse local file
of the same size that contains only the first and last bytes. :class:`FileReader` and the store of
zarr read all other bytes of a stub from its URL, in ranges. Formats that read files in other ways,
such as archives, get a complete copy in a temporary folder.
"""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from jotlight.formats.locations import import_fsspec

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

_remote: dict[str, "RemoteFile"] = {}
"""The remote file of each stub, by the path of the stub."""


class RemoteFile:
    """A file at a URL.

    Parameters
    ----------
    fs : fsspec.AbstractFileSystem
    path : str
        The path in the file system.
    url : str
        The URL, for messages.
    size : int
        Number of bytes.
    """

    def __init__(self, fs: Any, path: str, url: str, size: int) -> None:
        self._fs, self._path = fs, path
        self.url, self.size = url, size

    def read(self, start: int, stop: int) -> bytes:
        """Return the bytes from `start` to `stop`.

        Raises
        ------
        OSError
            When they cannot be read.
        """
        with explained(self.url):
            data: bytes = self._fs.cat_file(self._path, start=start, end=stop)
        if len(data) != stop - start:
            raise OSError(
                f"{self.url}: expected {stop - start} bytes from {start} on, got {len(data)}; the "
                "file has changed since it was opened, or its server does not support ranges"
            )
        return data


def remote_file(path: Path) -> RemoteFile | None:
    """Return the remote file of a stub, or None for other files."""
    return _remote.get(str(path)) if _remote else None


@contextlib.contextmanager
def explained(url: str) -> Iterator[None]:
    """Raise OSError with the URL for the errors of all file systems.

    Raises
    ------
    FileNotFoundError, PermissionError, OSError
    """
    try:
        yield
    except FileNotFoundError as error:
        raise FileNotFoundError(f"there is no file {url}") from error
    except PermissionError as error:
        raise _denied(url, error) from error
    except (OSError, ValueError) as error:
        if url in str(error):
            raise
        raise OSError(f"{url}: cannot be read ({error})") from error
    except Exception as error:  # each file system has its own errors
        name = type(error).__name__
        if "Credential" in name or "Auth" in name or getattr(error, "status", None) in (401, 403):
            raise _denied(url, error) from error
        if getattr(error, "status", None) == 404:
            raise FileNotFoundError(f"there is no file {url}") from error
        raise OSError(f"{url}: cannot be read ({name}: {error})") from error


def _denied(url: str, error: BaseException) -> PermissionError:
    return PermissionError(
        f"{url}: access was denied ({error}); check the credentials, or pass storage_options= "
        "(--storage-option), such as anon=true for public data on S3"
    )


def open_file_system(url: str, storage_options: Mapping[str, Any] | None) -> tuple[Any, str]:
    """Return the file system of a URL, and the path in it.

    Raises
    ------
    MissingExtraError
        When fsspec, or the package for this kind of URL, is not installed.
    ValueError
        When the kind of URL is unknown.
    """
    from jotlight.errors import MissingExtraError

    fsspec = import_fsspec()
    try:
        fs, path = fsspec.core.url_to_fs(url, **(storage_options or {}))
    except ImportError as error:
        raise MissingExtraError(f"{url}: needs another package: {error}") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{url}: cannot be opened ({error})") from error
    return fs, str(path)


def expand_url(url: str, storage_options: Mapping[str, Any] | None) -> list[str]:
    """Return the URLs that a pattern matches, sorted."""
    fs, path = open_file_system(url, storage_options)
    with explained(url):
        return sorted(fs.unstrip_protocol(each) for each in fs.glob(path))


def url_state(url: str, storage_options: Mapping[str, Any] | None) -> tuple[int, int]:
    """Return the size of the files at a URL, and a number that changes with their content."""
    fs, path = open_file_system(url, storage_options)
    with explained(url):
        info = fs.info(path)
        found = fs.find(path, detail=True) if info.get("type") == "directory" else {path: info}
    facts = sorted(
        (str(name), int(each.get("size") or 0), _tag(each)) for name, each in found.items()
    )
    return sum(size for _, size, _ in facts), _digest(facts)


def _tag(info: Mapping[str, Any]) -> str:
    names = ("ETag", "etag", "LastModified", "mtime", "updated", "last_modified", "md5Hash")
    return str(next((info[name] for name in names if info.get(name)), ""))


def _digest(facts: object) -> int:
    import zlib

    return zlib.crc32(repr(facts).encode())


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
        self._folder = tempfile.TemporaryDirectory(prefix="jotlight-")
        self._stubs: list[str] = []
        with explained(url):
            info = self._fs.info(root)
        folder = Path(self._folder.name)
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
        from jotlight.formats.description import description_path, find_description

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
        self._stubs.append(str(local))
        _remote[str(local)] = file

    def __del__(self) -> None:
        for stub in getattr(self, "_stubs", ()):
            _remote.pop(stub, None)
