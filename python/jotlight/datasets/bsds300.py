"""The photographs of the Berkeley segmentation data set."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.datasets.fetch import RemoteFiles, fetch
from jotlight.images.sets import check_first, read_image_set
from jotlight.paths import as_path
from jotlight.progress import Progress, equal_steps, shown_progress

SITE = (
    "https://raw.githubusercontent.com/BIDS/BSDS500/"
    "a04b7c6c3a9f0ace74bf205c72a43d32e1c72722/BSDS500/data/images"
)
"""A mirror of the BSDS500 release of January 2013, which contains BSDS300."""

REGISTRY = Path(__file__).with_name("bsds300.txt")
"""File with one line per photograph: its name and SHA-256."""

_BSDS300 = {"train": "train", "test": "test"}
_BSDS500 = {"train": "train", "test": "val"}
"""Folder of each split of BSDS300 in BSDS500, whose `test` has 200 other photographs."""

_LAYOUTS = (
    (("bsds300",), _BSDS300),
    (("BSDS300", "images"), _BSDS300),
    (("BSR", "BSDS500", "data", "images"), _BSDS500),
    (("BSDS500", "data", "images"), _BSDS500),
)
"""Layouts of the data: nested folders, and the folder of each split in the innermost one."""


def bsds300(
    split: str,
    folder: str | os.PathLike[str] | None = None,
    *,
    first: int | None = None,
    progress: Progress = False,
) -> tuple[list[str], list[npt.NDArray[np.float32]]]:
    """Return the photographs of BSDS300 in gray, sorted by file name.

    Parameters
    ----------
    split : {"train", "test"}
        ``train`` has 200 photographs, ``test`` has 100.
    folder : path, optional
        A folder that contains one of the following, or one of its inner folders:

        - ``bsds300/{train,test}``,
        - ``BSDS300/images/{train,test}``, the original BSDS300,
        - ``BSR/BSDS500/data/images/{train,val}``, the original BSDS500, whose `val` is the test
          split of BSDS300.

        All images in the folder of the split are read. Default: the files are fetched once (22 MB),
        verified, and stored in the user's cache.
    first : int, optional
        Read only the first `first` images. Default: all.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Returns
    -------
    names : list of str
        The file names.
    images : list of ndarray of float32, shape (321, 481) or (481, 321)
        Intensities in [0, 1]: the luma of ITU-R BT.601 as integer gray levels, divided by 255. They
        are display-encoded, not linear in light.

    Raises
    ------
    FileNotFoundError
        If `folder` does not contain the photographs.
    ConnectionError
        If the files cannot be fetched.
    OSError, ValueError
        If a file cannot be stored or read, or an argument is wrong.

    Warns
    -----
    JotlightWarning
        Before a download: the site, the size, and the terms.

    Notes
    -----
    The data set states no license. For research, cite [1]_ and [2]_.

    References
    ----------
    .. [1] Martin, Fowlkes, Tal, Malik, "A database of human segmented natural images and its
       application to evaluating segmentation algorithms and measuring ecological statistics",
       ICCV 2001.
    .. [2] Arbelaez, Maire, Fowlkes, Malik, "Contour detection and hierarchical image
       segmentation", IEEE TPAMI 33(5), 2011.

    Examples
    --------
    >>> bsds300("val")
    Traceback (most recent call last):
    ValueError: split: expected 'train' or 'test', got 'val'
    """
    if split not in _BSDS300:
        raise ValueError(f"split: expected 'train' or 'test', got {split!r}")
    check_first(first)
    if folder is not None:
        stored = _split_folder(as_path(folder, 'bsds300(folder="photos")'), split)
        return read_image_set(stored, first=first, progress=progress)
    source = _remote_files()
    names = sorted(name for name in source.urls if name.startswith(f"bsds300/{split}/"))[:first]
    with shown_progress(progress, "BSDS300") as update:
        begin = equal_steps(update, 2)
        stored = fetch(source, names, begin("fetching BSDS300")) / "bsds300" / split
        return read_image_set(stored, first=first, progress=begin("reading BSDS300"))


def _split_folder(folder: Path, split: str) -> Path:
    """Return the folder of a split. `folder` may be any of the nested folders of a layout."""
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    path = folder.resolve().parts
    for parts, splits in _LAYOUTS:
        for depth in range(len(parts) + 1):
            # Compare the names of the outer folders: any folder may contain images/train.
            if depth and path[-depth:] != parts[:depth]:
                continue
            candidate = folder.joinpath(*parts[depth:], splits[split])
            if candidate.is_dir():
                return candidate
    layouts = ", ".join("/".join((*parts, splits[split])) for parts, splits in _LAYOUTS)
    raise FileNotFoundError(
        f"{folder}: expected the {split} photographs of BSDS300 in one of {layouts}, found none of "
        "these; pass the folder that contains one, or no folder to fetch them"
    )


def _remote_files() -> RemoteFiles:
    """Return the URLs and hashes of the files, by the names under which they are stored."""
    hashes, urls = {}, {}
    for line in REGISTRY.read_text(encoding="utf-8").splitlines():
        name, sha256 = line.split()
        split, file = name.split("/")
        hashes[f"bsds300/{name}"] = sha256
        urls[f"bsds300/{name}"] = f"{SITE}/{_BSDS500[split]}/{file}"
    return RemoteFiles(
        name="BSDS300",
        site=SITE,
        urls=urls,
        hashes=hashes,
        hashes_in=f"of each file in {REGISTRY}",
        size=22_255_423,
        cite="Martin et al., ICCV 2001, and Arbelaez et al., IEEE TPAMI 33(5), 2011",
    )
