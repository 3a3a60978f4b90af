"""The photographs of the Berkeley segmentation data set."""

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.datasets.fetch import Progress, Source, fetched, halves
from jotlight.images.sets import check_first, read_image_set

SITE = (
    "https://raw.githubusercontent.com/BIDS/BSDS500/"
    "a04b7c6c3a9f0ace74bf205c72a43d32e1c72722/BSDS500/data/images"
)
"""BSDS500 holds BSDS300; this is a mirror of its release of January 2013."""

REGISTRY = Path(__file__).with_name("bsds300.txt")
"""File and SHA-256, a line for each."""

_BSDS300 = {"train": "train", "test": "test"}
_BSDS500 = {"train": "train", "test": "val"}
"""Its own `test` holds 200 other photographs."""

_LAYOUTS = (
    (("bsds300",), _BSDS300),
    (("BSDS300", "images"), _BSDS300),
    (("BSR", "BSDS500", "data", "images"), _BSDS500),
    (("BSDS500", "data", "images"), _BSDS500),
)
"""Folders, from the outermost inwards, and the name of each split in the last."""


def bsds300(
    split: str,
    folder: str | os.PathLike[str] | None = None,
    *,
    first: int | None = None,
    progress: Progress | None = None,
) -> tuple[list[str], list[npt.NDArray[np.float32]]]:
    """The photographs of BSDS300 in grey, in the order of their file names.

    Parameters
    ----------
    split : {"train", "test"}
        200 photographs, or 100.
    folder : path, optional
        A folder that holds the data as ``bsds300/{train,test}``, as the original BSDS300
        (``BSDS300/images/{train,test}``) or as the original BSDS500
        (``BSR/BSDS500/data/images/{train,val}``, of which `val` is the test split of BSDS300);
        or one of these inner folders. All pictures of the split's folder are read. Default: they
        are fetched once, 22 MB in all, checked, and kept in the user's cache.
    first : int, optional
        Only so many of them.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    names : list of str
        The file names.
    images : list of ndarray of float32, shape (321, 481) or (481, 321)
        Intensities in [0, 1], the luma of ITU-R BT.601 in whole grey levels over 255. They are
        display-encoded, and not linear in light.

    Raises
    ------
    FileNotFoundError
        When `folder` does not hold them.
    ConnectionError
        When they cannot be fetched.
    OSError, ValueError
        When one cannot be kept or read, or an argument is wrong; the message says which.

    Warns
    -----
    JotlightWarning
        Before anything is fetched: from where, how much, and on what terms.

    Notes
    -----
    No licence is stated; for research, cite [1]_ and [2]_.

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
        return read_image_set(_found(Path(folder), split), first=first, progress=progress)
    source = _source()
    names = sorted(name for name in source.urls if name.startswith(f"bsds300/{split}/"))[:first]
    fetching, reading = halves(progress)
    kept = fetched(source, names, fetching) / "bsds300" / split
    return read_image_set(kept, first=first, progress=reading)


def _found(folder: Path, split: str) -> Path:
    """The folder of a split in one of the layouts, of which `folder` may itself be a part."""
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    inside = folder.resolve().parts
    for parts, splits in _LAYOUTS:
        for known in range(len(parts) + 1):
            # Only below a name of the data set: images/train may hold anything.
            if known and inside[-known:] != parts[:known]:
                continue
            candidate = folder.joinpath(*parts[known:], splits[split])
            if candidate.is_dir():
                return candidate
    layouts = ", ".join("/".join((*parts, splits[split])) for parts, splits in _LAYOUTS)
    raise FileNotFoundError(
        f"{folder}: expected the {split} photographs of BSDS300 in one of {layouts}, found none of "
        "these; give the folder that holds one, or leave it out and they are fetched"
    )


def _source() -> Source:
    """Each file under the name by which it is kept."""
    hashes, urls = {}, {}
    for line in REGISTRY.read_text(encoding="utf-8").splitlines():
        name, sha256 = line.split()
        split, file = name.split("/")
        hashes[f"bsds300/{name}"] = sha256
        urls[f"bsds300/{name}"] = f"{SITE}/{_BSDS500[split]}/{file}"
    return Source(
        name="BSDS300",
        site=SITE,
        urls=urls,
        hashes=hashes,
        hashes_in=f"of each file in {REGISTRY}",
        size=22_255_423,
        cite="Martin et al., ICCV 2001, and Arbelaez et al., IEEE TPAMI 33(5), 2011",
    )
