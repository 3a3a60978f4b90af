"""Completion of results whose parts separate processes have made."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from jotlight.errors import error_message
from jotlight.formats.files.safe_paths import check_inside
from jotlight.output_links import follow_link
from jotlight.runs.store import PART, open_unfinished


def find_unfinished(folders: Iterable[Path]) -> list[Path]:
    """Return the folders `NAME.zarr.part` in some folders and below, or these folders themselves.

    If a result in these folders is a symbolic link, its unfinished folder lies where it leads.

    Raises
    ------
    FileNotFoundError
        When a folder does not exist.
    """
    found: dict[Path, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise FileNotFoundError(f"there is no folder {folder}")
        inside = [folder] if folder.name.endswith(PART) else sorted(_find_parts(folder))
        for path in inside:
            if (path / "run.json").is_file():
                found.setdefault(path.parent.resolve() / path.name, path)
    return list(found.values())


def _find_parts(folder: Path) -> Iterator[Path]:
    """Yield the paths in a folder and below whose names are those of unfinished results.

    Also yield those beside the targets of links whose names are those of results.
    """
    for path in folder.rglob("*"):
        if path.name.endswith(PART):
            yield path
        elif path.suffix.lower() == ".zarr" and path.is_symlink():
            own = follow_link(path)
            yield own.with_name(own.name + PART)


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
