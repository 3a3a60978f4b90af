"""The docstring of each folder of the package is its table of contents."""

import ast
import re
from pathlib import Path

import pytest

import jotlight

PACKAGE = Path(jotlight.__file__).parent
FOLDERS = sorted(path.parent for path in PACKAGE.glob("**/__init__.py") if path.parent != PACKAGE)


def modules_of(folder):
    """Return the names of the modules and packages in a folder."""
    files = {path.stem for path in folder.glob("*.py") if not path.stem.startswith("_")}
    return files | {path.parent.name for path in folder.glob("*/__init__.py")}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_the_docstring_of_a_folder_names_its_modules(folder):
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8")))
    named = set(re.findall(r"`(?:[\w.]+\.)?(\w+)`", text))
    assert modules_of(folder) - named == set()
