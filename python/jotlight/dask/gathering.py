"""Completion of results whose parts separate processes have made."""

from collections.abc import Callable, Iterable
from pathlib import Path

from jotlight.dask.store import PART, open_unfinished
from jotlight.errors import error_message
from jotlight.formats.files.safe_paths import check_inside


def find_unfinished(folders: Iterable[Path]) -> list[Path]:
    """Return the folders `NAME.zarr.part` in some folders and below, or these folders themselves.

    Raises
    ------
    FileNotFoundError
        When a folder does not exist.
    """
    found: dict[Path, None] = {}
    for folder in folders:
        if not folder.is_dir():
            raise FileNotFoundError(f"there is no folder {folder}")
        inside = [folder] if folder.name.endswith(PART) else sorted(folder.rglob(f"*{PART}"))
        found |= dict.fromkeys(path for path in inside if (path / "run.json").is_file())
    return list(found)


def gather_results(
    parts: Iterable[Path], progress: Callable[[float], object] = lambda fraction: None
) -> tuple[list[Path], dict[Path, str]]:
    """Complete unfinished results. Return those that are complete, and the reasons for the others.

    Parameters
    ----------
    parts : iterable of paths
        Folders of unfinished results.
    progress : callable, optional
        A function that is called repeatedly with the completed fraction, from 0 to 1.
    """
    finished, unfinished = [], {}
    paths = list(parts)
    for index, path in enumerate(paths):
        try:
            store = open_unfinished(check_inside(path, path.parent))
            if missing := store.groups - len(store.markers.done()):
                unfinished[path] = f"{missing} of its {store.groups} groups are missing"
            else:
                store.finish()
                finished.append(store.path)
        except (OSError, ValueError) as error:
            unfinished[path] = error_message(error)
        progress((index + 1) / len(paths))
    return finished, unfinished
