"""Motions: displacements at any time, and files."""

import dataclasses
import json

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import jotlight as jl
from jotlight.motion.posterior import posterior_error


def random_motion(fields=2):
    rng = np.random.default_rng(0)
    return jl.Motion(
        rng.normal(size=(fields, 4, 2, 3, 5)).astype(np.float32),
        rng.integers(0, fields, (40, 70), np.uint8),
        np.array([1.5, 4, 8, 20]),
        5.0,
        "tiles",
        rng.random((fields, 4, 3, 3, 5), np.float32),
    )


def test_displacements_are_linear_in_time():
    motion = random_motion()
    middle = (motion.at(8) + motion.at(20)) / 2
    np.testing.assert_allclose(motion.at(14), middle, atol=1e-5)
    beyond = motion.at(20) + (motion.at(20) - motion.at(8))
    np.testing.assert_allclose(motion.at(32), beyond, atol=1e-4)
    before = motion.at(1.5) - (motion.at(4) - motion.at(1.5))
    np.testing.assert_allclose(motion.at(-1), before, atol=1e-4)
    assert motion.at(3).shape == (2, 40, 70)


@pytest.mark.parametrize("time", [[1, 2], "a", None, np.nan, np.inf, np.zeros(3), True])
def test_times_that_are_no_numbers_are_refused(time):
    for function in (random_motion().at, random_motion().seen_from):
        with pytest.raises(ValueError, match="time: expected one finite number of frames, got"):
            function(time)


def test_known_displacements_are_not_rounded():
    motion = random_motion()
    np.testing.assert_array_equal(motion.nodes_at_times(motion.times), motion.nodes)


def test_each_pixel_follows_its_own_field():
    motion = random_motion()
    nodes = motion.nodes[:, 1] + (2.5 / 4) * (motion.nodes[:, 2] - motion.nodes[:, 1])
    found = motion.at(6.5)
    for row, column in ((0, 0), (9, 33), (24, 41), (39, 69)):
        place = (np.array([row, column]) - 7.5) / 16
        top, left = (int(np.clip(np.floor(p), 0, n)) for p, n in zip(place, (1, 3), strict=True))
        down, right = place - (top, left)
        corners = nodes[motion.labels[row, column], :, top : top + 2, left : left + 2]
        weights = np.outer([1 - down, down], [1 - right, right])
        expected = (corners * weights).sum(axis=(1, 2))
        np.testing.assert_allclose(found[:, row, column], expected, atol=1e-4)


def test_more_fields_than_numpy_can_choose_from():
    motion = random_motion(fields=70)
    each = [
        dataclasses.replace(
            motion, nodes=motion.nodes[[index]], labels=np.zeros_like(motion.labels),
            information=motion.information[[index]],
        )
        for index in range(70)
    ]  # fmt: skip
    found = motion.at(6.5)
    for label, one in enumerate(each):
        own = motion.labels == label
        np.testing.assert_array_equal(found[:, own], one.at(6.5)[:, own])
    assert posterior_error(motion).shape == motion.size


def test_the_representation_states_the_length_of_the_motion():
    motion = random_motion()
    longest = np.hypot(*np.moveaxis(motion.nodes, 2, 0)).max()
    found = repr(motion)
    assert found.startswith("<Motion: tiles, 40 x 70 jots, 4 times from 1.5 to 20")
    assert found.endswith(f"up to {longest:.3g} jots>")
    assert motion.plot().axes[0].get_ylabel() == "jots"


