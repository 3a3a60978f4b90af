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


def test_the_licenses_are_those_of_the_locked_crates():
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text("utf-8"))["package"]
    versions = {f"{crate['name']} {crate['version']}" for crate in lock if "source" in crate}
    text = (ROOT / "THIRD-PARTY-LICENSES").read_text("utf-8")
    titles = re.findall(r"^=+\n([\w-]+ [\d.]+), (.+)$", text, re.M)
    assert {title for title, _ in titles} <= versions
    assert ("safetensors 0.8.0", "Apache-2.0") in titles
    for name in tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"][
        "dependencies"
    ]:
        assert any(title.startswith(f"{name} ") for title, _ in titles), name
    assert "THIRD-PARTY-LICENSES" in PROJECT["license-files"]


def test_the_crate_carries_the_licenses():
    for name in ("LICENSE-MIT", "LICENSE-APACHE"):
        assert (ROOT / "crates/jotlight" / name).read_bytes() == (ROOT / name).read_bytes()


def test_entries_for_citations_state_the_title_the_authors_and_the_version():
    version = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"]["package"][
        "version"
    ]
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    entry = (ROOT / "docs/references.bib").read_text("utf-8").partition("\n\n")[0]
    assert entry.startswith("@misc{jotlight,")
    assert f"\nversion: {version}\n" in citation
    assert f"{{Version {version}}}" in entry
    for pattern in (r'title: "(.+)"', r'- name: "(.+)"'):
        assert f"{{{re.search(pattern, citation)[1]}}}" in entry
