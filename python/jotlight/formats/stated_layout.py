"""Raw frames whose layout the caller states, for cameras without a format of their own."""

import dataclasses
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Packed
from jotlight.formats.capture import Capture
from jotlight.formats.files.file_lists import list_files
from jotlight.formats.files.file_sequence import describe_files
from jotlight.formats.format import Format, FrameLayout
from jotlight.formats.frames.count_stacks import as_count_stack
from jotlight.formats.frames.packing import are_bits
from jotlight.formats.frames.raw_layout import RawLayout
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.raw import OTHER_EXTENSIONS, read_raw
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.provenance import Provenance


def frame_layout(layout: RawLayout) -> FrameLayout:
    """Return the layout of raw frames, with the function that decodes them."""
    kind = layout.number_type
    used = layout.used_row_bytes
    row_bytes = used if layout.row_bytes is None else layout.row_bytes

    def rows(raw: Packed) -> Packed:
        """Return the bytes of all rows, (n, H, used), without padding."""
        first = layout.frame_header
        frames = raw[:, first : first + layout.rows * row_bytes]
        return frames.reshape(len(raw), layout.rows, row_bytes)[:, :, :used]

    def decode_bits(raw: Packed) -> Packed:
        """Return packed frames: the first jot becomes the most significant bit of a byte."""
        words = np.array(rows(raw), order="C").view(layout.word_type)
        in_order = words.astype(words.dtype.newbyteorder(layout.bit_order), copy=False)
        packed = np.ascontiguousarray(in_order.view(np.uint8)[:, :, : -(-layout.columns // 8)])
        if layout.bit_order == "little":
            engine.reverse_bytes(packed.reshape(-1), None)
        return packed

    def decode_numbers(raw: Packed) -> npt.NDArray[np.generic]:
        assert kind is not None, "only numbers are decoded here"
        numbers = np.ascontiguousarray(rows(raw)).view(kind)
        return numbers.astype(kind.newbyteorder("="), copy=False)

    return FrameLayout(
        shape=(layout.rows, -(-layout.columns // 8) if kind is None else layout.columns),
        width=layout.columns,
        frame_bytes=layout.frame_bytes,
        decode=decode_bits if kind is None else decode_numbers,
        file_header=layout.file_header,
        dtype=np.uint8 if kind is None else kind.newbyteorder("="),
    )


def bits_layout(layout: RawLayout) -> FrameLayout:
    """Return the layout of raw frames of bits, or of numbers each of which is one bit.

    Decoding numbers other than 0 and 1, or 0 and 255, raises ValueError.
    """
    stored = frame_layout(layout)
    if layout.number_type is None:
        return stored

    def decode(raw: Packed) -> Packed:
        numbers = stored.decode(raw)
        if not are_bits(numbers):
            raise ValueError(
                f"layout: expected one bit in each number, 0 and 1 or 0 and 255, got "
                f"{numbers.min()} to {numbers.max()}"
            )
        return np.packbits(numbers.astype(np.bool_), axis=2)

    shape = layout.rows, -(-layout.columns // 8)
    return dataclasses.replace(stored, shape=shape, decode=decode, dtype=np.uint8)


def open_raw(path: Path, options: ReadingOptions) -> Capture:
    """Return the frames of a file, or of all files of a folder in natural order."""
    if options.layout is None:
        raise ValueError(
            'layout: the format "raw" needs the layout of its frames, such as '
            'layout="256x512" (--layout 256x512)'
        )
    layout = RawLayout.parse(options.layout)
    files = list_files(path, OTHER_EXTENSIONS, "raw", or_others=True)
    frames = read_raw(path, files, frame_layout(layout))
    provenance = Provenance(RAW.name, path.name, (f"the stated layout {layout}",))
    if len(files) > 1:
        provenance = provenance.with_notes(describe_files(path, files))
    if layout.number_type is not None:
        return as_count_stack(frames, provenance, is_stack=True)
    return Bits(frames, layout.columns, provenance=provenance)


RAW = Format(
    "raw",
    "raw frames of a layout that the caller states",
    open=open_raw,
    other_extensions=OTHER_EXTENSIONS,
    is_raw=True,
)
