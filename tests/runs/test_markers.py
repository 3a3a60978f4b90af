import os

import pytest

from jotlight.runs.markers import Markers, summarize

FACTS = {"crc32": "00000000", "bytes": 0, "minimum": 0.0, "maximum": 1.0}


@pytest.fixture
def markers(tmp_path):
    (tmp_path / "groups").mkdir()
    return Markers(tmp_path, 20)


def test_markers_are_read_again(markers):
    for group in (0, 12):
        markers.write(group, FACTS, markers.part)
    assert markers.done() == {0, 12}
    assert markers.read(12) == FACTS
    markers.delete(12)
    assert markers.done() == {0}


def test_only_the_groups_of_the_video_count(markers):
    for name in ("3.json", "20.json", "03.json", "-1.json", "1.json.tmp", f"{'9' * 200}.json"):
        (markers.part / "groups" / name).touch()
    assert markers.done() == {3}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"crc32": "zz", "bytes": 1, "minimum": 0.0, "maximum": 1.0}',
        '{"crc32": 5, "bytes": 1, "minimum": 0.0, "maximum": 1.0}',
        '{"crc32": "00000000", "bytes": "x", "minimum": 0.0, "maximum": 1.0}',
        '{"crc32": "00000000", "bytes": 1e400, "minimum": 0.0, "maximum": 1.0}',
        '{"crc32": "00000000", "bytes": -1, "minimum": 0.0, "maximum": 1.0}',
        '{"crc32": "00000000", "bytes": 1, "minimum": "a", "maximum": 1.0}',
        '{"crc32": "00000000", "bytes": 1, "minimum": NaN, "maximum": 1.0}',
        '{"crc32": "00000000", "bytes": 1, "minimum": 0.0, "maximum": Infinity}',
        '{"crc32": "00000000", "bytes": 1, "minimum": 2.0, "maximum": 1.0}',
        f'{{"crc32": "{"f" * 3000}", "bytes": 1, "minimum": 0.0, "maximum": 1.0}}',
        f'{{"crc32": "00000000", "bytes": {"9" * 300}, "minimum": 0.0, "maximum": 1.0}}',
    ],
)
def test_damaged_markers_have_no_facts(markers, text):
    (markers.part / "groups/0.json").write_text(text)
    assert markers.read(0) is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_a_pipe_is_no_marker(markers):
    os.mkfifo(markers.part / "groups/0.json")
    assert markers.read(0) is None


def test_a_link_to_a_folder_is_no_marker_and_is_deleted_alone(markers):
    (markers.part / "array").mkdir()
    (markers.part / "groups/0.json").symlink_to("../array")
    assert markers.done() == {0}
    assert markers.read(0) is None
    markers.delete(0)
    assert markers.done() == set()
    assert (markers.part / "array").is_dir()


def test_links_lead_to_no_file_outside(markers, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside")
    (outside / "0.json").write_text("precious")
    (markers.part / "groups").rmdir()
    (markers.part / "groups").symlink_to(outside)
    for call in (
        markers.done,
        lambda: markers.read(0),
        lambda: markers.delete(0),
        lambda: markers.write(0, FACTS, markers.part),
    ):
        with pytest.raises(ValueError, match="outside of the folder"):
            call()
    assert (outside / "0.json").read_text() == "precious"


def test_checksums_are_combined_in_order():
    facts = [{**FACTS, "crc32": "9be3e0a3", "bytes": 4}, {**FACTS, "crc32": "131da070", "bytes": 5}]
    assert summarize(facts)["input"] == {"packed_bytes": 9, "packed_crc32": "cbf43926"}
