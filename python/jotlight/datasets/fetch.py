"""Download files once, verify their SHA-256, and store them in the user's cache."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from jotlight.errors import warn
from jotlight.files import atomic_write
from jotlight.output_files import open_output

Progress = Callable[[float], object]
"""A function that takes the finished share of the work, from 0 to 1."""

_INSTEAD = (
    "or, if you have the data, pass their folder (folder= in Python, --data DIR on the command "
    "line)"
)


@dataclasses.dataclass(frozen=True)
class RemoteFiles:
    """The files of a data set on the Internet."""

    name: str
    site: str
    """The site, for the message to the user."""
    urls: Mapping[str, str]
    """The URL of each file, by the name under which it is stored."""
    hashes: Mapping[str, str]
    """The SHA-256 of each file, by the same names."""
    hashes_in: str
    """Where the user finds the hashes."""
    size: int
    """Total size in bytes."""
    cite: str
    """The publication to cite."""


def cache_folder() -> Path:
    """Return the user's folder for downloads."""
    import pooch

    return Path(pooch.os_cache("jotlight"))


def fetch(source: RemoteFiles, names: Iterable[str], progress: Progress | None = None) -> Path:
    """Return the folder of the files, after fetching those that are missing.

    A warning before the download states what is fetched, from where, and the terms. A file is
    stored only if it is complete and has the correct SHA-256.

    Parameters
    ----------
    source : RemoteFiles
        The data set.
    names : iterable of str
        The files to fetch.
    progress : callable, optional
        Called with the completed fraction, 0 to 1.

    Returns
    -------
    Path
        The folder that contains `names`.

    Raises
    ------
    ConnectionError
        If a file cannot be fetched.
    OSError
        If it cannot be stored.
    ValueError
        If its SHA-256 is wrong.
    """
    import pooch

    folder = cache_folder()
    missing = [name for name in names if not _is_stored(folder / name, source.hashes[name])]
    if missing:
        _warn_about_download(source, missing, folder)
        for number, name in enumerate(missing):
            bar = _Bar(progress, number, len(missing))
            # The default chunks of 1 KiB are slow.
            http = pooch.HTTPDownloader(progressbar=bar, chunk_size=1 << 16, timeout=30)
            _fetch_file(source, name, folder / name, http)
            bar.update(bar.total)
    return folder


def _is_stored(path: Path, sha256: str) -> bool:
    import pooch

    return path.is_file() and pooch.file_hash(str(path)) == sha256


def _warn_about_download(source: RemoteFiles, missing: list[str], folder: Path) -> None:
    size = source.size * len(missing) / len(source.urls) / 1e6
    what = "1 file" if len(missing) == 1 else f"{len(missing)} files"
    warn(
        f"fetching {source.name}: {what}, about {size:.3g} MB, from {source.site}; SHA-256: "
        f"{source.hashes_in}; terms: no license stated; for research, cite {source.cite}; "
        f"stored in {folder}"
    )


def _fetch_file(source: RemoteFiles, name: str, path: Path, http: Any) -> None:
    # pooch depends on requests.
    from requests import RequestException

    url = source.urls[name]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            with open_output(temporary) as file:
                http(url, file, None)
            if not _is_stored(temporary, source.hashes[name]):
                raise ValueError(f"{path}: another file")
    except RequestException as error:
        raise ConnectionError(
            f"{source.name}: could not fetch {url} ({_reason(error)}); try again later, {_INSTEAD}"
        ) from error
    except OSError as error:
        reason = str(error.strerror or error)
        if str(path) not in reason:
            reason = f"cannot write {path}: {reason}"
        raise type(error)(
            f"{source.name}: {reason}; free some space or repair the folder, {_INSTEAD}"
        ) from error
    except ValueError as error:
        raise ValueError(
            f"{source.name}: expected {url} with the SHA-256 {source.hashes[name]}, but got "
            f"another file, which was not stored; try again, {_INSTEAD}"
        ) from error


def _reason(error: Any) -> str:
    """Return the innermost reason of an error."""
    if error.response is not None:
        return f"the server answered {error.response.status_code} {error.response.reason}"
    inner: object = error
    while isinstance(inner, Exception):
        error = inner
        inner = getattr(error, "reason", None) or (error.args[-1] if error.args else None)
    return str(error).rsplit(": ", 1)[-1]


class _Bar:
    """A progress bar for pooch that reports the completed fraction of all files."""

    total = 0

    def __init__(self, progress: Progress | None, number: int, files: int) -> None:
        self._progress, self._number, self._files = progress, number, files
        self._so_far = 0

    def update(self, amount: int) -> None:
        self._so_far += amount
        fraction = min(1.0, self._so_far / self.total) if self.total else 0.0
        if self._progress:
            self._progress((self._number + fraction) / self._files)

    def reset(self) -> None:
        """Do nothing. pooch calls this method at the end."""

    def close(self) -> None:
        """Do nothing. pooch calls this method at the end."""
