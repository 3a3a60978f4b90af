"""Live captures: files, folders, and pipes that grow."""

import os

import numpy as np
import pytest

from jotlight.view.live.options import STANDARD_INPUT, LiveOptions, open_live
from waiting import wait_for

RNG = np.random.default_rng(0)
FRAMES = RNG.integers(0, 256, (300, 6, 2), np.uint8)
SHAPE = LiveOptions(layout="6x13")


def test_a_growing_file_is_followed_to_the_last_whole_frame(tmp_path, opened):
    path = tmp_path / "a.bin"
    path.write_bytes(FRAMES[:10].tobytes())
    live = opened(path, SHAPE)
    with path.open("ab", buffering=0) as file:
        data = FRAMES[10:].tobytes()
        for start in range(0, len(data), 1001):
            file.write(data[start : start + 1001])
    wait_for(lambda: live.frames.stop == 300)
    np.testing.assert_array_equal(live.part(live.frames).packed, FRAMES)
    assert live.part(range(290, 300)).shape == (10, 6, 13)
    assert (live.dropped, live.problem, live.ended) == (0, None, False)
    assert live.shape == (6, 13)


def test_frames_beyond_the_memory_are_dropped_and_counted(tmp_path, opened, monkeypatch):
    path = tmp_path / "a.bin"
    path.write_bytes(FRAMES[:4].tobytes())
    live = opened(path, LiveOptions(layout="6x13", history=1))
    rows = 6 * 2
    live.ring.capacity = 100  # as if the memory were small
    live.ring._memory = np.zeros(100 * rows, np.uint8)
    with path.open("ab") as file:
        file.write(FRAMES[4:].tobytes())
    wait_for(lambda: live.frames.stop == 300)
    assert live.dropped + len(live.frames) + 4 >= 300 - 25
    assert live.dropped == pytest.approx(196, abs=4)
    np.testing.assert_array_equal(live.part(range(290, 300)).packed, FRAMES[290:])


