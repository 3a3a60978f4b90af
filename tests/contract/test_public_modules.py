"""Completion in notebooks offers the public names of a module, and not what it imports."""

import pytest

from public_modules import import_public, public_module_names


@pytest.mark.parametrize("name", public_module_names())
def test_a_public_module_lists_its_public_names_only(name):
    module = import_public(name)
    assert dir(module) == sorted(module.__all__)
    values = [getattr(module, each) for each in module.__all__]
    assert all(getattr(each, "__module__", "jotlight").startswith("jotlight") for each in values)
