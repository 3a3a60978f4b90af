"""Live views of folders, whose files appear and grow."""

import numpy as np
import pytest

from jotlight.view.live.folder import list_files, open_first
from jotlight.view.live.options import LiveOptions, open_live
from waiting import wait_for

RNG = np.random.default_rng(0)
FRAMES = RNG.integers(0, 256, (300, 6, 2), np.uint8)
RAW = RNG.integers(0, 256, (12, 256, 64), np.uint8)


def put_files(folder, *numbers):
    for number in numbers:
        np.save(folder.parent / "new.npy", FRAMES[10 * number : 10 * number + 10])
        (folder.parent / "new.npy").rename(folder / f"f{number}.npy")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "capture").mkdir()
    return tmp_path / "capture"


def test_files_that_appear_in_a_folder_are_added_and_gaps_counted(folder, opened):
    put_files(folder, 0)
    live = opened(folder, LiveOptions())
    put_files(folder, 3)
    wait_for(lambda: live.frames.stop == 40)
    assert live.dropped == 20
    put_files(folder, 4, 6)
    wait_for(lambda: live.frames.stop == 70)
    assert live.dropped == 30
    np.testing.assert_array_equal(live.part(range(60, 70)).packed, FRAMES[60:70])


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


def test_extensions_may_count_files(folder, opened):
    (folder / "a.001").write_bytes(FRAMES[:10].tobytes())
    height, width = FRAMES.shape[1], 8 * FRAMES.shape[2]
    live = opened(folder, LiveOptions(layout=f"{height}x{width}"))
    (folder / "a.003").write_bytes(FRAMES[20:30].tobytes())
    wait_for(lambda: live.frames.stop == 30)
    assert (live.dropped, live.remark) == (10, None)
    np.testing.assert_array_equal(live.part(range(20, 30)).packed, FRAMES[20:30])


def test_names_may_count_frames(folder, opened):
    for first in (0, 10, 20, 40):
        np.save(folder.parent / "new.npy", FRAMES[first : first + 10])
        (folder.parent / "new.npy").rename(folder / f"frame{first:05}.npy")
        if first == 0:
            live = opened(folder, LiveOptions())
    wait_for(lambda: live.frames.stop == 50)
    assert live.dropped == 10


def test_a_file_without_a_number_says_nothing_about_the_numbers_of_others(folder, opened):
    def put(name):
        np.save(folder.parent / "new.npy", FRAMES[:10])
        (folder.parent / "new.npy").rename(folder / name)

    put("frame00000.npy")
    live = opened(folder, LiveOptions())
    put("dark.npy")
    wait_for(lambda: live.frames.stop == 20)
    put("frame00010.npy")
    wait_for(lambda: live.frames.stop == 30)
    assert live.dropped == 0


def test_a_file_that_gets_another_name_while_it_is_opened_is_read(folder, opened, monkeypatch):
    put_files(folder, 7)

    def open_and_rename(*arguments):
        found = open_first(*arguments)
        (folder / "f7.npy").rename(folder / "f3.npy")
        return found

    monkeypatch.setattr("jotlight.view.live.options.open_first", open_and_rename)
    assert opened(folder, LiveOptions()).frames == range(10)


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


def test_frames_of_a_file_beyond_the_memory_are_not_read(folder, opened):
    for name in ("RAW0.bin", "RAW1.bin"):
        (folder.parent / name).write_bytes(RAW.tobytes() * 10)  # 120 frames, of which 64 fit
    (folder.parent / "RAW0.bin").rename(folder / "RAW0.bin")
    live = opened(folder, LiveOptions(format="swissspad2", history=1))
    wait_for(lambda: live.frames.stop == 120)
    assert live.dropped == 0  # the capture begins at the frames that fit
    (folder.parent / "RAW1.bin").rename(folder / "RAW1.bin")
    wait_for(lambda: live.frames.stop == 240)
    assert live.dropped == 120 - 64
    expected = np.unpackbits(RAW, axis=2, bitorder="little")
    np.testing.assert_array_equal(live.part(range(228, 240)).to_array(), expected)


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
