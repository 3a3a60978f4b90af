"""Memory-mapped files: releasing pages that were read, so that long captures need little memory."""

import mmap
from typing import Any

import numpy as np
import numpy.typing as npt


def release(part: npt.NDArray[Any]) -> None:
    """Release the pages behind a part of a memory map; other arrays are left alone.

    The system writes changes to the file in time, and caches what was read while there is room.
    The contents remain accessible, but they do not count as memory of this process. A map with
    private changes keeps its pages.
    """
    if not part.size:
        return
    root: Any = part
    while isinstance(root.base, np.ndarray):
        root = root.base
    pages: Any = root.base
    if not (isinstance(root, np.memmap) and isinstance(pages, mmap.mmap) and root.mode != "c"):
        return
    if not hasattr(mmap, "MADV_DONTNEED"):
        return
    spans = [(size - 1) * step for size, step in zip(part.shape, part.strides, strict=True)]
    to_file = root.offset % mmap.ALLOCATIONGRANULARITY - root.ctypes.data
    first = part.ctypes.data + to_file + sum(span for span in spans if span < 0)
    last = part.ctypes.data + to_file + sum(span for span in spans if span > 0)
    start = first // mmap.PAGESIZE * mmap.PAGESIZE
    pages.madvise(mmap.MADV_DONTNEED, start, last + part.itemsize - start)
