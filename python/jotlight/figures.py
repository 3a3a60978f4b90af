"""The class of all figures. Import this module late, because matplotlib is large."""

import io
from typing import Literal

from matplotlib.figure import Figure as MatplotlibFigure

_SIDE, _MAX_DPI, _COLORS = 600, 60, 32
"""Maximum width and height in pixels, resolution, and number of colors of a thumbnail."""

_MAX_BYTES = 20_000
"""Maximum number of bytes of a thumbnail."""


class Figure(MatplotlibFigure):
    """A figure that shows itself in notebooks.

    It does not use pyplot, so it changes no global state and needs no display. In a notebook, other
    figures of this kind show themselves only after pyplot was imported.

    Parameters
    ----------
    width, height : float
        The size in inches.
    layout : {"constrained"}, optional
        How axes are placed. None: by hand.
    """

    def __init__(
        self, width: float, height: float, layout: Literal["constrained"] | None = "constrained"
    ) -> None:
        super().__init__(figsize=(width, height), facecolor="white", layout=layout)

    def thumbnail(self) -> bytes:
        """Return a small PNG of the figure, for the HTML of the object that it shows.

        Images that compress badly make a smaller thumbnail.
        """
        from PIL import Image

        dpi = min(_MAX_DPI, _SIDE / max(self.get_size_inches()))
        image = Image.open(io.BytesIO(self._png(dpi=dpi))).convert("RGB")
        while True:
            buffer = io.BytesIO()
            image.quantize(_COLORS, dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
            if buffer.tell() <= _MAX_BYTES:
                return buffer.getvalue()
            image = image.resize((1 + 3 * image.width // 4, 1 + 3 * image.height // 4))

    def _repr_png_(self) -> bytes:
        return self._png()

    def _png(self, dpi: float | Literal["figure"] = "figure") -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=dpi)
        return buffer.getvalue()
