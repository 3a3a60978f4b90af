"""Files from the network: fetched once, checked by their SHA-256, and kept."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from jotlight.errors import warn

Progress = Callable[[float], object]

_INSTEAD = (
    "or, if you have the data, give their folder (folder= in Python, --data DIR on the command "
    "line)"
)


@dataclasses.dataclass(frozen=True)
class Source:
    """A data set on the network, as it is told to the user and checked."""

    name: str
    site: str
    """Where it is, for people to read."""
    urls: Mapping[str, str]
    """Where each file comes from, by the name under which it is kept."""
    hashes: Mapping[str, str]
    """The SHA-256 of each, by the same names."""
    hashes_in: str
    """Where these can be read."""
    size: int
    """Bytes of all files."""
    cite: str


def kept_in() -> Path:
    """The user's folder for what is fetched."""
    import pooch

    return Path(pooch.os_cache("jotlight"))


def fetched(source: Source, names: Iterable[str], progress: Progress | None = None) -> Path:
    """Fetch what is not there yet, after a warning that says what, from where and on what terms.

    Each file appears whole and with the right SHA-256, or not at all.

    Parameters
    ----------
    source : Source
        The data set.
    names : iterable of str
        The files that are wanted.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Path
        The folder under which `names` now are.

    Raises
    ------
    ConnectionError
        When a file cannot be fetched.
    OSError
        When it cannot be kept.
    ValueError
        When what came is not the file that was expected.
    """
    import pooch

    folder = kept_in()
    missing = [name for name in names if not _is_there(folder / name, source.hashes[name])]
    if missing:
        _tell(source, missing, folder)
        keeper = pooch.create(
            path=folder, base_url="", registry=dict(source.hashes), urls=dict(source.urls)
        )
        # Its announcements of each file would come between ours and the bar.
        logger = pooch.get_logger()
        level = logger.level
        logger.setLevel("WARNING")
        try:
            for number, name in enumerate(missing):
                bar = _Bar(progress, number, len(missing))
                # Its own chunks of 1 KiB are slow.
                http = pooch.HTTPDownloader(progressbar=bar, chunk_size=1 << 16, timeout=30)
                _fetch(keeper, source, name, http)
                bar.update(bar.total)
        finally:
            logger.setLevel(level)
    return folder


def _is_there(path: Path, sha256: str) -> bool:
    import pooch

    return path.is_file() and pooch.file_hash(str(path)) == sha256


def _tell(source: Source, missing: list[str], folder: Path) -> None:
    size = source.size * len(missing) / len(source.urls) / 1e6
    what = "1 file" if len(missing) == 1 else f"{len(missing)} files"
    warn(
        f"fetching {source.name}: {what}, about {size:.3g} MB, from {source.site}; SHA-256: "
        f"{source.hashes_in}; terms: no licence stated, for research, cite {source.cite}; "
        f"kept in {folder}"
    )


def _fetch(keeper: Any, source: Source, name: str, http: object) -> None:
    # pooch brings requests.
    from requests import RequestException

    url, path = source.urls[name], keeper.path / name
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        keeper.fetch(name, downloader=http)
    except RequestException as error:
        raise ConnectionError(
            f"{source.name}: could not fetch {url} ({_reason(error)}); try again later, {_INSTEAD}"
        ) from error
    except OSError as error:
        raise type(error)(
            f"{source.name}: cannot keep {path} ({error.strerror or error}); make room or "
            f"mend the folder, {_INSTEAD}"
        ) from error
    except ValueError as error:
        raise ValueError(
            f"{source.name}: expected {url} with the SHA-256 {source.hashes[name]}, but another "
            f"file came, and was not kept; try again, {_INSTEAD}"
        ) from error


def _reason(error: Any) -> str:
    """What went wrong, without the layers of objects that passed it on."""
    if error.response is not None:
        return f"the server answered {error.response.status_code} {error.response.reason}"
    inner: object = error
    while isinstance(inner, Exception):
        error = inner
        inner = getattr(error, "reason", None) or (error.args[-1] if error.args else None)
    return str(error).rsplit(": ", 1)[-1]


class _Bar:
    """What pooch takes for a bar of one file, turned into the share of all files."""

    total = 0

    def __init__(self, progress: Progress | None, number: int, files: int) -> None:
        self._progress, self._number, self._files = progress, number, files
        self._so_far = 0

    def update(self, amount: int) -> None:
        self._so_far += amount
        share = min(1.0, self._so_far / self.total) if self.total else 0.0
        if self._progress:
            self._progress((self._number + share) / self._files)

    def reset(self) -> None:
        """Nothing: pooch calls it at the end, only to fill the bar."""

    def close(self) -> None:
        """Nothing."""


def halves(progress: Progress | None) -> tuple[Progress | None, Progress | None]:
    """Progress of fetching and of reading, out of that of both."""
    if progress is None:
        return None, None
    told = progress
    return lambda share: told(share / 2), lambda share: told((1 + share) / 2)
