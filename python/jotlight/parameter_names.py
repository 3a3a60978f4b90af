"""Names of parameters: calls that must state them, the nearest known name, and other names."""

import functools
import inspect
from collections.abc import Callable
from difflib import get_close_matches
from typing import ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")

_SEEDS = "seed", "random_state"
"""Names of the parameter `rng` in other libraries."""


def unknown_names(unknown: list[str], known: list[str]) -> str:
    """Return unknown names, with the nearest known name.

    Examples
    --------
    >>> unknown_names(["gains"], ["gain", "frames"])
    'gains; did you mean gain?'
    """
    close = [each for name in unknown for each in get_close_matches(name, known, 1)]
    return ", ".join(unknown) + (f"; did you mean {close[0]}?" if close else "")


def require_names(example: str) -> Callable[[type[T]], type[T]]:
    """Return a decorator of classes whose calls must name the parameters, as in `example`.

    Examples
    --------
    >>> @require_names("Point(row=3)")
    ... class Point:
    ...     def __init__(self, *, row: int = 0) -> None: ...
    >>> Point(3)
    Traceback (most recent call last):
      ...
    TypeError: Point: expected parameters with names as in Point(row=3), got 3
    """

    def decorate(cls: type[T]) -> type[T]:
        initialize: Callable[..., None] = cls.__init__
        known = list(inspect.signature(initialize).parameters)[1:]

        @functools.wraps(initialize)
        def initialize_by_name(self: T, *unnamed: object, **parameters: object) -> None:
            text = ""
            if unnamed:
                text = f"parameters with names as in {example}, got {unnamed[0]!r}"
            elif unknown := sorted(set(parameters) - set(known)):
                text = f"some of {', '.join(known)}, got {unknown_names(unknown, known)}"
            if text:
                raise TypeError(f"{cls.__name__}: expected {text}")
            initialize(self, **parameters)

        setattr(cls, "__init__", initialize_by_name)  # noqa: B010 - mypy refuses an assignment
        return cls

    return decorate


def takes_rng(function: Callable[P, T]) -> Callable[P, T]:
    """Return the same function, whose error says that a seed is its parameter `rng`.

    Examples
    --------
    >>> @takes_rng
    ... def draw(*, rng: int = 0) -> int:
    ...     return rng
    >>> draw(seed=1)
    Traceback (most recent call last):
      ...
    TypeError: draw: expected rng= for a seed or a random generator, got seed=; write rng= instead
    """

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        for name in _SEEDS:
            if name in kwargs:
                raise TypeError(
                    f"{function.__name__}: expected rng= for a seed or a random generator, got "
                    f"{name}=; write rng= instead"
                )
        return function(*args, **kwargs)

    return call
