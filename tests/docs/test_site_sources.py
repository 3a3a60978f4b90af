"""The sources of the website: links between the pages, and the examples of the gallery."""

import ast
import importlib
import sys
from pathlib import Path

import pytest

import jotlight as jl

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture
def links(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS / "_extensions"))
    return importlib.import_module("repository_links")


@pytest.mark.parametrize(
    ("target", "folder", "site", "expected"),
    [
        ("networks.md#speed", "docs/guide", "docs/guide", "networks.md#speed"),
        ("../notation.md", "docs/guide", "docs/guide", "../notation.md"),
        ("../../CONTRIBUTING.md#write", "docs/guide", "docs/guide", "../contributing.md#write"),
        ("docs/guide/files.md", ".", "docs", "guide/files.md"),
        ("docs/decisions", ".", "docs", "decisions/index.md"),
        ("../../noxfile.py", "docs/guide", "docs/guide", "R/blob/main/noxfile.py"),
        ("../examples", "docs", "docs", "R/tree/main/examples"),
        ("https://example.org/a", "docs", "docs", "https://example.org/a"),
        ("#here", "docs", "docs", "#here"),
    ],
)
def test_links_lead_to_the_site_or_to_the_repository(links, target, folder, site, expected):
    assert links.rewrite(f"see [it]({target}).", folder, site, "R") == f"see [it]({expected})."


def test_pages_say_how_to_import_a_module_of_a_subpackage(monkeypatch):
    pytest.importorskip("sphinx", reason="no Sphinx: pip install 'jotlight[site]'")
    monkeypatch.syspath_prepend(str(DOCS / "_extensions"))
    pages = importlib.import_module("api_pages")
    monkeypatch.setitem(sys.modules, "jotlight.gates", jl.gates)
    name = pages.Name("jotlight.gates", "gate_dataset", jl.gates.gate_dataset)
    for page in (
        pages._page(name, "", ""),
        pages._section_page("Methods", [name], {name.path: ""}),
    ):
        assert "\nWrite ``jl.gates``, or ``from jotlight import gates``." in page
    other = pages.Name("jotlight.metrics", "psnr", jl.metrics.psnr)
    assert "from jotlight import" not in pages._page(other, "", "")


def test_pages_of_classes_have_the_members_of_bases_without_pages(monkeypatch):
    pytest.importorskip("sphinx", reason="no Sphinx: pip install 'jotlight[site]'")
    monkeypatch.syspath_prepend(str(DOCS / "_extensions"))
    pages = importlib.import_module("api_pages")
    bits, info = (pages.Name("jotlight", each.__name__, each) for each in (jl.Bits, jl.Plan))
    assert "   :inherited-members: object\n" in pages._page(bits, "", "")
    assert "inherited" not in pages._page(info, "", "")
    base = pages.Name("jotlight", "Base", jl.Bits.__bases__[0])
    assert "inherited" not in pages._page(bits, "", "", [base])


def test_every_example_has_a_title_and_ends_with_its_figure():
    examples = list((ROOT / "examples").glob("*.py"))
    assert examples
    for path in examples:
        text = path.read_text("utf-8")
        title, line = (ast.get_docstring(ast.parse(text)) or "").splitlines()[:2]
        assert line == "=" * len(title)
        assert text.endswith(f'figure.savefig("{path.stem}.png")\nfigure\n')
