"""Lead links from the Markdown pages to files outside `docs/` to the repository.

On GitHub, these links are relative. The pages `contributing` and `changelog` of the site have the
text of the files of these names at the top of the repository.
"""

import re
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
TOP_PAGES = {"contributing": "CONTRIBUTING.md", "changelog": "CHANGELOG.md"}
"""Pages of the site, and the files at the top of the repository that hold their text."""

_LINK = re.compile(r"(\]\()([^)\s]+)(\))")


def rewrite(text: str, folder: str, site: str, repository: str) -> str:
    """Return Markdown for a page of the site whose text is from `folder` of the repository.

    Parameters
    ----------
    text : str
        Markdown whose links are relative to `folder`.
    folder : str
        The folder of the text, relative to the top of the repository.
    site : str
        The folder of the page, relative to the top of the repository.
    repository : str
        The address of the repository.
    """

    def replace(match: re.Match[str]) -> str:
        before, target, after = match.groups()
        if "://" in target or target.startswith(("#", "mailto:")):
            return match[0]
        path, _, anchor = target.partition("#")
        anchor = anchor and f"#{anchor}"
        inside = (ROOT / folder / path).resolve().relative_to(ROOT)
        pages = {name: f"docs/{page}.md" for page, name in TOP_PAGES.items()}
        page = PurePosixPath(pages.get(inside.as_posix(), inside.as_posix()))
        if (ROOT / page).is_dir() and (ROOT / page / "index.md").exists():
            page /= "index.md"
        if page.is_relative_to("docs"):
            return f"{before}{_relative(page, PurePosixPath(site))}{anchor}{after}"
        kind = "tree" if (ROOT / inside).is_dir() else "blob"
        return f"{before}{repository}/{kind}/main/{inside.as_posix()}{anchor}{after}"

    return _LINK.sub(replace, text)


def _relative(page: PurePosixPath, folder: PurePosixPath) -> str:
    """Return the path of a page as seen from a folder."""
    shared = 0
    for mine, other in zip(folder.parts, page.parts, strict=False):
        if mine != other:
            break
        shared += 1
    return "/".join([".."] * (len(folder.parts) - shared) + list(page.parts[shared:]))


def read_source(app: "Sphinx", page: str, source: list[str]) -> None:
    """Rewrite the links of a page when Sphinx reads it."""
    path = Path(app.env.doc2path(page))
    if path.suffix != ".md":
        return
    site = path.parent.relative_to(ROOT).as_posix()
    folder = site
    if page in TOP_PAGES:
        top = ROOT / TOP_PAGES[page]
        app.env.note_dependency(str(top))
        source[0], folder = top.read_text("utf-8"), "."
    source[0] = rewrite(source[0], folder, site, app.config.repository_url)


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register the extension with Sphinx."""
    app.add_config_value("repository_url", "", "env")
    app.connect("source-read", read_source)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
