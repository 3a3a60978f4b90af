import contextlib
import errno
import json
import os
import shutil

import numpy as np
import pytest
import zarr

from folders import file_names
from jotlight.runs import store as module
from jotlight.runs.records import AnotherRunError, read_record
from jotlight.runs.store import VideoStore, open_finished, open_unfinished

RUN = {"method": "mle", "values": "float32"}
FACTS = {"crc32": "00000000", "bytes": 0, "minimum": 0.0, "maximum": 1.0}


def store_at(path, run=RUN, **changes):
    values = {"shape": (5, 3, 4), "dtype": "float32", "group": 2, **changes}
    return VideoStore(path, run, **values)


def fill(store, groups=None):
    store.create()
    for group in range(store.groups) if groups is None else groups:
        for index in store.images_of(group):
            store.write_image(index, np.full(store.shape[1:], index, store.dtype))
        store.mark(group, FACTS)


@pytest.mark.parametrize(("dtype", "shape"), [("float32", (5, 3, 4)), ("int32", (5, 3, 4, 2))])
def test_the_zarr_library_reads_what_was_written(tmp_path, dtype, shape):
    store = store_at(tmp_path / "v.zarr", dtype=dtype, shape=shape)
    fill(store)
    store.finish()
    array = zarr.open_array(str(store.path), mode="r")
    assert array.shape == shape
    assert array.chunks == (1, *shape[1:])
    assert array.dtype == dtype
    np.testing.assert_array_equal(
        array[:, 0, 0].ravel()[:: shape[-1] if len(shape) > 3 else 1], np.arange(5)
    )
    assert array.attrs["jotlight"]["run"] == RUN
    assert not store.part.exists()


