"""Arrays that nobody changes."""

from typing import Any

import numpy as np
import numpy.typing as npt


class HasReadOnlyArrays:
    """A base class of objects whose arrays also stay read-only in copies and after pickling.

    Examples
    --------
    >>> import copy
    >>> class Ramp(HasReadOnlyArrays):
    ...     def __init__(self):
    ...         self.values = frozen(np.arange(3))
    >>> copy.deepcopy(Ramp()).values.flags.writeable
    False
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the attributes of another object, from `pickle` or `copy`."""
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        vars(self).update(state)


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a view of an array that cannot be written to.

    Examples
    --------
    >>> read_only(np.zeros(2)).flags.writeable
    False
    """
    view = array.view()
    view.flags.writeable = False
    return view


def frozen(array: npt.NDArray[Any], dtype: npt.DTypeLike | None = None) -> npt.NDArray[Any]:
    """Return a read-only copy in C order, or an array itself that is one already.

    Examples
    --------
    >>> own = frozen(np.zeros(2))
    >>> frozen(own) is own, own.flags.writeable
    (True, False)
    """
    kind = array.dtype if dtype is None else np.dtype(dtype)
    is_own = type(array) is np.ndarray and array.base is None and not array.flags.writeable
    if is_own and array.dtype == kind and array.flags.c_contiguous:
        return array
    copy = np.array(array, kind, order="C")
    copy.flags.writeable = False
    return copy
