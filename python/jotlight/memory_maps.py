"""Release of the pages of memory-mapped files, so that long captures need little memory."""

import mmap
from typing import Any

import numpy as np
import numpy.typing as npt


def release(part: npt.NDArray[Any]) -> None:
    """Release the pages of a part of a memory map. Do nothing for other arrays.

    The contents remain accessible, but the pages stop counting as memory of this process. The
    operating system writes changes to the file later, and caches the pages while it has free
    memory. A copy-on-write map keeps its pages, because its changes are in no file.
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
    # Adding this to an address yields the position in the map, which begins on a page boundary.
    address_to_position = root.offset % mmap.ALLOCATIONGRANULARITY - root.ctypes.data
    first = part.ctypes.data + address_to_position + sum(span for span in spans if span < 0)
    last = part.ctypes.data + address_to_position + sum(span for span in spans if span > 0)
    start = first // mmap.PAGESIZE * mmap.PAGESIZE
    pages.madvise(mmap.MADV_DONTNEED, start, last + part.itemsize - start)
