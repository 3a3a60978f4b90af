import json

import numpy as np
import pytest

from jotlight.runs.gathering import find_unfinished, gather_results
from jotlight.runs.store import VideoStore

FACTS = {"crc32": "00000000", "bytes": 0, "minimum": 0.0, "maximum": 1.0}


def make_store(path):
    store = VideoStore(path, {"values": "float32"}, (2, 3, 4), "float32", 1)
    store.create()
    for index in range(2):
        store.write_image(index, np.zeros((3, 4), np.float32))
        store.mark(index, FACTS)
    return store


@pytest.mark.parametrize("text", ["{}", '{"crc32": 5}', json.dumps({**FACTS, "minimum": "a"})])
def test_a_damaged_marker_stops_no_other_result(tmp_path, text):
    damaged, whole = make_store(tmp_path / "a.zarr"), make_store(tmp_path / "b.zarr")
    (damaged.part / "groups/0.json").write_text(text)
    finished, unfinished = gather_results(find_unfinished([tmp_path]))
    assert finished == [whole.path]
    assert "a.zarr.part: 1 of its 2 groups of images were damaged" in unfinished[damaged.part]
    assert damaged.missing() == [0]


def test_results_that_are_links_are_completed_where_they_lead(tmp_path):
    links, targets = tmp_path / "v", tmp_path / "v" / "large"
    stores = [make_store(targets / f"{name}.zarr") for name in ("a", "b")]
    for name in ("a", "b"):
        (links / f"{name}.zarr").symlink_to(targets / f"{name}.zarr")
    (links / "c.zarr").symlink_to(targets / "c.zarr")
    assert len(find_unfinished([links])) == 2
    (outside := tmp_path / "outside").mkdir()
    (links / "a.zarr").rename(outside / "other.zarr")
    finished, unfinished = gather_results(find_unfinished([outside]))
    assert (finished, unfinished) == ([stores[0].path], {})
    assert (outside / "other.zarr" / "zarr.json").is_file()


def test_an_unfinished_result_that_is_a_link_stays_where_it_is(tmp_path):
    own = make_store(tmp_path / "own" / "a.zarr")
    (tmp_path / "hostile").mkdir()
    link = tmp_path / "hostile" / "b.zarr.part"
    link.symlink_to(own.part)
    finished, unfinished = gather_results(find_unfinished([tmp_path / "hostile"]))
    assert finished == []
    assert "outside of the folder" in unfinished[link]
    assert own.part.exists()
