"""Descriptions of photon cubes: foreign, damaged, and hostile ones."""

import json

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits
from examples.encodings import npy_bytes
from folders import file_names
from jotlight.formats import verify_capture
from jotlight.formats.npy.description import description_path

OBJECTS = npy_bytes(np.array([[[{}]]], object), allow_pickle=True)


def edit(path, **changes):
    """Change a description, and delete its own checksum as a user would."""
    description = json.loads(path.read_text())
    del description["checksum"]
    path.write_text(json.dumps(description | changes))


FOREIGN = ["{}", "[]", "nonsense", '{"format": "visionsim", "w": 8}', "[" * 100_000, " " * 2**21]


def test_a_width_that_contradicts_the_description_is_refused(tmp_path):
    jl.save(random_bits((2, 3, 13)), tmp_path / "cube.npy")
    assert jl.open(tmp_path / "cube.npy", width=13).width == 13
    with pytest.raises(TypeError, match="width: expected a whole number, got '13'"):
        jl.open(tmp_path / "cube.npy", width="13")
    with pytest.raises(ValueError, match="states a width of 13, not 12"):
        jl.open(tmp_path / "cube.npy", width=12)


@pytest.mark.parametrize("size", [0, 1, 3, 12, 20, 40])
@pytest.mark.parametrize("zeros", [0, 100])
def test_the_beginning_of_a_description_is_refused(tmp_path, size, zeros):
    jl.save(random_bits((2, 3, 13)), tmp_path / "cube.npy")
    path = tmp_path / "cube.json"
    path.write_bytes(path.read_bytes()[:size] + bytes(zeros))
    for read in (jl.open, verify_capture):
        with pytest.raises(ValueError, match=r"cube\.json: is damaged"):
            read(tmp_path / "cube.npy")


@pytest.mark.parametrize("text", FOREIGN, ids=lambda text: text[:12])
def test_a_foreign_description_is_ignored_with_a_warning(tmp_path, text):
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 2), np.uint8))
    (tmp_path / "cube.json").write_text(text)
    with pytest.warns(jl.JotlightWarning, match=r"cube\.json does not describe") as caught:
        bits = jl.open(tmp_path / "cube.npy")
    assert (bits.shape, bits.sensor) == ((2, 3, 16), None)
    assert caught[0].filename == __file__


@pytest.mark.parametrize("text", FOREIGN, ids=lambda text: text[:12])
def test_a_foreign_description_is_never_overwritten(tmp_path, text):
    (tmp_path / "cube.json").write_text(text)
    with pytest.raises(FileExistsError, match="jotlight did not write it"):
        jl.save(random_bits((1, 2, 8)), tmp_path / "cube.npy")
    assert file_names(tmp_path) == ["cube.json"]
    assert (tmp_path / "cube.json").read_text() == text


def test_a_description_of_another_cube_is_refused(tmp_path):
    jl.save(random_bits((2, 3, 13)), tmp_path / "cube.npy")
    np.save(tmp_path / "cube.npy", np.zeros((4, 3, 2), np.uint8))
    with pytest.raises(ValueError, match=r"cube\.json: describes a cube of shape \[2, 3, 2\]"):
        jl.open(tmp_path / "cube.npy")
    (tmp_path / "cube.json").unlink()
    assert jl.open(tmp_path / "cube.npy").shape == (4, 3, 16)


@pytest.fixture
def saved(tmp_path):
    """Bits whose sensor has a map, in a folder next to a map that they must not reach."""
    np.save(tmp_path / "mask.npy", np.zeros((4, 4), bool))
    folder = tmp_path / "folder"
    folder.mkdir()
    sensor = jl.Sensor(mask=np.eye(4, dtype=bool))
    jl.save(random_bits((1, 4, 4), sensor), folder / "cube.npy")
    return folder / "cube.npy"


