"""The layout of raw frames, and its text."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from jotlight.formats.frames.raw_layout import as_layout

SIZES = st.integers(0, 100)


@given(
    rows=st.integers(1, 99),
    columns=st.integers(1, 99),
    kind=st.sampled_from([None, "uint8", ">u2", "<i4"]),
    word=st.sampled_from([None, "<u4", ">u2"]),
    padding=st.none() | SIZES,
    sizes=st.tuples(SIZES, SIZES, SIZES),
)
def test_text_of_a_layout_states_all_of_it(rows, columns, kind, word, padding, sizes):
    stored = {"dtype": kind} if kind else {"word": word}
    layout = jl.RawLayout(rows, columns, **stored)
    row_bytes = None if padding is None else layout.used_row_bytes + padding
    names = "file_header", "frame_header", "frame_footer"
    stated = dict(zip(names, sizes, strict=True))
    layout = jl.RawLayout(rows, columns, row_bytes=row_bytes, **stored, **stated)
    assert jl.RawLayout.parse(str(layout)) == layout
    in_rows = layout.used_row_bytes + (padding or 0)
    assert layout.frame_bytes == rows * in_rows + sizes[1] + sizes[2]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("6", "expected rows and columns such as 256x512"),
        ("6x", "expected rows and columns"),
        ("-6x8", "expected rows and columns"),
        ("6x8,8", "expected rows and columns"),
        ("6x8,row_bytes=1,row_bytes=2", "expected rows and columns"),
        ("6x8,pitch=1", "expected .*row_bytes"),
        ("0x8", "rows: expected at least 1"),
        ("6x8,bit_order=msb", "bit_order: expected one of big, little"),
        ("6x8,row_bytes=0", "row_bytes: expected at least 1"),
        ("6x8,dtype=uint16,row_bytes=15", "row_bytes: expected at least 16"),
        ("6x8,row_bytes=one", "expected a whole number for row_bytes"),
        ("6x8,file_header=1e9", "expected a whole number for file_header"),
        ("6x8,file_header=99999999999", "file_header: expected a whole number from 0 to"),
        ("6x8,dtype=float32", "dtype: expected a type of whole numbers"),
        ("6x8,dtype=O", "dtype: expected a type of whole numbers"),
        ("6x8,dtype=thing", "dtype: expected a type of whole numbers"),
        (f"6x8,dtype={'1' * 5000}", "dtype: expected a type of whole numbers"),
        ("6x8,dtype=uint8,bit_order=little", "bit_order: expected none for numbers of uint8"),
        ("6x8,dtype=uint8,word=<u4", "word: expected none for numbers of uint8"),
        ("6x8,word=<f4", "word: expected a type of whole numbers"),
        ("6x8,word=<u4,row_bytes=3", "row_bytes: expected at least 4"),
        ("99999999x99999999", "expected frames of at most"),
    ],
)
def test_wrong_texts_are_refused(text, expected):
    with pytest.raises(ValueError, match=expected):
        jl.RawLayout.parse(text)


def test_wrong_types_are_refused():
    with pytest.raises(TypeError, match=r"rows: expected a whole number, got 2.5"):
        jl.RawLayout(2.5, 8)
    with pytest.raises(ValueError, match="dtype: expected a type of whole numbers"):
        jl.RawLayout(2, 8, dtype=np.uint8)
    with pytest.raises(TypeError, match=r"layout: expected a jotlight\.RawLayout or a text"):
        as_layout((6, 8))
