"""Several tasks at the same time, in threads: NumPy and the engine release the GIL."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def map_in_threads(
    function: Callable[[Item], Result], items: Iterable[Item], threads: int | None
) -> list[Result]:
    """Return the results of a function for all items, in their order.

    Examples
    --------
    >>> map_in_threads(abs, [-3, 2], threads=2)
    [3, 2]
    """
    number = (os.cpu_count() or 1) if threads is None else threads
    if number == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(number) as pool:
        return list(pool.map(function, items))
