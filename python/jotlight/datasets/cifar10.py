"""The small images of CIFAR-10."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.datasets import cifar10_files
from jotlight.datasets.fetch import RemoteFiles, fetch
from jotlight.images.sets import check_first
from jotlight.paths import as_path
from jotlight.progress import Progress, equal_steps, shown_progress

SITE = "https://www.cs.toronto.edu/~kriz"
SHA256 = "c4a38c50a1bc5f3a1c5537f2155ab9d68f9f25eb1ed8d9ddda3db29a59bca1dd"
"""SHA-256 of the archive of the binary version."""

_FILES = {
    "train": tuple(f"data_batch_{number}" for number in range(1, 6)),
    "test": ("test_batch",),
}


def cifar10(
    split: str,
    folder: str | os.PathLike[str] | None = None,
    *,
    first: int | None = None,
    progress: Progress = False,
) -> npt.NDArray[np.float32]:
    """Return the images of CIFAR-10 in gray, in their official order.

    Parameters
    ----------
    split : {"train", "test"}
        ``train`` has 50,000 images, ``test`` has 10,000.
    folder : path, optional
        A folder with the data in one of these forms, or the inner folder itself. The first form
        found is read:

        - the original binary version, ``cifar-10-batches-bin/{data_batch_1..5,test_batch}.bin``,
        - the original Python version, ``cifar-10-batches-py/{data_batch_1..5,test_batch}``. These
          files are pickles; they are searched for the pixels and never unpickled,
        - ``cifar-10-binary.tar.gz``, read without unpacking,
        - ``cifar10_gray.npz``, a gray copy. JPEG compression changed most of its images. Only the
          unchanged ones, which `train_lossless` and `test_lossless` mark, are returned.

        Default: the archive of the binary version is fetched once (170 MB), verified, and stored in
        the user's cache.
    first : int, optional
        Read only the first `first` images. Default: all.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Returns
    -------
    ndarray of float32, shape (N, 32, 32)
        Intensities in [0, 1]: the luma 0.299 R + 0.587 G + 0.114 B of ITU-R BT.601, rounded to
        integer gray levels and divided by 255. They are display-encoded, not linear in light.

    Raises
    ------
    FileNotFoundError
        If `folder` does not contain the images, or a file is missing.
    ConnectionError
        If the files cannot be fetched.
    OSError, ValueError
        If a file cannot be stored or is damaged, or an argument is wrong.

    Warns
    -----
    JotlightWarning
        Before a download: the site, the size, and the terms.

    Notes
    -----
    The data set states no license. For research, cite [1]_.

    References
    ----------
    .. [1] Krizhevsky, "Learning multiple layers of features from tiny images", technical report,
       University of Toronto, 2009.

    Examples
    --------
    >>> cifar10("val")
    Traceback (most recent call last):
    ValueError: split: expected 'train' or 'test', got 'val'
    """
    if split not in _FILES:
        raise ValueError(f"split: expected 'train' or 'test', got {split!r}")
    check_first(first)
    names = _FILES[split]
    levels: list[npt.NDArray[np.uint8]] = []
    with shown_progress(progress, "CIFAR-10") as update:
        report: Callable[[float], object] = update
        if folder is None:
            source, begin = _remote_files(), equal_steps(update, 2)
            stored = fetch(source, source.urls, begin("fetching CIFAR-10"))
            report = begin("reading CIFAR-10")
            batches = cifar10_files.read_archive(stored / cifar10_files.ARCHIVE, names)
        else:
            path = as_path(folder, 'cifar10(folder="data")')
            batches = cifar10_files.read_folder(path, split, names)
        for batch in batches:
            levels.append(batch)
            if first is not None and sum(map(len, levels)) >= first:
                break
            if len(levels) < len(names):
                report(len(levels) / len(names))
        report(1.0)
    stack = np.concatenate(levels)[:first]
    return stack.astype(np.float32) / np.float32(255)


def _remote_files() -> RemoteFiles:
    return RemoteFiles(
        name="CIFAR-10",
        site=f"{SITE}/{cifar10_files.ARCHIVE}",
        urls={cifar10_files.ARCHIVE: f"{SITE}/{cifar10_files.ARCHIVE}"},
        hashes={cifar10_files.ARCHIVE: SHA256},
        hashes_in=SHA256,
        size=170_052_171,
        cite="Krizhevsky, Learning multiple layers of features from tiny images, 2009",
    )
