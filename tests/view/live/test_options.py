"""Live captures: files, folders, and pipes that grow."""

import os
import time

import numpy as np
import pytest

from jotlight.view.live.folder import list_files
from jotlight.view.live.options import STANDARD_INPUT, LiveOptions, open_live

RNG = np.random.default_rng(0)
FRAMES = RNG.integers(0, 256, (300, 6, 2), np.uint8)
SHAPE = LiveOptions(layout="6x13")


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing arrived"
        time.sleep(0.002)


@pytest.fixture
def opened():
    captures = []

    def opened(*arguments, **options):
        captures.append(open_live(*arguments, {"frames": 1}, **options))
        return captures[-1]

    yield opened
    for capture in captures:
        capture.close()


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


def test_raw_frames_of_a_camera_are_decoded(tmp_path, opened):
    jots = RNG.random((4, 256, 512)) < 0.3
    path = tmp_path / "a.bin"
    np.packbits(jots, axis=2, bitorder="little").tofile(path)
    live = opened(path, LiveOptions(format="swissspad2"))
    wait_for(lambda: live.frames.stop == 4)
    np.testing.assert_array_equal(live.part(range(4)).to_array(), jots)


def test_files_that_appear_in_a_folder_are_added_and_gaps_counted(tmp_path, opened):
    folder = tmp_path / "capture"
    folder.mkdir()

    def put(number):
        np.save(tmp_path / "new.npy", FRAMES[10 * number : 10 * number + 10])
        (tmp_path / "new.npy").rename(folder / f"f{number}.npy")

    put(0)
    live = opened(folder, LiveOptions())
    put(3)
    wait_for(lambda: live.frames.stop == 40)
    assert live.dropped == 20
    for number in (4, 6):
        put(number)
    wait_for(lambda: live.frames.stop == 70)
    assert live.dropped == 30
    np.testing.assert_array_equal(live.part(range(60, 70)).packed, FRAMES[60:70])


def put_files(folder, *numbers):
    for number in numbers:
        np.save(folder.parent / "new.npy", FRAMES[10 * number : 10 * number + 10])
        (folder.parent / "new.npy").rename(folder / f"f{number}.npy")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "capture").mkdir()
    return tmp_path / "capture"


def test_other_files_in_a_folder_are_ignored_and_named(folder, opened):
    (folder / "log.txt").write_text("begun")
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    (folder / "notes.txt").write_text("a bird")
    put_files(folder, 1)
    wait_for(lambda: live.frames.stop == 20)
    wait_for(lambda: live.remark)
    assert live.remark == "notes.txt: ignored, because it is no .npy"
    assert (live.dropped, live.problem, live.ended) == (0, None, False)
    assert live.facts()["remark"] == live.remark


def test_a_file_that_cannot_be_read_counts_as_dropped(folder, opened, monkeypatch):
    monkeypatch.setattr("jotlight.view.live.growing_file.MAX_FAILURES", 0.05)
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    (folder / "f1.npy").write_bytes(b"damaged")
    np.save(folder / "f2.npy", FRAMES[:10, :5])
    put_files(folder, 3)
    wait_for(lambda: live.frames.stop == 40)
    np.testing.assert_array_equal(live.part(range(30, 40)).packed, FRAMES[30:40])
    assert live.dropped == 20
    assert "expected frames of 6 x 16 jots" in live.remark


def test_lower_numbers_begin_a_new_sequence(folder, opened):
    put_files(folder, 7, 8)
    live = opened(folder, LiveOptions())
    wait_for(lambda: live.frames.stop == 20)
    put_files(folder, 0)
    wait_for(lambda: live.frames.stop == 30)
    put_files(folder, 1)
    wait_for(lambda: live.frames.stop == 40)
    np.testing.assert_array_equal(live.part(range(20, 40)).packed, FRAMES[:20])
    assert live.dropped == 0
    assert "f0.npy" in live.remark


def test_a_file_that_comes_late_stays_dropped(folder, opened):
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    put_files(folder, 2)
    wait_for(lambda: live.frames.stop == 30)
    put_files(folder, 1)
    wait_for(lambda: live.remark)
    put_files(folder, 3)
    wait_for(lambda: live.frames.stop == 40)
    assert live.dropped == 10
    assert live.remark == "f1.npy: came late, so its frames stay dropped"


