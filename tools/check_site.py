"""Check the links of a built website; list the broken ones and exit with 1 if there is any.

    python tools/check_site.py docs/_build/html

Each link to a page, an image, a style, or a script must lead to a file inside the folder, and each
anchor to an element of its page. Links to other sites are counted, not followed.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

_ADDRESSES = {"href", "src", "poster", "data-src"}


class Page(NamedTuple):
    """The anchors and the links of a page."""

    anchors: set[str]
    links: list[str]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.page = Page(set(), [])

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if value is None:
                continue
            if name == "id" or (tag == "a" and name == "name"):
                self.page.anchors.add(value)
            elif name in _ADDRESSES:
                self.page.links.append(value)
            elif name == "srcset":
                self.page.links.extend(part.split()[0] for part in value.split(","))


def read_page(path: Path) -> Page:
    """Return the anchors and the links of an HTML file."""
    reader = _Reader()
    reader.feed(path.read_text("utf-8"))
    return reader.page


def broken_links(folder: Path) -> tuple[list[str], int, int]:
    """Return descriptions of the broken links, and the numbers of internal and external links.

    Raises
    ------
    ValueError
        If the folder has no page.
    """
    folder = folder.resolve()
    # The theme keeps a template of its own among its static files.
    paths = (path for path in sorted(folder.rglob("*.html")) if path.parent.name != "_static")
    pages = {path: read_page(path) for path in paths}
    if not pages:
        raise ValueError(f"{folder}: expected a folder of HTML pages, found none; build the site")
    broken, internal, external = [], 0, 0
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                external += parts.scheme not in ("data", "mailto", "javascript")
                continue
            internal += 1
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            where = f"{path.relative_to(folder)}: {link}"
            if not target.is_relative_to(folder) or not target.is_file():
                broken.append(f"{where}: there is no such file")
            elif target in pages and _is_missing(parts.fragment, pages[target]):
                broken.append(f"{where}: the page has no such anchor")
    return broken, internal, external


def _is_missing(fragment: str, page: Page) -> bool:
    return bool(fragment) and not {fragment, unquote(fragment)} & page.anchors


def main(folder: str) -> int:
    """Print the broken links of a folder and return the exit status."""
    broken, internal, external = broken_links(Path(folder))
    print(*broken, sep="\n", end="\n" if broken else "")
    print(f"{internal} internal links, {len(broken)} broken; {external} external links")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
