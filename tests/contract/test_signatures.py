"""Signatures in the help of public objects are short enough to read."""

import inspect

import pytest

from public_modules import import_public, public_callables, public_module_names

LONGEST = 650
"""Characters. The names of types need fewer, and what they stand for many more."""

EVALUATED = "numpy._typing", "numpy.ndarray[", "numpy.dtype["
"""What help shows for npt.ArrayLike and npt.NDArray if their module evaluates annotations."""


@pytest.mark.parametrize("name", public_module_names())
def test_signatures_name_types(name):
    for each, value in public_callables(import_public(name)):
        signature = str(inspect.signature(value))
        assert len(signature) <= LONGEST, each
        assert not any(text in signature for text in EVALUATED), (each, value.__module__)