BAD = {
    "nodes of another shape": ({"nodes": np.zeros((2, 4, 2, 3, 4), np.float32)}, "nodes: expected"),
    "nodes without fields": ({"nodes": np.zeros((0, 4, 2, 3, 5), np.float32)}, "nodes: expected"),
    "nodes of two dimensions": ({"nodes": np.zeros((2, 4), np.float32)}, "nodes: expected"),
    "no nodes": ({"nodes": np.float32(1)}, "nodes: expected"),
    "nodes of text": (
        {"nodes": np.full((2, 4, 2, 3, 5), "a")},
        "nodes: expected finite",
    ),
    "information of another shape": (
        {"information": np.zeros((2, 4, 2, 3, 5), np.float32)},
        "information: expected shape",
    ),
    "equal times": ({"times": np.array([1.0, 1, 2, 3])}, "times: expected finite numbers that"),
    "infinite times": ({"times": np.array([1.0, 2, 3, np.inf])}, "times: expected finite numbers"),
    "one time": (
        {"times": np.array([1.0]), "nodes": np.zeros((2, 1, 2, 3, 5), np.float32)},
        "two times",
    ),
    "times of two dimensions": (
        {"times": np.array([[1.0], [2], [3], [4]])},
        "times: expected an",
    ),
    "a number for times": ({"times": np.float64(3)}, "times: expected an"),
    "NaN": ({"nodes": np.full((2, 4, 2, 3, 5), np.nan, np.float32)}, "expected finite numbers"),
    "huge displacements": (
        {"nodes": np.full((2, 4, 2, 3, 5), 2e5, np.float32)},
        "up to 100000 jots, got 200000",
    ),
    "negative information": (
        {"information": np.full((2, 4, 3, 3, 5), -1, np.float32)},
        "information: expected that for rows and for columns to be 0 or more, got -1",
    ),
    "several fields of one motion": (
        {"model": "affine"},
        "expected one field for the model 'affine'",
    ),
    "segments with one field": (
        {
            "model": "segments",
            "nodes": np.zeros((1, 4, 2, 3, 5), np.float32),
            "information": np.zeros((1, 4, 3, 3, 5), np.float32),
            "labels": np.zeros((40, 70), np.uint8),
        },
        "expected 2 fields or more for the model 'segments', got 1",
    ),
    "a motion of what stands still": (
        {
            "model": "none",
            "nodes": np.full((1, 4, 2, 3, 5), 24, np.float32),
            "information": np.zeros((1, 4, 3, 3, 5), np.float32),
            "labels": np.zeros((40, 70), np.uint8),
        },
        "expected displacements of 0 for the model 'none', got up to 24 jots",
    ),
    "an infinite time": ({"reference": np.inf}, "reference: expected a finite time"),
    "another model": ({"model": "flow"}, "model: expected one of none, affine, segments, tiles"),
    "labels of fields that are missing": (
        {"labels": np.full((40, 70), 2, np.uint8)},
        "labels: expected indices below 2, got up to 2",
    ),
    "labels of another type": ({"labels": np.zeros((40, 70), int)}, "labels: expected an array"),
    "labels of another size": ({"labels": np.zeros((40, 90), np.uint8)}, "nodes: expected shape"),
    "no labels": ({"labels": np.zeros((0, 70), np.uint8)}, "labels: expected an array"),
}


@pytest.mark.parametrize("name", BAD)
def test_parts_that_do_not_fit_are_refused(name):
    changes, message = BAD[name]
    motion = random_motion()
    parts = {name: getattr(motion, name) for name in motion.__dataclass_fields__}
    with pytest.raises(ValueError, match=message):
        jl.Motion(**{**parts, **changes})