def test_a_flipped_bit_is_detected(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    store.finish()
    path = store.path / "c.1.0.0"
    content = bytearray(path.read_bytes())
    content[7] ^= 1
    path.write_bytes(content)
    with pytest.raises(ValueError, match="checksum"):
        zarr.open_array(str(store.path), mode="r")[1]
    store.check_files()
    with pytest.raises(ValueError, match=r"1 of its 5 images do not match .* such as c\.1\.0\.0"):
        open_finished(store.path).check_images()


def test_a_finished_array_is_verified(tmp_path):
    store, fractions = store_at(tmp_path / "v.zarr"), []
    fill(store)
    store.finish()
    found = open_finished(store.path)
    assert (found.run, found.shape, found.dtype) == (RUN, store.shape, store.dtype)
    found.check_images(fractions.append)
    np.testing.assert_allclose(fractions, np.arange(1, 6) / 5)
    description = json.loads((store.path / "zarr.json").read_text())
    (store.path / "zarr.json").write_text(json.dumps({**description, "shape": [0]}))
    with pytest.raises(ValueError, match=r"its zarr\.json is damaged"):
        open_finished(store.path)


@pytest.mark.parametrize("damage", [lambda path: path.unlink(), lambda path: path.write_bytes(b"")])
def test_a_finished_array_without_all_images_is_not_complete(tmp_path, damage):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    store.finish()
    damage(store.path / "c.3.0.0")
    with pytest.raises(ValueError, match=r"1 of its 5 images are missing .* such as c.3.0.0"):
        store.is_complete()


def test_only_missing_images_need_space(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    assert store.missing_nbytes == store.nbytes == 5 * 3 * 4 * 4
    fill(store, [0, 2])
    assert store.missing_nbytes == 2 * 3 * 4 * 4


def test_an_unfinished_store_continues(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store, [1])
    assert store.missing() == [0, 2]
    assert not store.is_complete()
    with pytest.raises(ValueError, match="2 of its 3 groups of images are missing"):
        store.finish()
    again = open_unfinished(store.part)
    assert again == store
    fill(again, [0, 2])
    again.finish()
    assert store.is_complete()
    assert read_record(store.path)["maximum"] == 1.0


def test_another_process_may_finish_first(tmp_path, monkeypatch):
    store = store_at(tmp_path / "v.zarr")
    fill(store)

    def flush(path):
        if not store.path.exists():
            shutil.copytree(store.part / "video.zarr", store.path, dirs_exist_ok=True)

    monkeypatch.setattr("jotlight.runs.image_files.flush_to_disk", flush)
    store.finish()
    assert store.is_complete()
    assert not store.part.exists()


def test_another_process_adds_nothing_to_a_video_that_is_complete(tmp_path, monkeypatch):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    remove = os.rmdir

    def remove_while_another_process_writes(name, **options):
        with contextlib.suppress(FileNotFoundError):
            (store.part / "image").touch()
        remove(name, **options)

    monkeypatch.setattr("os.rmdir", remove_while_another_process_writes)
    store.finish()
    assert file_names(tmp_path) == ["v.zarr"]
    with pytest.raises(FileNotFoundError):
        store.write_image(0, np.zeros(store.shape[1:], store.dtype))
    assert file_names(tmp_path) == ["v.zarr"]


def test_another_process_may_finish_while_its_folder_is_read(tmp_path, monkeypatch):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    read = module.read_json

    def finish_first(path):
        monkeypatch.setattr(module, "read_json", read)
        store.finish()
        return read(path)

    monkeypatch.setattr(module, "read_json", finish_first)
    assert store.is_complete()


def test_an_unfinished_video_without_its_description_is_refused(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    store.part.mkdir()
    with pytest.raises(ValueError, match=r"expected a file run\.json in it; delete it to make"):
        store.is_complete()


def test_equal_process_ids_do_not_share_a_temporary_folder(tmp_path, monkeypatch):
    store, names = store_at(tmp_path / "v.zarr"), []
    monkeypatch.setattr("os.getpid", lambda: 7)

    def rename(path, target):
        names.append(path.name)
        if len(names) == 1:
            store.create()  # as another process, at the same time

    monkeypatch.setattr("pathlib.Path.rename", rename)
    store.create()
    assert len(set(names)) == 2


@pytest.mark.parametrize("reason", [KeyboardInterrupt, SystemExit, ValueError])
def test_a_stop_while_the_array_is_created_leaves_nothing(tmp_path, monkeypatch, reason):
    def stop(*args, **options):
        raise reason

    monkeypatch.setattr("jotlight.runs.store.write_file", stop)
    with pytest.raises(reason):
        store_at(tmp_path / "v.zarr").create()
    assert list(tmp_path.iterdir()) == []


def test_finishing_twice_is_harmless(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    part = tmp_path / "copy"
    shutil.copytree(store.part, part)
    store.finish()
    part.rename(store.part)  # as if the process was killed before it deleted the folder
    store.finish()
    assert not store.part.exists()


def test_another_run_is_refused_finished_or_not(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    other = store_at(tmp_path / "v.zarr", {**RUN, "method": "network-small"})
    store.create()
    with pytest.raises(AnotherRunError, match='its method was "mle", and is "network-small" now'):
        other.create()
    fill(store)
    store.finish()
    with pytest.raises(AnotherRunError, match='its method was "mle", and is "network-small" now'):
        other.create()


def test_an_image_that_was_damaged_before_the_end_is_made_again(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    for index, content in ((1, b"short"), (4, bytes(3 * 4 * 4 + 4))):
        (store.part / f"video.zarr/c.{index}.0.0").write_bytes(content)
    (store.part / "groups" / "2.json").write_bytes(b"")
    with pytest.raises(ValueError, match="2 of its 3 groups of images were damaged"):
        store.finish()
    assert store.missing() == [0, 2]
    fill(store, [0, 2])
    store.finish()
    assert store.is_complete()


def test_other_folders_and_files_are_refused(tmp_path):
    path = tmp_path / "v.zarr"
    zarr.create_array(str(path), shape=(3,), dtype="u1")
    (tmp_path / "empty.zarr").mkdir()
    (tmp_path / "link.zarr").symlink_to("empty.zarr")
    (tmp_path / "file.zarr").touch()
    for name in ("v.zarr", "empty.zarr", "link.zarr", "file.zarr"):
        with pytest.raises(AnotherRunError, match="not the result of such a run"):
            store_at(tmp_path / name).resumed().is_complete()


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        '{"run": 3}',
        '{"run": {"values": "object"}, "group": 1, "shape": [1, 1, 1]}',
        '{"run": {"values": "int32"}, "group": 0, "shape": [1, 1, 1]}',
        '{"run": {"values": "int32"}, "group": 1, "shape": [1, -1, 1]}',
    ],
)
def test_damaged_unfinished_stores_are_refused(tmp_path, content):
    part = tmp_path / "v.zarr.part"
    part.mkdir()
    (part / "run.json").write_text(content)
    with pytest.raises(ValueError, match="damaged"):
        open_unfinished(part)


def test_a_run_continues_with_the_groups_it_began_with(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    assert store.resumed() == store
    store.create()
    stored = json.loads((tmp_path / "v.zarr.part" / "run.json").read_text())
    assert stored == {"run": RUN, "group": 2, "shape": [5, 3, 4]}
    assert store_at(tmp_path / "v.zarr", group=3).resumed() == store
    other = store_at(tmp_path / "v.zarr", {**RUN, "method": "x"})
    assert other.resumed() == other


def test_a_link_is_followed_before_the_work(tmp_path):
    (tmp_path / "v.zarr").symlink_to("other/real.zarr")
    store = store_at(tmp_path / "v.zarr").resumed()
    fill(store, [0])
    assert store_at(tmp_path / "v.zarr", group=3).resumed() == store
    fill(store, [1, 2])
    store.finish()
    assert (tmp_path / "v.zarr").is_symlink()
    assert zarr.open_array(str(tmp_path / "v.zarr"), mode="r").shape == store.shape
    assert file_names(tmp_path) == ["other", "v.zarr"]
    assert file_names(tmp_path / "other") == ["real.zarr"]
    assert store_at(tmp_path / "v.zarr").resumed().is_complete()


def test_another_process_never_finds_a_part_of_an_image(tmp_path, monkeypatch):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    whole = (store.part / "video.zarr/c.1.0.0").read_bytes()

    def write_half(path, image):
        path.write_bytes(whole[: len(whole) // 2])
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    with monkeypatch.context() as context:
        context.setattr(module, "write_image", write_half)
        with pytest.raises(OSError, match=r"cannot write .*v\.zarr: No space left"):
            store.write_image(1, np.ones(store.shape[1:], np.float32))
    assert (store.part / "video.zarr/c.1.0.0").read_bytes() == whole
    assert file_names(store.part) == ["groups", "run.json", "video.zarr"]
    store.finish()
    assert {each.name for each in store.path.iterdir()} == {
        "zarr.json",
        *(f"c.{index}.0.0" for index in range(5)),
    }


def test_creating_a_video_removes_what_a_killed_process_left(tmp_path, monkeypatch):
    pytest.importorskip("fcntl", reason="needs locks of files")
    store = store_at(tmp_path / "v.zarr")
    killed = []

    def kill(store, temporary):
        (temporary / "groups").mkdir()
        names = temporary, temporary.with_name(f"{temporary.name}.lock")
        killed.extend(shutil.move(name, f"{name}.kept") for name in names)
        raise KeyboardInterrupt

    with monkeypatch.context() as context:
        context.setattr(VideoStore, "_create_in", kill)
        with pytest.raises(KeyboardInterrupt):
            store.create()
    for name in killed:
        shutil.move(name, name.removesuffix(".kept"))
    assert len(list(tmp_path.iterdir())) == 2
    store.create()
    assert [path.name for path in tmp_path.iterdir()] == ["v.zarr.part"]


def test_a_name_may_be_as_long_as_that_of_the_unfinished_video(tmp_path):
    store = store_at(tmp_path / f"{'a' * 244}.zarr")
    assert not store.is_complete()
    store.create()
    assert not store.is_complete()
    with pytest.raises(OSError, match="too long"):
        store_at(tmp_path / f"{'a' * 246}.zarr").is_complete()


def test_failed_writes_name_the_video(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    store.create()
    (store.part / "video.zarr/c.1.0.0").mkdir()
    with pytest.raises(OSError, match=r"cannot write .*v\.zarr: Is a directory"):
        store.write_image(1, np.zeros(store.shape[1:], store.dtype))
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"cannot write .*file/v\.zarr: .* in folder"):
        store_at(tmp_path / "file/v.zarr").create()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "v.zarr.part"]
