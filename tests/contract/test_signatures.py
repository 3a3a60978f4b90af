"""Signatures in the help of public objects are short enough to read."""

import inspect

import pytest

import jotlight as jl

LONGEST = 650
"""Characters. The names of types need fewer, and what they stand for many more."""


def callables_of(name):
    """Yield a public object and its public methods."""
    value = getattr(jl, name)
    yield value
    if inspect.isclass(value):
        methods = vars(value).items()
        yield from (each for key, each in methods if key[0] != "_" and inspect.isfunction(each))


def has_signature(name):
    value = getattr(jl, name)
    return callable(value) and not (inspect.isclass(value) and issubclass(value, Exception))


@pytest.mark.parametrize("name", [name for name in jl.__all__ if has_signature(name)])
def test_signatures_name_types(name):
    for each in callables_of(name):
        assert len(str(inspect.signature(each))) <= LONGEST, each
