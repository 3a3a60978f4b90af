"""Tables of poses in text files."""

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

_MAX_BYTES = 1 << 28
"""Maximum size of a table: 10⁶ frames take less than a third."""

_SEPARATOR = re.compile(r"\s*,\s*|\s+")


def read_poses(path: Path) -> npt.NDArray[np.float64]:
    r"""Return the poses in a text file, (T, 2) or (T, 4).

    Each line describes a frame: the shift in rows and in columns in pixels, and optionally both the
    angle in degrees and the zoom. Commas or white space separate the numbers, as in a file of
    ``numpy.savetxt``. Lines that begin with # are ignored.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When the file is not such a table.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "poses.csv"
    >>> _ = path.write_text("# rows, columns\n0, 0\n1.5, -2\n")
    >>> read_poses(path).tolist()
    [[0.0, 0.0], [1.5, -2.0]]
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"{path}: expected at most {_MAX_BYTES} bytes")
    lines = path.read_text("utf-8", errors="replace").splitlines()
    texts = [line.strip() for line in lines]
    rows = [_SEPARATOR.split(text) for text in texts if text and not text.startswith("#")]
    try:
        table = np.array(rows, np.float64)
    except ValueError as error:
        raise ValueError(
            f"{path}: expected numbers that commas or spaces separate, and as many in each line "
            f"({error})"
        ) from error
    if table.ndim != 2 or table.shape[1] not in (2, 4):
        raise ValueError(
            f"{path}: expected 2 or 4 numbers in each line: rows, columns, and optionally both "
            f"degrees and zoom; got shape {table.shape}"
        )
    return table
