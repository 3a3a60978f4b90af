"""The types of arrays have one name each, which one module defines."""

import ast
from pathlib import Path

import jotlight

FOLDER = Path(jotlight.__file__).parent


def aliases(path):
    """Return the names that a module defines for the type of an array."""
    for statement in ast.parse(path.read_text()).body:
        value = statement.value if isinstance(statement, ast.Assign) else None
        if isinstance(value, ast.Subscript) and ast.unparse(value.value).endswith("NDArray"):
            yield ast.unparse(statement.targets[0])


def test_no_other_module_names_the_type_of_an_array():
    found = {path: list(aliases(path)) for path in FOLDER.rglob("*.py")}
    assert "Array" in found.pop(FOLDER / "array_types.py")
    assert {path: names for path, names in found.items() if names} == {}
