"""The modules whose names users write: `jl.NAME`, or `from jotlight.NAME import …`."""

import importlib
import inspect
from pathlib import Path
from types import ModuleType

import pytest

import jotlight

_EXTRAS = {"jotlight.dask": "dask", "jotlight.torch": "torch"}
"""The packages that subpackages need."""


def public_module_names() -> list[str]:
    """Return the names of the modules of `jotlight` with public names, without their import."""
    listed = (getattr(jotlight, name) for name in jotlight.__all__)
    names = {each.__name__ for each in listed if isinstance(each, ModuleType)}
    for path in Path(jotlight.__file__).parent.glob("*/__init__.py"):
        if "__all__" in path.read_text("utf-8"):
            names.add(f"jotlight.{path.parent.name}")
    return ["jotlight", "jotlight.plots", *sorted(names)]


def import_public(name: str) -> ModuleType:
    """Return a public module. Without the package that it needs, skip the test."""
    if name in _EXTRAS:
        pytest.importorskip(_EXTRAS[name])
    return importlib.import_module(name)


def public_callables(module: ModuleType) -> list[tuple[str, object]]:
    """Return the public functions, classes, and methods of a module, with their names."""
    found = []
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.isclass(value) and issubclass(value, Exception):
            continue
        if inspect.isclass(value):
            methods = inspect.getmembers(value, _is_function)
            found += [(f"{name}.{key}", each) for key, each in methods if key[0] != "_"]
        if inspect.isclass(value) or _is_function(value):
            found.append((name, value))
    return found


def _is_function(value: object) -> bool:
    return inspect.isfunction(value) or inspect.ismethod(value)
