"""Raw frames whose layout the caller states."""

import gzip

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from jotlight.errors import record_warnings
from jotlight.formats.stated_layout import frame_layout

FRAMES = np.random.default_rng(0).random((5, 6, 13)) < 0.4


def raw_bytes(rows, row_bytes, header=b"", footer=b""):
    """Return the bytes of frames, one row after the other: a slow twin of the encoder."""
    out = b""
    for frame in rows:
        out += header
        for row in frame:
            data = row.tobytes()
            out += data + b"\xaa" * (row_bytes - len(data))
        out += footer
    return out


def words_of(row, bit_order, word):
    """Return the words that hold the bits of a row, with ones as padding: a slow twin."""
    kind = np.dtype(word)
    size = 8 * kind.itemsize
    padded = np.concatenate([row, np.ones(-len(row) % size, bool)]).reshape(-1, size)
    order = padded if bit_order == "big" else padded[:, ::-1]
    return np.array([int("".join(str(int(bit)) for bit in bits), 2) for bits in order], kind)


@given(
    bit_order=st.sampled_from(["big", "little"]),
    word=st.sampled_from([None, "uint8", "<u2", ">u2", "<u4", ">u4", "<u8", ">u8"]),
    padding=st.integers(0, 3),
    header=st.binary(max_size=5),
    footer=st.binary(max_size=5),
    file_header=st.binary(max_size=5),
)
def test_bits_of_every_layout(
    tmp_path_factory, bit_order, word, padding, header, footer, file_header
):
    rows = [[words_of(row, bit_order, word or "u1") for row in frame] for frame in FRAMES]
    row_bytes = rows[0][0].nbytes + padding
    path = tmp_path_factory.mktemp("raw") / "camera.raw"
    path.write_bytes(b"\0" + file_header + raw_bytes(rows, row_bytes, header, footer))
    layout = jl.RawLayout(
        6,
        13,
        bit_order=bit_order,
        word=word,
        row_bytes=row_bytes,
        file_header=1 + len(file_header),
        frame_header=len(header),
        frame_footer=len(footer),
    )
    bits = jl.open(path, layout=layout)
    assert (bits.to_array() == FRAMES).all()
    assert (bits.counts() == FRAMES.sum(0)).all()
    assert (jl.open(path, layout=str(layout), frames=slice(3, 5)).to_array() == FRAMES[3:]).all()


@pytest.mark.parametrize("dtype", ["uint8", ">u2", "<u2", ">i4", "<u8"])
def test_numbers_of_every_type(tmp_path, dtype):
    numbers = np.arange(2 * 6 * 13).reshape(2, 6, 13).astype(dtype)
    path = tmp_path / "counts.dat"
    path.write_bytes(raw_bytes(numbers, 13 * numbers.itemsize + 3, b"HD"))
    layout = jl.RawLayout(6, 13, dtype=dtype, row_bytes=13 * numbers.itemsize + 3, frame_header=2)
    with pytest.warns(UserWarning, match="the sum of its 2 images"):
        assert (jl.open(path, layout=layout) == numbers.astype(int).sum(0)).all()
    readings = jl.open(path, layout=layout, bit_depth=8, frames=slice(1, 2))
    assert (readings.to_array() == numbers[1:].astype(int)).all()


def test_numbers_of_0_and_1_are_bits_on_request(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(FRAMES.astype(np.uint8).tobytes())
    bits = jl.open(path, layout="6x13,dtype=uint8", unpacked=True)
    assert (bits.to_array() == FRAMES).all()
    with pytest.raises(ValueError, match=r"unpacked: False .* numbers of uint8; leave out one"):
        jl.open(path, layout="6x13,dtype=uint8", unpacked=False)


@pytest.mark.parametrize(
    "options",
    [{"unpacked": True}, {"counts": True}, {"counts_scale": 255, "trials": 2}, {"bit_depth": 8}],
)
def test_numbers_need_a_type_in_the_layout(tmp_path, options):
    (tmp_path / "a.raw").write_bytes(bytes(12))
    expected = f"{next(iter(options))}: expected a layout of numbers, .*, such as 6x13,dtype=uint8"
    with pytest.raises(ValueError, match=expected):
        jl.open(tmp_path / "a.raw", layout="6x13", **options)


def test_files_of_a_folder_follow_each_other_and_each_has_a_header(tmp_path):
    packed = np.packbits(FRAMES, axis=2)
    for index, part in enumerate([packed[:2], packed[2:], packed]):
        (tmp_path / f"f{index + 9}.raw").write_bytes(b"HEAD" + part.tobytes())
    bits = jl.open(tmp_path, layout="6x13,file_header=4")
    assert (bits.to_array() == np.concatenate([FRAMES, FRAMES])).all()
    assert bits.provenance.format == "raw"
    assert bits.provenance.notes == (
        "the stated layout 6x13,file_header=4",
        "3 files in the natural order of their names, from f9.raw to f11.raw",
    )


@pytest.mark.parametrize(
    "names",
    [("1.img", "2.IMG"), ("frame1", "frame2"), ("1.raw", "2.raw"), ("a.9", "a.10")],
)
def test_a_folder_may_hold_files_of_any_extension(tmp_path, names):
    packed = np.packbits(FRAMES, axis=2)
    for name, part in zip(names, (packed[:3], packed[3:]), strict=True):
        (tmp_path / name).write_bytes(part.tobytes())
    (tmp_path / ".hidden").write_bytes(b"no frame")
    assert (jl.open(tmp_path, layout="6x13").to_array() == FRAMES).all()
    (tmp_path / "notes.txt").write_text("about the capture")
    if names[0] == "1.raw":
        assert len(jl.open(tmp_path, layout="6x13")) == 5
    else:
        expected = "or with files of one other extension, got .*, .*; move all other files out"
        with pytest.raises(ValueError, match=expected):
            jl.open(tmp_path, layout="6x13")


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"expected a folder with raw files .*, got none in it"):
        jl.open(tmp_path, layout="6x13")


