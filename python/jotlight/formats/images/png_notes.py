"""Notes in PNG files, which say how jotlight computed an image."""

import json
from pathlib import Path
from typing import Any

from jotlight.formats.files.remote_files import open_binary

KEYWORD = "Description"
"""Keyword of the text in a PNG that holds the note as JSON."""


def read_png_note(path: Path) -> dict[str, Any]:
    """Return the note in a PNG, the JSON object of its text `Description`; {} without one.

    The gray levels are not decoded. A damaged file has no note: its reader reports the damage.

    Examples
    --------
    >>> import tempfile
    >>> from PIL import Image
    >>> from PIL.PngImagePlugin import PngInfo
    >>> path, text = Path(tempfile.mkdtemp()) / "a.png", PngInfo()
    >>> text.add_text("Description", '{"method": "mle"}')
    >>> Image.new("L", (4, 5)).save(path, pnginfo=text)
    >>> read_png_note(path)
    {'method': 'mle'}
    """
    from PIL.PngImagePlugin import PngImageFile

    try:
        with open_binary(path) as file, PngImageFile(file) as image:
            note = json.loads(image.info.get(KEYWORD, ""))
    except Exception:  # Pillow may raise any type for a damaged file
        return {}
    return note if isinstance(note, dict) else {}
