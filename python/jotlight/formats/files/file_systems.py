"""File systems of URLs, which the library fsspec opens."""

import contextlib
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

from jotlight.errors import MissingExtraError, import_extra

_DENIED = 401, 403
"""Statuses with which web servers refuse credentials."""


_TAGS = (
    *("ETag", "etag", "md5Hash", "Content-MD5", "Digest", "Last-Modified", "LastModified"),
    *("last_modified", "mtime", "updated", "created"),
)
"""Names of facts about a file that change with its content. Each file system has its own."""


def import_fsspec() -> Any:
    """Return the library fsspec."""
    return import_extra("fsspec", "dask", "URLs")


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
        # fsspec says so of every error of a web server.
        cause = error.__cause__
        if cause is not None and _status(cause) in _DENIED:
            raise _denied(url, cause) from error
        if cause is None or isinstance(cause, FileNotFoundError) or _status(cause) in (404, 410):
            raise FileNotFoundError(f"there is no file {url}") from error
        raise OSError(f"{url}: cannot be read ({cause})") from error
    except PermissionError as error:
        raise _denied(url, error) from error
    except (OSError, ValueError) as error:
        if url in str(error):
            raise
        raise OSError(f"{url}: cannot be read ({error})") from error
    except Exception as error:  # each file system has its own errors
        name = type(error).__name__
        if "Credential" in name or "Auth" in name or _status(error) in _DENIED:
            raise _denied(url, error) from error
        if _status(error) == 404:
            raise FileNotFoundError(f"there is no file {url}") from error
        raise OSError(f"{url}: cannot be read ({name}: {error})") from error


def _status(error: BaseException) -> object:
    """Return the status of an answer of a web server, or None for other errors."""
    return getattr(error, "status", None)


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
    ImportError
        When that package is installed, but its import fails.
    ValueError
        When the kind of URL is unknown.
    """
    fsspec = import_fsspec()
    try:
        fs, path = fsspec.core.url_to_fs(url, **(storage_options or {}))
    except ImportError as error:
        raise _failed_import(url, error) from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{url}: cannot be opened ({error})") from error
    return fs, str(path)


def _failed_import(url: str, error: ImportError) -> ImportError:
    """Return the error for a URL whose package fsspec cannot import."""
    cause = error.__cause__
    if not isinstance(cause, ModuleNotFoundError):
        return ImportError(f"{url}: an import failed ({cause or error}); repair the installation")
    if cause.name == "s3fs":
        return MissingExtraError(f"{url}: needs s3fs: pip install 'jotlight[s3]'")
    return MissingExtraError(f"{url}: needs the module {cause.name} ({error})")


def expand_url(url: str, storage_options: Mapping[str, Any] | None) -> list[str]:
    """Return the URLs that a pattern matches, sorted."""
    fs, path = open_file_system(url, storage_options)
    with explained(url):
        return sorted(fs.unstrip_protocol(each) for each in fs.glob(path))


def is_remote_folder(fs: Any, path: str) -> bool:
    """Return whether a path is a folder. For HTTP, only a URL that ends with a slash is one."""
    is_web = "http" in (fs.protocol if isinstance(fs.protocol, tuple) else (fs.protocol,))
    return path.endswith("/") if is_web else fs.info(path).get("type") == "directory"


def url_state(url: str, storage_options: Mapping[str, Any] | None) -> tuple[int, int]:
    """Return the size of the files at a URL, and a number that changes with their content."""
    fs, path = open_file_system(url, storage_options)
    with explained(url):
        is_folder = is_remote_folder(fs, path)
        found = fs.find(path, detail=True) if is_folder else {path: current_info(fs, path)}
    facts = _facts(found)
    return sum(size for _, size, _ in facts), _digest(facts)


def find_files(
    url: str, storage_options: Mapping[str, Any] | None = None
) -> list[tuple[str, int, str]]:
    """Return the path, the size, and a tag of the content of all files in a folder, sorted."""
    fs, path = open_file_system(url, storage_options)
    with explained(url):
        found = fs.find(path, detail=True)
    return _facts(found)


def current_info(fs: Any, path: str) -> dict[str, Any]:
    """Return what a file system states about a file now, not what it remembers."""
    fs.invalidate_cache(path)
    return dict(fs.info(path))


def content_tags(info: Mapping[str, Any]) -> dict[str, str]:
    """Return those facts about a file that change with its content, the best ones first.

    Some servers state none.

    Examples
    --------
    >>> content_tags({"size": 3, "LastModified": 7, "ETag": 'W/"5f"'})
    {'ETag': '5f', 'LastModified': '7'}
    """
    # A list of files may mark an ETag in another way than the answer about a single file.
    return {name: str(info[name]).removeprefix("W/").strip('"') for name in _TAGS if info.get(name)}


def _facts(found: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, int, str]]:
    return sorted(
        (str(name), int(each.get("size") or 0), next(iter(content_tags(each).values()), ""))
        for name, each in found.items()
    )


def _digest(facts: object) -> int:
    return zlib.crc32(repr(facts).encode())
