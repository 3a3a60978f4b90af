"""Show the figure that an example saves on its page of the gallery."""

import ast
import shutil
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst


def show_saved_figure(
    block: Any, variables: dict[str, Any], configuration: dict[str, Any], **options: Any
) -> str:
    """Move the new figure of an example to its page, and return the directive that shows it.

    sphinx-gallery calls this scraper after each block of an example. jotlight's figures do not use
    pyplot, which other scrapers look for.
    """
    script = Path(variables["src_file"])
    saved = script.with_suffix(".png")
    if not saved.exists():
        return ""
    target = next(variables["image_path_iterator"])
    shutil.move(saved, target)
    documentation = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or ""
    title = documentation.partition("\n")[0]
    return str(figure_rst([target], configuration["src_dir"], title))
