"""The docstring of each public dataclass describes its fields, so that `help` shows them."""

import ast
import dataclasses
import importlib
import inspect
import itertools
import re
import textwrap

import pytest

import jotlight as jl

PACKAGES = "calibration", "estimators", "evaluation", "formats", "motion", "networks", "training"
MODULES = {
    "images.tone": ("Tone",),
    "plots": ("Panel",),
}
"""Classes outside `__all__` that the reference describes."""


def public_classes():
    named = [(jl, jl.__all__)]
    for package in PACKAGES:
        module = importlib.import_module(f"jotlight.{package}")
        named.append((module, getattr(module, "__all__", [])))
    for module, names in MODULES.items():
        named.append((importlib.import_module(f"jotlight.{module}"), names))
    found = [getattr(module, name) for module, names in named for name in names]
    classes = {each for each in found if inspect.isclass(each) and dataclasses.is_dataclass(each)}
    return sorted(classes, key=lambda each: each.__qualname__)


@pytest.mark.parametrize("described", public_classes(), ids=lambda each: each.__name__)
def test_help_describes_each_field_once(described):
    text = inspect.getdoc(described)
    names = [each.name for each in dataclasses.fields(described) if not each.name.startswith("_")]
    for name in names:
        found = re.findall(rf"^(?:\w+, )*{name}(?:, \w+)* :", text, re.M)
        assert len(found) == 1, f"{described.__name__}.{name}: described {len(found)} times"
    body = ast.parse(textwrap.dedent(inspect.getsource(described))).body[0].body
    for field, after in itertools.pairwise(body):
        if isinstance(field, ast.AnnAssign):
            is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            assert not is_text, f"{described.__name__}.{field.target.id}: described twice"


def test_public_dataclasses_are_found():
    names = {each.__name__ for each in public_classes()}
    assert {"BracketPlan", "Calibration", "Plan", "Sensor", "Uncertainty", "Tone"} <= names
