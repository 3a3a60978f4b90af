"""Data sets of visionsim: sizes, runs of frames, and hostile descriptions."""

import json
import warnings

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from jotlight.formats.npy.arrays import open_npy_array


def write_transforms(folder, frames, **content):
    folder.mkdir(exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps({"frames": frames, **content}))
    return folder


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dim", [1, 2])
def test_the_true_height_and_width_are_kept(tmp_path, dim, channels):
    array = random_frames((4, 13, 21, channels))
    folder = write_transforms(
        tmp_path / "set", [{}] * 4, w=21, h=13, c=channels, bitpack=True, bitpack_dim=dim,
        file_path="frames.npy",
    )  # fmt: skip
    np.save(folder / "frames.npy", np.packbits(array, axis=dim))
    expected = array if channels == 3 else array[..., 0]
    for path in (folder, folder / "transforms.json"):
        np.testing.assert_array_equal(jl.open(path).to_array(), expected)


def test_frames_can_lie_in_many_files_at_offsets(tmp_path):
    array = random_frames((6, 5, 12))
    frames = [
        {"file_path": f"{index // 4:04}.npy", "bitpack_dim": 2, "offset": index % 4}
        for index in range(6)
    ]
    folder = write_transforms(tmp_path / "set", frames, w=12, h=5, c=1)
    np.save(folder / "0000.npy", np.packbits(array[:4, ..., None], axis=2))
    np.save(folder / "0001.npy", np.packbits(array[4:, ..., None], axis=2))
    np.testing.assert_array_equal(jl.open(folder).to_array(), array)
    write_transforms(folder, frames[::-1], w=12, h=5, c=1)
    np.testing.assert_array_equal(jl.open(folder).to_array(), array[::-1])


def test_frames_can_lie_in_a_folder_below_but_not_elsewhere(tmp_path):
    array = random_frames((6, 5, 12))
    frames = [
        {"file_path": f"frames/{index // 4:04}.npy", "bitpack_dim": 2, "offset": index % 4}
        for index in range(6)
    ]
    folder = write_transforms(tmp_path / "set", frames, w=12, h=5, c=1)
    (folder / "frames").mkdir()
    np.save(folder / "frames" / "0000.npy", np.packbits(array[:4, ..., None], axis=2))
    np.save(folder / "frames" / "0001.npy", np.packbits(array[4:, ..., None], axis=2))
    np.testing.assert_array_equal(jl.open(folder).to_array(), array)
    # Neither a link to a file elsewhere is followed, nor one to a folder, nor one in a circle.
    (folder / "frames").rename(tmp_path / "frames")
    for target in (tmp_path / "frames", folder / "frames"):
        (folder / "frames").symlink_to(target)
        with pytest.raises(ValueError, match=r"is outside of|lead nowhere"):
            jl.open(folder)
        (folder / "frames").unlink()
    (folder / "frames").mkdir()
    (folder / "frames" / "0000.npy").symlink_to(tmp_path / "frames" / "0000.npy")
    with pytest.raises(ValueError, match="is outside of"):
        jl.open(folder)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file_path": "../out.npy"}, "a file in the same folder"),
        ({"file_path": "/etc/passwd"}, "a file in the same folder"),
        ({"file_path": 7}, "a file in the same folder or below, got 7"),
        ({"file_path": "b/../../out.npy"}, "a file in the same folder"),
        ({"w": 99}, "w, c: describe frames"),
        ({"w": "12"}, "expected whole numbers"),
        ({"h": -5}, "expected whole numbers"),
        ({"h": 10**30}, "describe frames"),
        ({"c": 3}, "describe frames"),
        ({"bitpack_dim": 3}, "bitpack_dim: expected 1 or 2"),
        ({"frames": []}, "without a dimension of 0"),
        ({"frames": 7}, "list of frames"),
    ],
)
def test_hostile_descriptions_are_refused(tmp_path, changes, message):
    np.save(tmp_path / "out.npy", np.zeros((2, 5, 2), np.uint8))
    good = {"w": 12, "h": 5, "c": 1, "bitpack": True, "bitpack_dim": 2, "file_path": "a.npy"}
    folder = write_transforms(tmp_path / "set", **{"frames": [{}, {}], **good, **changes})
    np.save(folder / "a.npy", np.zeros((2, 5, 2), np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        with pytest.raises(ValueError, match=message):
            jl.open(folder)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, '{"frames": [3]}', "\xff"])
def test_a_file_that_is_no_description_is_refused(tmp_path, text):
    (tmp_path / "transforms.json").write_bytes(text.encode("latin1"))
    with pytest.raises(ValueError, match=r"transforms\.json"):
        jl.open(tmp_path)


def test_each_file_is_opened_once(tmp_path, monkeypatch):
    opened = []

    def open_array(path):
        opened.append(path.name)
        return open_npy_array(path)

    monkeypatch.setattr("jotlight.formats.visionsim.open_npy_array", open_array)
    array = random_frames((40, 5, 12))
    names = ["a.npy", "./a.npy", "b.npy", ".//b.npy"]
    frames = [
        {"file_path": names[2 * (index % 2) + index // 2 % 2], "offset": index // 2}
        for index in range(40)
    ]
    folder = write_transforms(tmp_path / "set", frames, w=12, h=5, c=1)
    for name, part in (("a", array[::2]), ("b", array[1::2])):
        np.save(folder / f"{name}.npy", part.astype(np.uint8))
    bits = jl.open(folder)
    assert opened == ["a.npy", "b.npy"]
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[7:10].to_array(), array[7:10])


def test_more_frames_than_the_files_have_are_refused(tmp_path):
    folder = write_transforms(tmp_path / "set", [{"file_path": "a.npy"}] * 3, w=12, h=5)
    np.save(folder / "a.npy", np.zeros((2, 5, 12), np.uint8))
    with pytest.raises(ValueError, match=r"each frame once, got a list of 3 frames, .* hold 2"):
        jl.open(folder)


def test_a_file_of_bits_may_be_followed_by_one_of_several_bits(tmp_path):
    frames = [{"file_path": "a.npy"}, {"file_path": "b.npy"}]
    folder = write_transforms(tmp_path / "set", frames, w=12, h=5)
    np.save(folder / "a.npy", np.zeros((1, 5, 12), np.uint8))
    np.save(folder / "b.npy", np.full((1, 5, 12), 255 // 3, np.uint8))
    np.testing.assert_array_equal(jl.open(folder, frames=slice(1, 2)), np.ones((5, 12)))


@pytest.mark.parametrize(
    "other", [np.zeros((1, 5, 13), np.uint8), np.zeros((1, 5, 12), bool)], ids=["width", "bool"]
)
def test_files_of_different_frames_are_refused(tmp_path, other):
    frames = [{"file_path": "a.npy"}, {"file_path": "b.npy"}]
    folder = write_transforms(tmp_path / "set", frames, h=5)
    np.save(folder / "a.npy", np.full((1, 5, 12), 36, np.uint8))
    np.save(folder / "b.npy", other)
    with pytest.raises(ValueError, match="frames of one size"):
        jl.open(folder)