def test_compressed_frames_are_read(tmp_path):
    path = tmp_path / "a.bin.gz"
    path.write_bytes(gzip.compress(b"HEAD" + np.packbits(FRAMES, axis=2).tobytes()))
    assert (jl.open(path, layout="6x13,file_header=4").to_array() == FRAMES).all()


def test_an_incomplete_frame_is_reported(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(b"HEAD" + np.packbits(FRAMES, axis=2).tobytes()[:-5])
    with pytest.warns(UserWarning, match="4 complete frames of 12 bytes; 7 bytes are left over"):
        bits = jl.open(path, layout="6x13,file_header=4")
    assert len(bits) == 4


def test_only_an_error_reports_that_no_frame_is_complete(tmp_path):
    (tmp_path / "1.raw").write_bytes(b"HEAD" + bytes(11))
    expected = "frames of 12 bytes each after a header of 4 bytes, got no complete one in its 15 b"
    with record_warnings() as warnings:
        with pytest.raises(ValueError, match=expected):
            jl.open(tmp_path / "1.raw", layout="6x13,file_header=4")
        (tmp_path / "3.raw").write_bytes(b"HEAD")
        with pytest.raises(ValueError, match="no complete one in any of 2 files"):
            jl.open(tmp_path, layout="6x13,file_header=4")
    assert warnings == []


def test_a_part_of_a_header_is_reported(tmp_path):
    (tmp_path / "1.raw").write_bytes(b"HEAD" + bytes(12))
    (tmp_path / "2.raw").write_bytes(b"HE")
    with pytest.warns(UserWarning, match=r"2\.raw: 0 complete frames of 12 bytes; 2 bytes are"):
        assert len(jl.open(tmp_path, layout="6x13,file_header=4")) == 1


def test_layout_and_format_exclude_each_other(tmp_path):
    path = tmp_path / "a.raw"
    path.write_bytes(bytes(12))
    with pytest.raises(ValueError, match="leave out one of layout and format"):
        jl.open(path, layout="6x13", format="swissspad2")
    with pytest.raises(ValueError, match='format "raw" needs the layout'):
        jl.open(path, format="raw")
    np.save(tmp_path / "a.npy", FRAMES)
    with pytest.raises(ValueError, match="expected raw frames, but its first bytes are those of"):
        jl.open(tmp_path / "a.npy", layout="6x13")


def test_the_command_line_takes_the_text_of_a_layout(tmp_path, run):
    path = tmp_path / "camera.raw"
    path.write_bytes(b"HEAD" + np.packbits(FRAMES, axis=2, bitorder="little").tobytes())
    layout = ["--layout", "6x13,bit_order=little,file_header=4"]
    run("convert", str(path), *layout, "-o", str(tmp_path / "cube.npy"))
    assert (jl.open(tmp_path / "cube.npy").to_array() == FRAMES).all()


def test_a_layout_survives_where_captures_are_opened_again(tmp_path):
    pytest.importorskip("dask")
    import pickle

    path = tmp_path / "camera.raw"
    path.write_bytes(np.packbits(FRAMES, axis=2).tobytes())
    bits = pickle.loads(pickle.dumps(jl.open(path, layout="6x13")))
    assert (bits.to_array() == FRAMES).all()
    assert (np.asarray(bits.to_dask()) == bits.packed).all()


def test_decoded_frames_do_not_share_the_raw_bytes():
    raw = np.full((1, 12), 1, np.uint8)
    decoded = frame_layout(jl.RawLayout(6, 13, bit_order="little")).decode(raw)
    assert decoded.max() == 128
    assert raw.max() == 1
