"""The class of all figures. Import this module late, because matplotlib is large."""

import io
from typing import Literal

from matplotlib.figure import Figure as MatplotlibFigure


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

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png")
        return buffer.getvalue()