def test_what_is_saved_is_loaded(tmp_path):
    motion = random_motion()
    motion.save(tmp_path / "a.safetensors")
    again = jl.Motion.load(tmp_path / "a.safetensors")
    for name in ("nodes", "labels", "times", "information"):
        np.testing.assert_array_equal(getattr(again, name), getattr(motion, name))
        assert getattr(again, name).dtype == getattr(motion, name).dtype
    assert (again.reference, again.model) == (5.0, "tiles")
    again.save(tmp_path / "b.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


@pytest.mark.parametrize("reference", [0.1, 1 / 3, 1e-300, 123456.789])
def test_the_reference_time_is_kept_exactly(tmp_path, reference):
    parts = {name: getattr(random_motion(), name) for name in jl.Motion.__dataclass_fields__}
    jl.Motion(**{**parts, "reference": reference}).save(tmp_path / "a.safetensors")
    assert jl.Motion.load(tmp_path / "a.safetensors").reference == reference


def without(tensors, name):
    return {key: value for key, value in tensors.items() if key != name}


HOSTILE = {
    "no nodes": lambda tensors, metadata: (without(tensors, "nodes"), metadata),
    "no labels": lambda tensors, metadata: (without(tensors, "labels"), metadata),
    "another type": lambda tensors, metadata: (
        {**tensors, "nodes": tensors["nodes"].astype(np.float64)},
        metadata,
    ),
    "labels of another type": lambda tensors, metadata: (
        {**tensors, "labels": tensors["labels"].astype(np.int64)},
        metadata,
    ),
    "another shape": lambda tensors, metadata: (
        {**tensors, "nodes": tensors["nodes"][:, :, :, :2]},
        metadata,
    ),
    "no dimension": lambda tensors, metadata: (
        {**tensors, "times": np.array(3.0)},
        metadata,
    ),
    "nodes without dimensions": lambda tensors, metadata: (
        {**tensors, "nodes": np.array(3.0, np.float32)},
        metadata,
    ),
    "NaN": lambda tensors, metadata: (
        {**tensors, "nodes": np.full_like(tensors["nodes"], np.nan)},
        metadata,
    ),
    "no reference": lambda tensors, metadata: (tensors, without(metadata, "reference")),
    "a list for the reference": lambda tensors, metadata: (
        tensors,
        {**metadata, "reference": "[1]"},
    ),
    "NaN for the reference": lambda tensors, metadata: (tensors, {**metadata, "reference": "NaN"}),
    "a text for the reference": lambda tensors, metadata: (
        tensors,
        {**metadata, "reference": '"1"'},
    ),
    "true for the reference": lambda tensors, metadata: (
        tensors,
        {**metadata, "reference": "true"},
    ),
    "a huge reference": lambda tensors, metadata: (
        tensors,
        {**metadata, "reference": "1" + 400 * "0"},
    ),
    "deep": lambda tensors, metadata: (tensors, {**metadata, "reference": 100_000 * "["}),
    "no json": lambda tensors, metadata: (tensors, {**metadata, "reference": "{"}),
    "another model": lambda tensors, metadata: (tensors, {**metadata, "model": "flow"}),
    "one motion with several fields": lambda tensors, metadata: (
        tensors,
        {**metadata, "model": "affine"},
    ),
    "negative information": lambda tensors, metadata: (
        {**tensors, "information": -tensors["information"]},
        metadata,
    ),
    "no model": lambda tensors, metadata: (tensors, without(metadata, "model")),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_damaged_motions_are_refused_by_name(tmp_path, name):
    path = tmp_path / "a.safetensors"
    random_motion().save(path)
    metadata = {"format": "jotlight motion", "version": "1", "reference": "5.0", "model": "tiles"}
    tensors, metadata = HOSTILE[name](load_file(path), metadata)
    save_file({key: np.ascontiguousarray(part) for key, part in tensors.items()}, path, metadata)
    with pytest.raises(ValueError, match=r"a\.safetensors: damaged file of a motion"):
        jl.Motion.load(path)


def test_a_size_that_the_file_does_not_have_is_refused(tmp_path):
    path = tmp_path / "a.safetensors"
    random_motion().save(path)
    content = path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    for shape in ([2**40, 4, 2, 3, 5], [2**63, 2**63, 2, 3, 5], [-1, 4, 2, 3, 5]):
        header["nodes"]["shape"] = shape
        changed = json.dumps(header).encode()
        path.write_bytes(len(changed).to_bytes(8, "little") + changed + content[8 + length :])
        with pytest.raises(ValueError, match=r"a\.safetensors"):
            jl.Motion.load(path)
    path.write_bytes((2**60).to_bytes(8, "little") + content[8:])
    with pytest.raises(ValueError, match=r"a\.safetensors"):
        jl.Motion.load(path)


def test_other_files_are_refused(tmp_path):
    jl.Network.initial(jl.Sensor()).save(tmp_path / "network.safetensors")
    with pytest.raises(ValueError, match=r"network\.safetensors"):
        jl.Motion.load(tmp_path / "network.safetensors")
    with pytest.raises(FileNotFoundError, match="there is no file"):
        jl.Motion.load(tmp_path / "none.safetensors")
    with pytest.raises(FileNotFoundError, match="there is no file"):
        jl.Motion.load(tmp_path)
