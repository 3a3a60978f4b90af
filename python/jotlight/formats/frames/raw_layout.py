"""The layout of raw frames. The caller states it, because the files have no known header."""

import dataclasses
import re
from typing import Any, Self

import numpy as np

from jotlight.checks import shown, whole_number, whole_number_in_range
from jotlight.parameter_names import check_choice

MAX_FRAME_BYTES = 1 << 26
"""Maximum number of bytes of a raw frame, and of a header."""

_BIT_ORDERS = ("big", "little")

_NUMBERS = "row_bytes", "file_header", "frame_header", "frame_footer"

_FORM = "rows and columns such as 256x512, and then name=value, such as 256x512,bit_order=little"


@dataclasses.dataclass(frozen=True)
class RawLayout:
    """The layout of frames in files that have no header, or one that jotlight does not know.

    Each file begins with a whole frame. Its size determines the number of frames.

    Parameters
    ----------
    rows, columns : int
        H and W, the numbers of jots of a frame.
    bit_order : {"big", "little"}
        Which bit of a byte is the first jot: the most significant ("big") or the least significant
        one ("little"), as in `numpy.packbits`.
    word : str, optional
        The type of the words in which a camera writes the bits, such as ``"<u4"`` or ``">u2"``, if
        each row begins at a new word. `bit_order` then states which bit of a word is the first jot.
        Default: words of one byte.
    dtype : str, optional
        The type of whole numbers, such as ``"uint8"`` or ``">u2"``, if each jot has a number in
        place of a bit. The numbers are counts. `jotlight.open` takes them as readings with
        `bit_depth`, and as bits with `unpacked`. Default: each byte holds eight bits.
    row_bytes : int, optional
        Distance in bytes from one row to the next. Default: that of rows without padding.
    file_header : int
        Number of bytes before the first frame of each file.
    frame_header, frame_footer : int
        Numbers of bytes before and after the rows of each frame.

    Raises
    ------
    TypeError, ValueError
        When a parameter has a wrong type, or is out of range.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "camera.raw"
    >>> frames = np.random.default_rng(0).random((5, 6, 13)) < 0.5
    >>> _ = path.write_bytes(b"HEADER" + np.packbits(frames, axis=2).tobytes())
    >>> bits = jl.open(path, layout=jl.RawLayout(6, 13, file_header=6))
    >>> bits, bool((bits.to_array() == frames).all())
    (<Bits: 5 frames of 6 x 13 jots>, True)
    """

    rows: int
    columns: int
    bit_order: str = dataclasses.field(default="big", kw_only=True)
    word: str | None = dataclasses.field(default=None, kw_only=True)
    dtype: str | None = dataclasses.field(default=None, kw_only=True)
    row_bytes: int | None = dataclasses.field(default=None, kw_only=True)
    file_header: int = dataclasses.field(default=0, kw_only=True)
    frame_header: int = dataclasses.field(default=0, kw_only=True)
    frame_footer: int = dataclasses.field(default=0, kw_only=True)

    def __post_init__(self) -> None:
        whole_number("rows", self.rows, 1)
        whole_number("columns", self.columns, 1)
        check_choice("bit_order", self.bit_order, _BIT_ORDERS)
        for name in ("file_header", "frame_header", "frame_footer"):
            whole_number_in_range(name, getattr(self, name), 0, MAX_FRAME_BYTES)
        for name, default in (("bit_order", "big"), ("word", None)):
            value = getattr(self, name)
            if self.number_type is not None and value != default:
                raise ValueError(
                    f"{name}: expected none for numbers of {self.dtype}, got {shown(value)}; leave "
                    'it out, and state the order of bytes in dtype, such as ">u2"'
                )
        if self.row_bytes is not None:
            whole_number("row_bytes", self.row_bytes, self.used_row_bytes)
        if self.frame_bytes > MAX_FRAME_BYTES:
            raise ValueError(
                f"layout: expected frames of at most {MAX_FRAME_BYTES} bytes, got "
                f"{self.frame_bytes}"
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the layout that a text states.

        Parameters
        ----------
        text : str
            The rows and columns, and then the other parameters with their names. Commas separate
            them.

        Raises
        ------
        ValueError
            When the text has another form, or a value is out of range.

        Examples
        --------
        >>> layout = jl.RawLayout.parse("96x77, bit_order=little, frame_header=16")
        >>> layout == jl.RawLayout(96, 77, bit_order="little", frame_header=16)
        True
        """
        size, *others = text.replace(" ", "").split(",")
        match = re.fullmatch(r"(\d{1,9})[x×](\d{1,9})", size, re.ASCII)
        pairs = [each.split("=", 1) for each in others]
        names = [pair[0] for pair in pairs]
        known = [field.name for field in dataclasses.fields(cls)][2:]
        if match is None or any(len(pair) == 1 for pair in pairs) or len({*names}) < len(names):
            raise ValueError(f"layout: expected {_FORM}, got {text!r:.100}")
        for name in names:
            check_choice("layout", name, known)
        values: dict[str, Any] = dict(pairs)
        values |= {name: _whole(name, values[name]) for name in _NUMBERS if name in values}
        return cls(int(match[1]), int(match[2]), **values)

    @property
    def number_type(self) -> np.dtype[np.generic] | None:
        """The type of the numbers, or None for bits."""
        return None if self.dtype is None else _whole_type("dtype", self.dtype)

    @property
    def word_type(self) -> np.dtype[np.generic]:
        """The type of the words that hold bits."""
        return _whole_type("word", "uint8" if self.word is None else self.word)

    @property
    def used_row_bytes(self) -> int:
        """Number of bytes of a row that hold jots."""
        kind = self.number_type
        if kind is not None:
            return self.columns * kind.itemsize
        word_bytes = self.word_type.itemsize
        return -(-self.columns // (8 * word_bytes)) * word_bytes

    @property
    def frame_bytes(self) -> int:
        """Number of bytes of a raw frame."""
        row_bytes = self.used_row_bytes if self.row_bytes is None else self.row_bytes
        return self.frame_header + self.rows * row_bytes + self.frame_footer

    def __str__(self) -> str:
        """Return the text that :meth:`parse` reads."""
        fields = dataclasses.fields(self)[2:]
        values = {each.name: getattr(self, each.name) for each in fields}
        stated = [each.name for each in fields if values[each.name] != each.default]
        size = f"{self.rows}x{self.columns}"
        return ",".join([size, *(f"{name}={values[name]}" for name in stated)])


def as_layout(layout: RawLayout | str | None) -> RawLayout | None:
    """Return the layout that a layout or a text states, or None for None.

    Raises
    ------
    TypeError, ValueError
        When it is neither, or the text states no layout.
    """
    if isinstance(layout, str):
        return RawLayout.parse(layout)
    if not isinstance(layout, RawLayout | None):
        raise TypeError(
            'layout: expected a jotlight.RawLayout or a text such as "256x512", got '
            f"{shown(layout)}"
        )
    return layout


def _whole_type(name: str, text: object) -> np.dtype[np.generic]:
    """Return the type of whole numbers that a text states."""
    try:
        kind = np.dtype(text if isinstance(text, str) else object)
    except (TypeError, ValueError, SyntaxError):
        kind = np.dtype(object)
    if kind.kind not in "iu":
        raise ValueError(
            f'{name}: expected a type of whole numbers, such as "uint8" or ">u2", got {shown(text)}'
        )
    return kind


def _whole(name: str, text: str) -> int:
    """Return the whole number that a text states."""
    if not re.fullmatch(r"\d{1,12}", text, re.ASCII):
        raise ValueError(f"layout: expected a whole number for {name}, got {text!r:.100}")
    return int(text)