def test_a_backlog_beyond_the_memory_is_dropped_and_counted(folder, opened):
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    live.ring.capacity = 100  # as if the memory were small
    live.ring._memory = np.zeros(100 * 12, np.uint8)
    hidden = folder.parent / "later"
    hidden.mkdir()
    put_files(hidden, *range(1, 30))
    for path in sorted(hidden.iterdir(), key=lambda path: int(path.stem[1:])):
        path.rename(folder / path.name)
    wait_for(lambda: live.frames.stop == 300)
    assert live.dropped % 10 == 0
    np.testing.assert_array_equal(live.part(range(290, 300)).packed, FRAMES[290:])


def test_names_may_count_frames(folder, opened):
    for first in (0, 10, 20, 40):
        np.save(folder.parent / "new.npy", FRAMES[first : first + 10])
        (folder.parent / "new.npy").rename(folder / f"frame{first:05}.npy")
        if first == 0:
            live = opened(folder, LiveOptions())
    wait_for(lambda: live.frames.stop == 50)
    assert live.dropped == 10


RAW = RNG.integers(0, 256, (12, 256, 64), np.uint8)


def test_raw_files_in_a_folder_are_followed_while_they_grow(folder, opened):
    path = folder / "RAW0.bin"
    path.write_bytes(RAW[:2].tobytes())
    live = opened(folder, LiveOptions(format="swissspad2"))
    wait_for(lambda: live.frames.stop == 2)
    with path.open("ab", buffering=0) as file:
        file.write(RAW[2:5].tobytes() + b"123")
        wait_for(lambda: live.frames.stop == 5)
        file.write(RAW[5].tobytes()[3:])
        wait_for(lambda: live.frames.stop == 6)
        file.write(RAW[6:8].tobytes() + b"1")
    (folder / "RAW1.bin").write_bytes(RAW[8:].tobytes())
    wait_for(lambda: live.frames.stop == 12)
    expected = np.unpackbits(RAW[8:], axis=2, bitorder="little")
    np.testing.assert_array_equal(live.part(range(8, 12)).to_array(), expected)
    assert live.dropped == 0
    assert live.remark.endswith("1 bytes are left over and not used")


def test_an_empty_file_is_passed_over_when_the_next_one_appears(folder, opened, monkeypatch):
    monkeypatch.setattr("jotlight.view.live.growing_file.MAX_FAILURES", 0.05)
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    (folder / "f1.npy").touch()
    put_files(folder, 2)
    wait_for(lambda: live.frames.stop == 30)
    assert live.dropped == 10
    assert "f1.npy" in live.remark


def test_files_that_listings_lack_while_they_appear_are_not_dropped(folder, opened, monkeypatch):
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    put_files(folder.parent, 1, 2, 3, 4, 5)
    lacking = iter([(2, 4, 5), (4,)])

    def list_some(_, seen=()):
        absent = {f"f{number}.npy" for number in next(lacking, ())}
        return [each for each in list_files(folder.parent, seen) if each[0][1] not in absent]

    monkeypatch.setattr("jotlight.view.live.folder.list_files", list_some)
    wait_for(lambda: live.frames.stop == 60)
    np.testing.assert_array_equal(live.part(range(60)).packed, FRAMES[:60])
    assert (live.dropped, live.remark) == (0, None)


def test_a_folder_without_captures_is_refused(folder, monkeypatch):
    monkeypatch.setattr("jotlight.view.live.growing_file.MAX_FAILURES", 0.05)
    (folder / "notes.txt").write_text("a bird")
    with pytest.raises(ValueError, match=r"notes\.txt"):
        open_live(folder, LiveOptions(), {"frames": 1})


def test_the_order_of_files_is_that_of_their_numbers(tmp_path):
    for name in ("a2.bin", "a10.bin", "a1.bin", "note.txt"):
        (tmp_path / name).touch()
    (tmp_path / "a3.bin").symlink_to("/etc/passwd")
    names = [path.name for _, path in list_files(tmp_path)]
    assert names == ["note.txt", "a1.bin", "a2.bin", "a10.bin"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (LiveOptions(layout="6"), "layout: expected rows and columns"),
        (LiveOptions(layout="0x5"), "rows: expected at least 1"),
        (LiveOptions(layout="999999x999999"), "layout: expected frames of at most"),
        (LiveOptions(layout="6x13", format="swissspad2"), "leave out one of"),
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
