"""Names of parameters and of their values: checks, the nearest known name, and other names."""

import functools
import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from difflib import get_close_matches
from types import MappingProxyType
from typing import ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")


def nearest_names(name: str, known: Iterable[str]) -> list[str]:
    """Return the known names that an unknown one probably means, at most three.

    One is the name in other case; or else some contain it as a word; or else one has nearly the
    same letters.

    Examples
    --------
    >>> nearest_names("tv", ["admm-tv", "mle"]), nearest_names("MEL", ["admm-tv", "mle"])
    (['admm-tv'], ['mle'])
    >>> nearest_names("all", ["network-small", "mle"])
    []
    """
    lower, by_lower = name.lower(), {each.lower(): each for each in known}
    if lower in by_lower:
        return [by_lower[lower]]
    found = [each for each in by_lower if lower in each.split("-")]
    return [by_lower[each] for each in (found or get_close_matches(lower, by_lower, 1))[:3]]


def did_you_mean(
    name: str, known: Iterable[str], synonyms: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return a question that proposes the nearest known names, or an empty text.

    A synonym in lower case has its meaning, which may be a longer text.

    Examples
    --------
    >>> did_you_mean("gains", ["gain", "frames"]), did_you_mean("x", ["gain", "frames"])
    ('; did you mean gain?', '')
    >>> did_you_mean("T", ["gain", "frames"], {"t": "frames"})
    '; did you mean frames?'
    """
    meaning = synonyms.get(name.lower())
    close = nearest_names(name, known) if meaning is None else [meaning]
    return f"; did you mean {' or '.join(close)}?" if close else ""


def check_choice(name: str, value: object, choices: Collection[str], alternative: str = "") -> None:
    """Raise ValueError unless the value of a parameter is one of the choices.

    Parameters
    ----------
    name : str
        The parameter.
    value : object
        Its value.
    choices : collection of str
        The names that it may have.
    alternative : str
        What else is accepted, for the message.

    Examples
    --------
    >>> check_choice("format", "tif", ["png", "tiff"])
    Traceback (most recent call last):
      ...
    ValueError: format: expected one of png, tiff, got 'tif'; did you mean tiff?
    """
    if isinstance(value, str) and value in choices:
        return
    advice = did_you_mean(value, choices) if isinstance(value, str) else ""
    raise ValueError(
        f"{name}: expected one of {', '.join(choices)}{alternative}, got {value!r}{advice}"
    )


def require_names(
    example: str, synonyms: Mapping[str, str] = MappingProxyType({})
) -> Callable[[type[T]], type[T]]:
    """Return a decorator of classes whose calls must name the parameters, as in `example`.

    `synonyms` are other names of the parameters, for the hint of an error.

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
                advice = did_you_mean(unknown[0], known, synonyms)
                text = f"some of {', '.join(known)}, got {', '.join(unknown)}{advice}"
            if text:
                raise TypeError(f"{cls.__name__}: expected {text}")
            initialize(self, **parameters)

        setattr(cls, "__init__", initialize_by_name)  # noqa: B010 - mypy refuses an assignment
        return cls

    return decorate


def other_names(**meanings: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator of functions whose errors explain names of parameters in other libraries.

    Parameters
    ----------
    **meanings : str
        For each other name, the parameter here, and what it is for.

    Examples
    --------
    >>> @other_names(epochs="steps= for the length of the run")
    ... def run(*, steps: int = 0) -> int:
    ...     return steps
    >>> run(epochs=3)
    Traceback (most recent call last):
      ...
    TypeError: run: expected steps= for the length of the run, got epochs=; write steps= instead
    """

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            for name in kwargs:
                if name in meanings:
                    own = meanings[name].partition(" ")[0]
                    raise TypeError(
                        f"{function.__name__}: expected {meanings[name]}, got {name}=; write {own} "
                        "instead"
                    )
            return function(*args, **kwargs)

        return call

    return decorate


_SEED = "rng= for a seed or a random generator"

takes_rng = other_names(seed=_SEED, random_state=_SEED)
"""A decorator of functions whose parameter `rng` is a seed."""

other_training_names = other_names(
    epochs="steps= for the length of the run",
    batch_size="batch= for the number of patches of a step",
    validation="test= for images that measure the quality during the run",
)
"""A decorator of trainings with the parameters `steps`, `batch`, and `test`."""
