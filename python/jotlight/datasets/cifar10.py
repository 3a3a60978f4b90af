"""The small pictures of CIFAR-10."""

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.datasets import cifar10_files
from jotlight.datasets.fetch import Progress, Source, fetched, halves
from jotlight.images.sets import check_first

SITE = "https://www.cs.toronto.edu/~kriz"
SHA256 = "c4a38c50a1bc5f3a1c5537f2155ab9d68f9f25eb1ed8d9ddda3db29a59bca1dd"

_FILES = {
    "train": tuple(f"data_batch_{number}" for number in range(1, 6)),
    "test": ("test_batch",),
}


def cifar10(
    split: str,
    folder: str | os.PathLike[str] | None = None,
    *,
    first: int | None = None,
    progress: Progress | None = None,
) -> npt.NDArray[np.float32]:
    """The pictures of CIFAR-10 in grey, in their official order.

    Parameters
    ----------
    split : {"train", "test"}
        50,000 pictures, or 10,000.
    folder : path, optional
        A folder that holds the data in one of these forms, or the inner folder itself; the first
        that is there is taken:

        - the original binary version, ``cifar-10-batches-bin/{data_batch_1..5,test_batch}.bin``,
        - the original Python version, ``cifar-10-batches-py/{data_batch_1..5,test_batch}``, which
          are pickles; they are searched for the pixels and never unpickled,
        - ``cifar-10-binary.tar.gz``, read as it is,
        - ``cifar10_gray.npz``, a copy in grey in which most pictures had been through JPEG. Only
          those without loss, marked by `train_lossless` and `test_lossless`, are given, so that
          there are fewer.

        Default: the archive of the binary version is fetched once, 170 MB, checked, and kept in
        the user's cache.
    first : int, optional
        Only so many of them.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    ndarray of float32, shape (N, 32, 32)
        Intensities in [0, 1]: the luma 0.299 R + 0.587 G + 0.114 B of ITU-R BT.601, rounded to
        whole grey levels, over 255. They are display-encoded, and not linear in light.

    Raises
    ------
    FileNotFoundError
        When `folder` does not hold them, or a part is missing.
    ConnectionError
        When they cannot be fetched.
    OSError, ValueError
        When a file cannot be kept or is damaged, or an argument is wrong; the message says which.

    Warns
    -----
    JotlightWarning
        Before anything is fetched: from where, how much, and on what terms.

    Notes
    -----
    No licence is stated; for research, cite [1]_.

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
    names, reading = _FILES[split], progress
    if folder is None:
        source = _source()
        fetching, reading = halves(progress)
        folder = fetched(source, source.urls, fetching)
        batches = cifar10_files.from_archive(folder / cifar10_files.ARCHIVE, names)
    else:
        batches = cifar10_files.found(Path(folder), split, names)
    levels: list[npt.NDArray[np.uint8]] = []
    for batch in batches:
        levels.append(batch)
        if first is not None and sum(map(len, levels)) >= first:
            break
        if reading and len(levels) < len(names):
            reading(len(levels) / len(names))
    if reading:
        reading(1.0)
    stack = np.concatenate(levels)[:first]
    return stack.astype(np.float32) / np.float32(255)


def _source() -> Source:
    return Source(
        name="CIFAR-10",
        site=f"{SITE}/{cifar10_files.ARCHIVE}",
        urls={cifar10_files.ARCHIVE: f"{SITE}/{cifar10_files.ARCHIVE}"},
        hashes={cifar10_files.ARCHIVE: SHA256},
        hashes_in=SHA256,
        size=170_052_171,
        cite="Krizhevsky, Learning multiple layers of features from tiny images, 2009",
    )
