"""The website: `nox -s site` builds it, and warnings are errors.

`_extensions/api_pages.py` writes a page for each public name, `_extensions/repository_links.py`
leads links of the Markdown pages to files outside `docs/`, and sphinx-gallery runs the examples.
"""

import sys
from pathlib import Path

from docutils.nodes import document
from sphinx.application import Sphinx

import jotlight

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_extensions"))

project = "jotlight"
author = copyright = "The jotlight developers"  # noqa: A001
release = jotlight.__version__

extensions = [
    "cyclopts.ext.sphinx",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "api_pages",
    "repository_links",
]
exclude_patterns = ["_build", "gallery/*.md5", "gallery/*.ipynb", "gallery/*.json"]
repository_url = "https://github.com/jotlight/jotlight"

# Markdown: the headings have the same anchors as on GitHub.
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4

# Docstrings. Words in single backticks become links where they are public names.
default_role = "py:obj"
autodoc_member_order = "bysource"
# Extras are large, and not needed to read docstrings.
autodoc_mock_imports = ["dask", "deepinv", "magicgui", "napari", "starlette", "torch", "uvicorn"]
autodoc_typehints = "none"  # the docstrings state types, shapes, and units
autosummary_generate = False
numpydoc_show_class_members = False  # the page of a class describes all of its members

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("saved_figures.show_saved_figure",),
    "capture_repr": (),
    "abort_on_example_error": True,
    "download_all_examples": True,
    "remove_config_comments": True,
    "show_memory": False,
    "min_reported_time": 10_000,
    "show_signature": False,
    "write_computation_times": False,  # its page would load a script from another site
}

templates_path = ["_templates"]
html_theme = "pydata_sphinx_theme"
html_title = "jotlight"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/icon.svg"
html_logo = "_static/icon.svg"
html_search_scorer = str(DOCS / "_extensions" / "search_scores.js")
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "jotlight", "alt_text": "jotlight, front page"},
    "icon_links": [
        {"name": "Source code", "url": repository_url, "icon": "fa-brands fa-github"},
    ],
    "header_links_before_dropdown": 7,
    "navbar_persistent": ["search-button"],
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
}
# Without it, the theme logs an error on the first visit.
html_context = {"default_mode": "auto"}
# A sidebar without links would only take room from these pages.
html_sidebars = {page: [] for page in ("index", "install", "notation", "changelog", "contributing")}


def setup(app: Sphinx) -> None:
    """Leave the pages for contributors out of the search, where they hide those for users."""

    def leave_out(app: Sphinx, doctree: document) -> None:
        if app.env.docname.startswith(("decisions/", "changelog", "contributing")):
            app.env.metadata[app.env.docname]["nosearch"] = True

    app.connect("doctree-read", leave_out)
