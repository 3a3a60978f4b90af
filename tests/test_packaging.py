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


SITE = PROJECT["urls"]["Documentation"]
SOURCE = PROJECT["urls"]["Source"]


def anchors(page):
    """Return the anchors of the headings of a Markdown file, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", each.lower()).replace(" ", "-") for each in headings}


def linked_file(target):
    """Return the file of the repository that a page of the website, or of the repository, shows."""
    if target.startswith(SITE):
        page = target.removeprefix(SITE) or "index.html"
        return ROOT / "docs" / page.replace(".html", ".md")
    raw = SOURCE.replace("github.com", "raw.githubusercontent.com")
    for prefix in (f"{SOURCE}/blob/main/", f"{SOURCE}/tree/main/", f"{raw}/main/"):
        if target.startswith(prefix):
            return ROOT / target.removeprefix(prefix)
    return None


def test_links_of_the_readme_work_on_every_page_that_shows_it():
    text = (ROOT / "README.md").read_text("utf-8")
    targets = re.findall(r"\]\(([^)]+)\)|^\[[^\]]+\]: (\S+)$", text, re.M)
    found = [one or other for one, other in targets]
    assert len(found) > 30
    # The package index shows the text without the repository.
    assert [each for each in found if not each.startswith("https://")] == []
    for each in found:
        target, _, anchor = each.partition("#")
        file = linked_file(target)
        if file is None:
            assert not target.startswith((SITE, SOURCE)), each
            continue
        assert file.exists(), each
        assert ("/tree/" in each) == file.is_dir(), each
        assert not anchor or anchor in anchors(file), each


def test_every_imported_package_is_declared():
    lists = PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()
    declared = {re.match(r"[\w-]+", text)[0].lower() for texts in lists for text in texts}
    sources = [path.read_text("utf-8") for path in (ROOT / "python").rglob("*.py")]
    statement = re.compile(r"^ *(?:import|from) ([a-zA-Z]\w*)[\w.]*(?: import| as|$)", re.M)
    imported = {name for source in sources for name in statement.findall(source)}
    others = imported - sys.stdlib_module_names - NOT_NEEDED
    missing = {PACKAGES.get(name, name).lower().replace("_", "-") for name in others} - declared
    assert missing == set()
