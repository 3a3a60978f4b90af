"""Unfinished and finished videos that may come from a stranger."""

import json

import numpy as np
import pytest
import zarr

from jotlight.runs.store import VideoStore, open_finished, open_unfinished

RUN = {"method": "mle", "values": "float32"}
FACTS = {"crc32": "00000000", "bytes": 0, "minimum": 0.0, "maximum": 1.0}


def store_at(path):
    return VideoStore(path, RUN, (5, 3, 4), "float32", 2)


def fill(store):
    store.create()
    for group in range(store.groups):
        for index in store.images_of(group):
            store.write_image(index, np.full(store.shape[1:], index, store.dtype))
        store.mark(group, FACTS)


def test_links_in_an_unfinished_folder_lead_to_no_file_outside_of_it(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    store.create()
    outside = tmp_path / "outside"
    outside.write_text("old")
    (store.part / "groups/0.json").symlink_to(outside)
    with pytest.raises(ValueError, match=r"leads to .*outside, which is outside of the folder"):
        fill(store)
    image = store.part / "video.zarr/c.1.0.0"
    image.unlink()
    image.symlink_to(outside)
    store.write_image(1, np.zeros((3, 4), np.float32))
    assert outside.read_text() == "old"


@pytest.mark.parametrize("name", ["groups", "video.zarr"])
def test_links_of_an_unfinished_folder_lead_to_no_folder_outside_of_it(tmp_path, name):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    outside = tmp_path / "outside"
    (store.part / name).rename(outside)
    (outside / "c.0.0.0").write_bytes(b"damaged")
    (store.part / name).symlink_to(outside)
    before = {path.name: path.read_bytes() for path in outside.iterdir()}
    with pytest.raises(ValueError, match=r"leads to .*which is outside of the folder"):
        store.finish()
    with pytest.raises(ValueError, match=r"leads to .*which is outside of the folder"):
        fill(store)
    assert {path.name: path.read_bytes() for path in outside.iterdir()} == before


@pytest.mark.parametrize("name", ["groups", "video.zarr"])
@pytest.mark.parametrize("is_link", [False, True])
def test_folders_of_an_unfinished_video_are_no_links_and_are_not_missing(tmp_path, name, is_link):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    real = (store.part / name).rename(store.part / "real")
    if is_link:
        (store.part / name).symlink_to("real")
    for step in (store.create, store.finish):
        with pytest.raises(ValueError, match=f"expected a folder {name} .*delete it to make"):
            step()
    assert len(list(real.iterdir())) > 2
    assert not store.path.exists()


def test_a_marker_that_is_no_file_makes_its_group_again(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    for number, make in ((0, lambda path: path.mkdir()), (1, lambda path: path.symlink_to("no"))):
        marker = store.part / f"groups/{number}.json"
        marker.unlink()
        make(marker)
    with pytest.raises(ValueError, match="2 of its 3 groups of images were damaged"):
        store.finish()
    assert store.missing() == [0, 1]
    fill(store)
    store.finish()
    assert store.is_complete()


@pytest.mark.parametrize("group", [1, 2**31])
def test_a_stated_number_of_images_without_files_takes_no_time_and_no_memory(tmp_path, group):
    part = tmp_path / "v.zarr.part"
    (part / "groups").mkdir(parents=True)
    (part / "video.zarr").mkdir()
    content = {"run": RUN, "group": group, "shape": [2**31 - 1, 1, 1]}
    (part / "run.json").write_text(json.dumps(content))
    store = open_unfinished(part)
    with pytest.raises(ValueError, match=f"{store.groups} of its {store.groups} groups .*missing"):
        store.finish()
    store.mark(0, FACTS)
    with pytest.raises(ValueError, match=r"1 of its 1 groups .*damaged|groups of images are miss"):
        store.finish()


def test_a_finished_array_that_states_many_images_takes_no_time_and_no_memory(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    store.finish()
    description = json.loads((store.path / "zarr.json").read_text())
    description["shape"] = [2**31 - 1, 3, 4]
    (store.path / "zarr.json").write_text(json.dumps(description))
    for check in (open_finished(store.path).check_files, open_finished(store.path).check_images):
        with pytest.raises(ValueError, match=r"2147483642 of its 2147483647 .* such as c\.5\.0\.0"):
            check()


def test_a_hostile_description_of_the_array_is_replaced(tmp_path):
    store = store_at(tmp_path / "v.zarr")
    fill(store)
    outside = tmp_path / "outside"
    outside.write_text("{}")
    (store.part / "video.zarr/zarr.json").unlink()
    (store.part / "video.zarr/zarr.json").symlink_to(outside)
    store.finish()
    assert outside.read_text() == "{}"
    assert zarr.open_array(str(store.path), mode="r").shape == store.shape
