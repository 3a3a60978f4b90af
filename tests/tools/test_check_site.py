"""The check of the website's links finds broken ones, and only those."""

import importlib
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("check_site")


@pytest.fixture
def site(tmp_path):
    """Return a folder with two pages whose links all lead somewhere."""
    folder = tmp_path / "html"
    (folder / "guide").mkdir(parents=True)
    (folder / "icon.svg").write_text("<svg/>")
    (folder / "index.html").write_text(
        '<h1 id="top">Front</h1><a href="guide/">Guide</a><a href="guide/index.html#step-1">1</a>'
        '<img src="icon.svg?version=1"><a href="#top">up</a><a href="https://example.org/x">out</a>'
    )
    (folder / "guide/index.html").write_text(
        '<a name="step-1"></a><a href="../index.html#top">Front</a><img srcset="../icon.svg 2x">'
        '<a href="mailto:a@example.org">mail</a>'
    )
    return folder


def test_a_site_without_broken_links_passes(tool, site, capsys):
    assert tool.main(str(site)) == 0
    assert capsys.readouterr().out == "6 internal links, 0 broken; 1 external links\n"


@pytest.mark.parametrize(
    ("link", "reason"),
    [
        ("missing.html", "there is no such file"),
        ("guide/index.html#step-2", "the page has no such anchor"),
        ("#nowhere", "the page has no such anchor"),
        ("../secret.html", "there is no such file"),
        ("/index.html", "there is no such file"),
    ],
)
def test_a_broken_link_fails_and_is_named(tool, site, capsys, link, reason):
    (site.parent / "secret.html").write_text("outside of the site")
    page = site / "index.html"
    page.write_text(page.read_text() + f'<a href="{link}">broken</a>')
    assert tool.main(str(site)) == 1
    assert f"index.html: {link}: {reason}" in capsys.readouterr().out


def test_a_folder_without_pages_is_refused(tool, tmp_path):
    with pytest.raises(ValueError, match="expected a folder of HTML pages, found none"):
        tool.main(str(tmp_path))
