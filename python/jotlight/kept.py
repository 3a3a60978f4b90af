"""Properties that keep their value."""

import functools
from typing import Any, TypeVar, overload

Value = TypeVar("Value")


class kept_property(functools.cached_property[Value]):  # noqa: N801, TID251
    """A property that is computed once per object, as that of `functools`, but without a lock.

    Python 3.11 holds a lock of the class while it computes a cached property. If the process forks
    meanwhile, the child waits for this lock forever. Here, two threads may both compute the value.

    Examples
    --------
    >>> class Square:
    ...     @kept_property
    ...     def area(self):
    ...         print("computed once")
    ...         return 9
    >>> square = Square()
    >>> square.area + square.area
    computed once
    18
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> "kept_property[Value]": ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> Value: ...

    def __get__(
        self, instance: object | None, owner: type[Any] | None = None
    ) -> "kept_property[Value] | Value":
        """Return the value, which the object then holds under the name of the property."""
        if instance is None:
            return self
        assert self.attrname is not None, "the name, which the body of a class sets"
        # Frozen objects refuse `setattr`. `setdefault` keeps one value if two threads compute it.
        kept: Value = instance.__dict__.setdefault(self.attrname, self.func(instance))
        return kept
