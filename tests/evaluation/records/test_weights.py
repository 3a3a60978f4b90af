"""The files of weights that records state."""

import pytest

import jotlight as jl
from jotlight.evaluation.records.weights import weight_files, weights_sha256
from jotlight.formats.files.checksums import file_checksum
from jotlight.networks.pretrained import CHANNELS_FILE, FOLDER, MOSAIC_FILE

GRAY = jl.Sensor(frames=16)
LARGE = FOLDER / "large.safetensors"


def named(name):
    return FOLDER / f"{name}.safetensors"


@pytest.mark.parametrize(
    ("mosaic", "method", "quality", "files"),
    [
        (None, "mle", None, []),
        (None, "network-medium", "medium", [named("medium")]),
        (None, "network-small", "small", [named("small-k16")]),
        (None, "network-extra-large", "extra-large", [LARGE]),
        (None, "held-out", None, [named("medium")]),
        (None, "network-color", None, [CHANNELS_FILE, LARGE]),
        ("RGGB", "network-color", None, [MOSAIC_FILE, LARGE]),
        ("RGGB", "network-small", "small", [named("small-k16")]),
        ("RGBW", "network-small", "small", [named("small-k16"), named("small")]),
        ("RGBW", "held-out", None, [named("medium")]),
        ("RGBW", "mle", None, []),
    ],
)
def test_weights_of_pretrained_networks(mosaic, method, quality, files):
    sensor = jl.Sensor(frames=16, mosaic=mosaic)
    found = weight_files([sensor], method, quality, is_color=method == "network-color")
    assert found == set(files)


@pytest.mark.parametrize(("mosaic", "own"), [(None, CHANNELS_FILE), ("RGGB", MOSAIC_FILE)])
def test_a_blend_for_colors_has_the_weights_of_the_color_network_and_of_medium(mosaic, own):
    sensor = jl.Sensor(frames=16, mosaic=mosaic)
    expected = {own, LARGE, named("medium")}
    assert weight_files([sensor], "held-out", None, is_color=True) == expected
    options = {"is_color": True, "is_conditional": True}
    assert weight_files([sensor], "held-out", None, **options) == expected


def test_a_film_of_which_some_images_are_merged_has_the_weights_of_both_color_networks():
    sensors = jl.Sensor(frames=16, mosaic="RGGB"), GRAY
    expected = {CHANNELS_FILE, MOSAIC_FILE, LARGE}
    assert weight_files(sensors, "network-color", None, is_color=True) == expected


def test_a_network_that_falls_back_is_conditional():
    found = weight_files([GRAY], "network-small", "small", is_conditional=True)
    assert found == {named("small")}


def test_weights_of_the_caller(tmp_path):
    path = tmp_path / "own.safetensors"
    jl.pretrained(GRAY, "small").save(path)
    assert weight_files([GRAY], "network", None, model=path) == {path}


def test_checksums_are_one_text_or_a_sorted_list_or_none(tmp_path):
    each = sorted(map(file_checksum, [LARGE, MOSAIC_FILE]))
    assert weights_sha256({LARGE, MOSAIC_FILE}) == each
    assert weights_sha256({LARGE}) == file_checksum(LARGE)
    assert weights_sha256([]) is None
    with pytest.raises(OSError, match="missing"):
        weights_sha256([tmp_path / "missing.safetensors"])
