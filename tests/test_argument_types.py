"""Checks of the types of arguments."""

import pytest

from jotlight.argument_types import as_path


def test_an_empty_text_is_no_path():
    assert as_path("a.npy", "open(path)").name == "a.npy"
    with pytest.raises(ValueError, match="path: expected the name of a file, as in open"):
        as_path("", "open(path)")