@pytest.mark.parametrize(
    "name", ["../mask.npy", "{parent}/mask.npy", "", ".", "..", "a/../../mask.npy", 3, None, ["a"]]
)
def test_a_description_cannot_point_out_of_its_folder(saved, name):
    if isinstance(name, str):
        name = name.format(parent=saved.parent.parent)
    edit(saved.with_suffix(".json"), maps={"mask": {"file": name}})
    with pytest.raises(ValueError, match="the name of a file in the same folder"):
        jl.open(saved)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 1}, "expected a description of version 2, got 1"),
        ({"version": None}, "expected a description of version 2"),
        ({"with": 4}, "unknown keys with"),
        ({"trials": 4}, "unknown keys trials"),
        ({"checksum": "sha-256"}, "unknown keys checksum"),
        ({"format": "jotlight counts"}, "unknown keys maps, sensor, width"),
        ({"width": "4"}, "width '4'"),
        ({"width": 0}, "width 0"),
        ({"width": 9}, "width: expected 1 to 8"),
        ({"width": None}, "width None"),
        ({"shape": [1, 4, 2]}, r"cube of shape \[1, 4, 2\]"),
        ({"shape": "1, 4, 1"}, "cube of shape 1, 4, 1"),
        ({"sensor": []}, "sensor: expected an object"),
        ({"sensor": {"color": 1}}, "unknown parameters color"),
        ({"sensor": {"frames": 2}}, "expected the sensor's 2 frames"),
        ({"sensor": {"gain": -1}}, "gain: expected"),
        ({"sensor": {"oversampling": 3}, "maps": {}}, "multiples of the oversampling"),
        ({"maps": {"gain": {"file": "cube.mask.npy"}}}, "gain"),
        ({"maps": {"mask": {"file": "cube.npy"}}}, "mask: expected"),
        ({"maps": {"mask": "cube.mask.npy"}}, "an object with file and sha256"),
        ({"maps": {"mask": {"sha256": "0"}}}, "an object with file and sha256"),
        ({"maps": {"mask": {"file": "cube.mask.npy", "a": 1}}}, "an object with file and sha256"),
        ({"maps": {"mask": {"file": "cube.mask.npy", "sha256": 5}}}, r"mask\.npy: is damaged"),
        ({"maps": [1]}, r"cube\.json: "),
        ({"maps": 5}, r"cube\.json: "),
    ],
)
def test_a_damaged_description_is_refused_by_name(saved, changes, message):
    edit(saved.with_suffix(".json"), **changes)
    with pytest.raises(ValueError, match=message) as caught:
        jl.open(saved)
    assert str(saved.with_suffix("")) in str(caught.value)


def test_a_missing_map_is_reported_by_name(saved):
    saved.with_suffix(".mask.npy").unlink()
    with pytest.raises(FileNotFoundError, match=r"cube\.mask\.npy"):
        jl.open(saved)


def test_a_map_of_objects_is_refused(saved):
    edit(saved.with_suffix(".json"), maps={"mask": {"file": "cube.mask.npy"}})
    saved.with_suffix(".mask.npy").write_bytes(OBJECTS)
    with pytest.raises(ValueError, match="Python objects"):
        jl.open(saved)


@pytest.mark.parametrize("maps", ['{"kernel": "x.npy"}', "[1]", '"mask"', "7"])
def test_unknown_maps_are_refused(tmp_path, maps):
    jl.save(jl.Bits.from_array(np.ones((1, 2, 8), bool), jl.Sensor()), tmp_path / "cube.npy")
    edit(tmp_path / "cube.json", maps=json.loads(maps))
    with pytest.raises(ValueError, match=r"cube\.json: maps: expected files for dark"):
        jl.open(tmp_path / "cube.npy")


@pytest.mark.parametrize("name", ["cube.npy", "cube.npy.gz"])
def test_a_damaged_description_is_refused_and_never_ignored(tmp_path, name):
    jl.save(random_bits((2, 3, 13), jl.Sensor(frames=2)), tmp_path / name)
    path = description_path(tmp_path / name)
    text = path.read_text()
    beginning = text[: text.index("version")]
    for damaged in (beginning, text + "}", text.replace("13", "14"), text + " " * 2**20):
        path.write_text(damaged)
        with pytest.raises(ValueError, match=r"\.json: .* damaged"):
            jl.open(tmp_path / name)


def test_a_damaged_description_is_replaced_by_a_new_one(tmp_path):
    jl.save(random_bits((2, 3, 13)), tmp_path / "cube.npy")
    (tmp_path / "cube.json").write_text((tmp_path / "cube.json").read_text()[:200])
    jl.save(random_bits((2, 3, 12)), tmp_path / "cube.npy")
    assert jl.open(tmp_path / "cube.npy").width == 12


def test_a_changed_map_is_refused_until_its_checksum_is_deleted(saved):
    np.save(saved.with_suffix(".mask.npy"), np.ones((4, 4), bool))
    with pytest.raises(ValueError, match=r"mask\.npy: is damaged or was changed"):
        jl.open(saved)
    edit(saved.with_suffix(".json"), maps={"mask": {"file": "cube.mask.npy"}})
    assert jl.open(saved).sensor.mask.all()


def test_bits_whose_checksum_was_deleted_are_not_compared(saved):
    np.save(saved, np.full((1, 4, 1), 128, np.uint8))
    with pytest.raises(ValueError, match=r"cube\.npy: is damaged"):
        verify_capture(saved)
    edit(saved.with_suffix(".json"), sha256=None)
    assert verify_capture(saved).startswith("1 file matches its checksum")  # the map