def test_a_long_file_begins_at_its_newest_frames(tmp_path, opened):
    path = tmp_path / "a.bin"
    with path.open("wb") as file:
        file.truncate(3 << 20)
        file.seek(0, 2)
        file.write(FRAMES[:1].tobytes())
    live = opened(path, LiveOptions(layout="8x8", history=1))
    wait_for(lambda: live.frames.stop == ((3 << 20) + 12) // 8)
    assert live.dropped == 0


def test_a_file_that_becomes_shorter_is_reported(tmp_path, opened):
    path = tmp_path / "a.bin"
    path.write_bytes(FRAMES.tobytes())
    live = opened(path, SHAPE)
    wait_for(lambda: live.frames.stop == 300)
    os.truncate(path, 10)
    wait_for(lambda: live.ended)
    assert "shorter" in live.problem
    assert live.frames.stop == 300


def test_a_file_that_vanishes_is_reported_after_its_last_frame(tmp_path, opened):
    path = tmp_path / "a.bin"
    path.write_bytes(FRAMES[:10].tobytes())
    live = opened(path, SHAPE)
    with path.open("ab", buffering=0) as file:
        file.write(FRAMES[10:].tobytes())
        path.unlink()
    wait_for(lambda: live.ended)
    assert "the file is gone" in live.problem
    assert live.frames.stop == 300


def test_a_file_that_is_replaced_is_reported(tmp_path, opened):
    path = tmp_path / "a.bin"
    path.write_bytes(FRAMES.tobytes())
    live = opened(path, SHAPE)
    (tmp_path / "b.bin").write_bytes(FRAMES.tobytes())
    (tmp_path / "b.bin").replace(path)
    wait_for(lambda: live.ended)
    assert "another file has replaced it" in live.problem


def test_a_folder_that_vanishes_is_reported(tmp_path, opened):
    folder = tmp_path / "frames"
    folder.mkdir()
    np.save(folder / "f0.npy", FRAMES[:4])
    live = opened(folder, LiveOptions(arguments={"width": 13}))
    wait_for(lambda: live.frames.stop == 4)
    folder.rename(tmp_path / "moved")
    wait_for(lambda: live.ended)
    assert "frames" in live.problem


def test_standard_input_is_read_to_its_end(opened, monkeypatch):
    read, write = os.pipe()
    with os.fdopen(read, "rb") as stdin, os.fdopen(write, "wb") as out:
        monkeypatch.setattr("sys.stdin", stdin)
        out.write(FRAMES.tobytes() + b"123")
        out.close()
        live = opened(STANDARD_INPUT, SHAPE)
        wait_for(lambda: live.ended)
    np.testing.assert_array_equal(live.part(range(300)).packed, FRAMES)
    assert "3 of 12 bytes" in live.problem


def test_a_npy_that_is_being_written_is_followed(tmp_path, opened):
    path = tmp_path / "a.npy"
    with path.open("wb") as file:
        header = {"descr": "|u1", "fortran_order": False, "shape": (10**6, 6, 2)}
        np.lib.format.write_array_header_1_0(file, header)
        file.write(FRAMES[:50].tobytes())
    live = opened(path, LiveOptions())
    wait_for(lambda: live.frames.stop == 50)
    np.testing.assert_array_equal(live.part(range(50)).packed, FRAMES[:50])


def test_the_width_of_a_npy_may_be_stated(tmp_path, opened):
    np.save(tmp_path / "a.npy", FRAMES)
    live = opened(tmp_path / "a.npy", LiveOptions(arguments={"width": 13}))
    wait_for(lambda: live.frames.stop == 300)
    assert live.part(range(4)).shape == (4, 6, 13)


@pytest.mark.parametrize("options", [SHAPE, LiveOptions(format="swissspad2")])
def test_the_header_of_a_npy_is_never_read_as_frames(tmp_path, options):
    np.save(tmp_path / "a.bin", FRAMES)
    (tmp_path / "a.bin.npy").rename(tmp_path / "a.bin")
    with pytest.raises(ValueError, match=r"a\.bin is a \.npy, whose header states"):
        open_live(tmp_path / "a.bin", options, {"frames": 1})


def test_the_header_in_standard_input_is_never_read_as_frames(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", FRAMES)
    with (tmp_path / "a.npy").open("rb") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        with pytest.raises(ValueError, match=r"standard input is a \.npy, whose header states"):
            open_live(STANDARD_INPUT, SHAPE, {"frames": 1})


@pytest.mark.parametrize("source", ["file", "folder", "standard input"])
def test_raw_frames_of_a_stated_layout_are_decoded(tmp_path, opened, monkeypatch, source):
    frames = RNG.random((3, 6, 13)) < 0.5
    rows = np.packbits(frames, axis=2, bitorder="little")
    content = b"HEAD" + b"".join(b"F" + frame.tobytes() + b"E." for frame in rows)
    layout = "6x13,bit_order=little,file_header=4,frame_header=1,frame_footer=2"
    file = tmp_path / "a1.raw"
    file.write_bytes(content)
    path = {"file": file, "folder": tmp_path, "standard input": STANDARD_INPUT}[source]
    with file.open("rb") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        live = opened(path, LiveOptions(layout=layout, history=1))
        wait_for(lambda: len(live.frames) == 3)
    np.testing.assert_array_equal(live.part(range(3)).to_array(), frames)


@pytest.mark.parametrize("source", ["file", "folder", "standard input"])
@pytest.mark.parametrize(("dtype", "one"), [("uint8", 255), (">u2", 1)])
def test_numbers_of_one_bit_are_packed(tmp_path, opened, monkeypatch, source, dtype, one):
    frames = RNG.random((3, 6, 13)) < 0.5
    file = tmp_path / "a1.raw"
    file.write_bytes(b"HEAD" + (one * frames).astype(dtype).tobytes())
    path = {"file": file, "folder": tmp_path, "standard input": STANDARD_INPUT}[source]
    layout = f"6x13,dtype={dtype},file_header=4"
    with file.open("rb") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        live = opened(path, LiveOptions(layout=layout, history=1, arguments={"unpacked": True}))
        wait_for(lambda: len(live.frames) == 3)
    np.testing.assert_array_equal(live.part(range(3)).to_array(), frames)
    assert live.shape == (6, 13)


@pytest.mark.parametrize("is_sampled", [True, False])
def test_only_windows_with_numbers_that_are_no_bits_fail(tmp_path, opened, monkeypatch, is_sampled):
    monkeypatch.setattr("jotlight.view.live.ring._SAMPLE_SECONDS", 0 if is_sampled else 1e9)
    path = tmp_path / "a.raw"
    frames = (RNG.random((3, 6, 13)) < 0.5).astype(np.uint8)
    frames[1] = 7
    path.write_bytes(frames[:2].tobytes())  # the last frame of each part may be sampled
    options = LiveOptions(layout="6x13,dtype=uint8", arguments={"unpacked": True})
    live = opened(path, options)
    with path.open("ab") as file:
        file.write(frames[2:].tobytes())
    wait_for(lambda: len(live.frames) == 3)
    message = "layout: expected one bit in each number, 0 and 1 or 0 and 255, got 7 to 7"
    with pytest.raises(ValueError, match=message):
        live.part(range(1, 2))
    with pytest.raises(ValueError, match="got 0 to 7"):
        live.part(range(3))
    for index in (0, 2):
        np.testing.assert_array_equal(
            live.part(range(index, index + 1)).to_array()[0], frames[index]
        )
    assert (live.problem, live.ended) == (None, False)


def test_raw_frames_of_a_camera_are_decoded(tmp_path, opened):
    jots = RNG.random((4, 256, 512)) < 0.3
    path = tmp_path / "a.bin"
    np.packbits(jots, axis=2, bitorder="little").tofile(path)
    live = opened(path, LiveOptions(format="swissspad2"))
    wait_for(lambda: live.frames.stop == 4)
    np.testing.assert_array_equal(live.part(range(4)).to_array(), jots)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (LiveOptions(layout="6"), "layout: expected rows and columns"),
        (LiveOptions(layout="0x5"), "rows: expected at least 1"),
        (LiveOptions(layout="999999x999999"), "layout: expected frames of at most"),
        (LiveOptions(layout="6x13", format="swissspad2"), "leave out one of"),
        (LiveOptions(layout="6x13,dtype=uint8"), "got numbers of uint8; --unpacked reads"),
        (LiveOptions(layout="6x13", arguments={"unpacked": True}), "unpacked: expected a layout"),
        (
            LiveOptions(format="swissspad2", arguments={"unpacked": True}),
            "--unpacked is for a --layout of numbers or a folder of files",
        ),
        (LiveOptions(format="nope"), "format: expected one of"),
        (LiveOptions(history=0), "history: expected 1"),
        (LiveOptions(), "expected raw frames"),
        (LiveOptions(format="hdf5"), "spad512s, or npy, since --follow reads no other"),
    ],
)
def test_bad_options_are_refused(tmp_path, options, message):
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(1000))
    with pytest.raises(ValueError, match=message):
        open_live(path, options, {"frames": 1})


@pytest.mark.parametrize(
    "header",
    [b"(" * 1000, b"{'shape': 3}", b"{'descr': '|O', 'fortran_order': False, 'shape': (1, 2, 3)}"],
)
def test_hostile_headers_of_npy_are_refused(tmp_path, header):
    path = tmp_path / "a.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(99))
    with pytest.raises(ValueError, match="expected raw frames"):
        open_live(path, LiveOptions(), {"frames": 1})


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
def test_a_named_pipe_is_refused_with_advice(tmp_path, opened):
    path = tmp_path / "frames"
    os.mkfifo(path)
    with pytest.raises(ValueError, match="got a pipe; redirect it to standard input: jotlight"):
        opened(path, SHAPE)
