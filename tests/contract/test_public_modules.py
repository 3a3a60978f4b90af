"""Public modules list their public names, and each name resolves before any other is used."""

import importlib
import subprocess
import sys
from types import ModuleType

import pytest

import jotlight
from public_modules import import_public, public_module_names

FRESH = """
import importlib, sys
for name in sys.argv[1:]:
    for loaded in [each for each in sys.modules if each.split(".")[0] == "jotlight"]:
        if loaded != "jotlight._engine":  # a process can load it only once
            del sys.modules[loaded]
    getattr(importlib.import_module("jotlight"), name)
"""


@pytest.mark.parametrize("name", public_module_names())
def test_a_public_module_lists_its_public_names_only(name):
    module = import_public(name)
    assert dir(module) == sorted(module.__all__)
    values = [getattr(module, each) for each in module.__all__]
    assert all(getattr(each, "__module__", "jotlight").startswith("jotlight") for each in values)


MODULES_AS_NAMES = [
    name for name in jotlight.__all__ if isinstance(getattr(jotlight, name), ModuleType)
]


@pytest.mark.parametrize("name", MODULES_AS_NAMES)
def test_a_folder_finds_a_public_module_that_nothing_has_imported(name, monkeypatch):
    module = getattr(jotlight, name)
    folder = importlib.import_module(module.__name__.rpartition(".")[0])
    monkeypatch.delattr(folder, name)
    assert getattr(folder, name) is module


@pytest.mark.slow
def test_every_public_name_resolves_in_a_fresh_process():
    subprocess.run([sys.executable, "-c", FRESH, *jotlight.__all__], check=True)
