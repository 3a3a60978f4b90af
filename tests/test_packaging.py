"""What pyproject.toml states about the package."""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PACKAGES = {
    "OpenEXR": "openexr",
    "PIL": "pillow",
    "png": "pypng",
    "skimage": "scikit-image",
}
"""Packages whose modules have other names."""

NOT_NEEDED = {"IPython", "jotlight", "magicgui", "qtpy"}
"""Modules that notebooks or napari bring along wherever their code runs."""


def test_every_imported_package_is_declared():
    lists = PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()
    declared = {re.match(r"[\w-]+", text)[0].lower() for texts in lists for text in texts}
    sources = [path.read_text("utf-8") for path in (ROOT / "python").rglob("*.py")]
    statement = re.compile(r"^ *(?:import|from) ([a-zA-Z]\w*)[\w.]*(?: import| as|$)", re.M)
    imported = {name for source in sources for name in statement.findall(source)}
    others = imported - sys.stdlib_module_names - NOT_NEEDED
    missing = {PACKAGES.get(name, name).lower().replace("_", "-") for name in others} - declared
    assert missing == set()
