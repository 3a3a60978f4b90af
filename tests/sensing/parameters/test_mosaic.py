"""Color mosaics: patterns, the light behind filters, files, parts of images, and bad input."""

import json
import pickle

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.io import image_writer
from jotlight.sensing.parameters.mosaic import Mosaic

IMAGE = np.random.default_rng(0).random((12, 10, 3))
XTRANS = "GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG"
MAP = Mosaic(np.random.default_rng(1).integers(4, size=(12, 20)), "RGBW")
DENSE = [[0.8, 0.1, 0.0], [0.1, 0.7, 0.1], [0.0, 0.2, 0.9]]
MOSAICS = [
    Mosaic("RGGB"),
    Mosaic("GRBG", white_balance=[2.0, 1.0, 1.5]),
    Mosaic("RGB"),
    Mosaic("RGBW/"),
    Mosaic("RGGB", transmission=DENSE),
    Mosaic(XTRANS),
    MAP,
]


def light_pixel_by_pixel(mosaic, image):
    """The light of each pixel, by a loop over pixels and letters."""
    light = np.zeros(image.shape[:2])
    for (row, column), _ in np.ndenumerate(light):
        rows, columns = mosaic.pattern.shape
        place = mosaic.pattern[row % rows, column % columns]
        for color in range(3):
            light[row, column] += mosaic.transmission[place, color] * image[row, column, color]
    return light


def image_of(mosaic):
    return IMAGE if mosaic.repeats else np.concatenate([IMAGE, IMAGE[:, ::-1]], axis=1)


@pytest.mark.parametrize("mosaic", MOSAICS, ids=repr)
def test_a_pixel_sees_what_its_filter_passes(mosaic):
    image = image_of(mosaic)
    expected = light_pixel_by_pixel(mosaic, image)
    np.testing.assert_allclose(mosaic.light(image), expected)
    np.testing.assert_allclose(mosaic.light(np.moveaxis(image, -1, 0), 0), expected)
    gray = jl.Sensor(oversampling=2, frames=3)
    sensor = gray.replace(mosaic=mosaic)
    expected = gray.expose(expected, rng=5)
    bits = sensor.expose(image, rng=5)
    assert bits.sensor == sensor
    np.testing.assert_array_equal(bits.packed, expected.packed)
    np.testing.assert_allclose(sensor.rate(image), gray.rate(light_pixel_by_pixel(mosaic, image)))


def test_bayer_letters_name_the_colors_of_the_first_four_pixels():
    for order in ("RGGB", "BGGR", "GRBG", "GBRG"):
        mosaic = Mosaic(order)
        assert mosaic.bayer == order
        for (row, column), letter in zip([(0, 0), (0, 1), (1, 0), (1, 1)], order, strict=True):
            assert mosaic.light(IMAGE)[row, column] == IMAGE[row, column, "RGB".index(letter)]
    assert Mosaic("RGBW").bayer is None


def test_all_ways_to_state_a_mosaic_agree():
    expected = Mosaic("RGGB")
    letters = np.array([["R", "G"], ["G", "B"]])
    shares = np.eye(3)[[[0, 1], [1, 2]]]
    for other in ("RG/GB", letters, shares, expected, expected.to_json()):
        assert Mosaic.of(other) == expected
        assert jl.Sensor(mosaic=other) == jl.Sensor(mosaic=expected)
    assert Mosaic([[0, 1], [3, 2]], filters="RGBG") == expected
    assert Mosaic([[2, 0], [0, 1]], filters="GBR") == expected
    different_greens = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.1, 0.9, 0]]
    assert len(Mosaic([[0, 1], [3, 2]], filters="RGBG", transmission=different_greens).filters) == 4


@pytest.mark.parametrize("mosaic", MOSAICS, ids=repr)
def test_mosaics_survive_json_pickle_and_sensors(mosaic):
    sensor = jl.Sensor(frames=3, mosaic=mosaic)
    again = jl.Sensor.from_parts(json.loads(json.dumps(sensor.scalars())))
    for other in (again, pickle.loads(pickle.dumps(sensor))):
        assert other == sensor
        assert hash(other) == hash(sensor)
    assert sensor != sensor.replace(mosaic=None)
    assert "osaic" in repr(sensor)
    assert "osaic" in sensor._repr_html_()
    with pytest.raises(ValueError, match="read-only"):
        mosaic.pattern[0, 0] = 1


@pytest.mark.parametrize("mosaic", MOSAICS, ids=repr)
@pytest.mark.parametrize("name", ["a.npy", "a.npy.gz"])
def test_files_of_bits_keep_the_mosaic(mosaic, name, tmp_path):
    bits = jl.Sensor(frames=2, mosaic=mosaic).expose(image_of(mosaic), rng=0)
    jl.save(bits, tmp_path / name)
    assert jl.open(tmp_path / name).sensor == bits.sensor


@pytest.mark.parametrize("mosaic", MOSAICS, ids=repr)
def test_tiles_and_rotations_have_the_filters_of_their_pixels(mosaic, tmp_path):
    image = image_of(mosaic)
    sensor = jl.Sensor(oversampling=2, mosaic=mosaic)
    bits = sensor.expose(image, rng=1)
    tile = (slice(3, 8), slice(1, 6))
    part = sensor.expose(image, rng=1, tile=tile)
    full = mosaic.full(*image.shape[:2])
    np.testing.assert_array_equal(part.sensor.mosaic.full(5, 5), full[tile])
    jl.save(bits, tmp_path / "a.npy")
    for rotate, flip in ((90, None), (180, "horizontal"), (0, "vertical")):
        turned = jl.open(tmp_path / "a.npy", rotate=rotate, flip=flip)
        expected = np.rot90(full, rotate // 90)
        if flip is not None:
            expected = expected[:, ::-1] if flip == "horizontal" else expected[::-1]
        np.testing.assert_array_equal(turned.sensor.mosaic.full(*expected.shape), expected)


def test_open_states_a_mosaic(tmp_path):
    gray = jl.Sensor(frames=4, gain=2.0).expose(np.full((8, 8), 0.5), rng=0)
    jl.save(gray, tmp_path / "own.npy")
    assert jl.open(tmp_path / "own.npy", mosaic="RGGB").sensor == jl.Sensor(
        frames=4, gain=2.0, mosaic="RGGB"
    )
    np.save(tmp_path / "plain.npy", np.asarray(gray.packed))
    assert jl.open(tmp_path / "plain.npy", mosaic="RGGB").sensor == jl.Sensor(
        frames=4, mosaic="RGGB"
    )
    np.save(tmp_path / "counts.npy", gray.counts())
    with pytest.raises(ValueError, match="holds counts, which carry no sensor"):
        jl.open(tmp_path / "counts.npy", mosaic="RGGB")


def test_colors_invert_the_transmission_and_apply_the_white_balance():
    mosaic = Mosaic("RGGB", transmission=DENSE, white_balance=[2.0, 1.0, 0.5])
    colors = np.random.default_rng(0).random((50, 3))
    seen = colors @ np.array(DENSE).T / np.sum(DENSE, axis=1)
    np.testing.assert_allclose(mosaic.colors(seen, [1, 2, 1]), colors * [2.0, 1.0, 0.5])
    white = Mosaic("RGBW")
    seen = np.append(colors, colors.mean(axis=1, keepdims=True), axis=1)
    np.testing.assert_allclose(white.colors(seen, [1, 1, 1, 3]), colors)
    seen[:, 3] += 0.1  # with a large weight, the sum of the colors is that of the clear pixels
    found = white.colors(seen, [1, 1, 1, 1e9])
    np.testing.assert_allclose(found.mean(axis=1), seen[:, 3], rtol=1e-6)
    each = np.random.default_rng(1).random((50, 4))
    expected = [white.colors(*pair) for pair in zip(seen, each, strict=True)]
    np.testing.assert_allclose(white.colors(seen, each), expected)


@pytest.mark.parametrize("pattern", ["RGGB", ["RG", "GB"], [["R", "G"], ["G", "B"]]])
def test_json_may_hold_letters(pattern):
    assert Mosaic.of(json.loads(json.dumps({"pattern": pattern, "filters": "RGB"}))) == Mosaic(
        "RGGB"
    )
    with pytest.raises(ValueError, match=r"the letters R, G, B, .* got X"):
        Mosaic.of({"pattern": "RGXB"})


def test_a_map_in_the_note_of_a_tiff_leaves_it_readable(tmp_path):
    image = np.arange(12, dtype=np.float32).reshape(3, 4) / 12
    note = {"sensor": {"mosaic": MAP.to_json()}}
    image_writer(tmp_path / "a.tif", note=note)(tmp_path / "a.tif", image)
    np.testing.assert_array_equal(jl.read_image(tmp_path / "a.tif"), image)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pattern": "RGXB"}, "expected the letters R, G, B, .* got X; pass transmission"),
        ({"pattern": "RG/GBR"}, "rows of equal length such as RGBW/BWRG, got 'RG/GBR'"),
        ({"pattern": ""}, "expected letters of filters"),
        ({"pattern": "RRGG"}, "tell red, green, and blue apart, got RG"),
        ({"pattern": [["RG", "B"]]}, "expected one letter for each pixel"),
        ({"pattern": [[0, 1], [1, 2]]}, "name them, as in"),
        ({"pattern": [[0, 1], [1, 3]], "filters": "RGB"}, "indices from 0 to 2 .* got 0 to 3"),
        ({"pattern": np.zeros((2, 2))}, "expected letters such as RGGB.*float64"),
        ({"pattern": np.zeros((2, 2, 3), np.uint8)}, "divide an 8-bit image by 255"),
        ({"pattern": "RGGB", "transmission": np.eye(4)}, r"shape \(3, 3\).*got \(4, 4\)"),
        ({"pattern": "RGGB", "transmission": 2 * np.eye(3)}, "numbers from 0 to 1"),
        ({"pattern": "RGGB", "transmission": np.diag([1, 1, 0])}, "not all 0 for a filter"),
        ({"pattern": "RGGB", "white_balance": [1, 1, 1, 1]}, "second green: leave it out"),
        ({"pattern": "RGGB", "white_balance": [1, 0, 1]}, "expected numbers above 0"),
        ({"pattern": "RGGB", "filters": "RG"}, "expected the filters RG, got B"),
    ],
)
def test_bad_mosaics_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Mosaic(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"transmission": {"R": [1, 0, 0]}}, r"a row a filter, got \{'R': \[1, 0, 0\]\}"),
        ({"transmission": [[1, 0, 0], [0, 1]]}, "transmission: expected numbers such as"),
        ({"white_balance": "daylight"}, r"such as \[2.0, 1.0, 1.5\], got 'daylight'"),
    ],
)
def test_other_values_than_numbers_are_refused(arguments, message):
    with pytest.raises(TypeError, match=message):
        Mosaic("RGGB", **arguments)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pattern": {"size": [20, 20], "zlib": "AAAA"}}, "the map is damaged"),
        ({"pattern": {"size": [2**20, 2**20], "zlib": ""}}, "expected 1 to"),
        ({"pattern": {"size": [30, 20], "zlib": MAP.to_json()["pattern"]["zlib"]}}, "600 pixels"),
        ({"other": 1}, "expected an object with pattern"),
    ],
)
def test_damaged_mosaics_of_files_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Mosaic.of({**MAP.to_json(), **change})


def test_rows_may_be_a_list_and_letters_are_capital():
    assert Mosaic(["RG", "GB"]) == Mosaic("RGGB")
    with pytest.raises(ValueError, match="expected capital letters, such as RGGB, got rggb"):
        Mosaic("rggb")


def test_channels_have_no_mosaic(tmp_path):
    jl.save(jl.Bits.from_array(np.zeros((4, 8, 8, 3), bool)), tmp_path / "c.npy")
    with pytest.raises(ValueError, match=r"mosaic: expected gray frames.*\(4, 8, 8, 3\)"):
        jl.open(tmp_path / "c.npy", mosaic="RGGB")


def test_a_mosaic_must_fit_the_image_and_the_kernel():
    sensor = jl.Sensor(mosaic=MAP)
    with pytest.raises(ValueError, match=r"expected a map of 12 x 10 pixels.*got 12 x 20"):
        sensor.expose(IMAGE, rng=0)
    with pytest.raises(ValueError, match="expected a map of 12 x 10 pixels"):
        jl.Bits.from_array(np.zeros((1, 12, 10), bool), sensor)
    with pytest.raises(ValueError, match=r"expected red, green, and blue.*got shape \(12, 10\)"):
        jl.Sensor(mosaic="RGGB").expose(IMAGE[..., 0], rng=0)
    with pytest.raises(ValueError, match="expected the box kernel with a mosaic"):
        jl.Sensor(mosaic="RGGB", oversampling=4, kernel="linear")


def test_methods_for_gray_sensors_refuse_a_mosaic():
    sensor = jl.Sensor(frames=16, mosaic="RGGB")
    bits = sensor.expose(IMAGE, rng=0)
    for call in (jl.mle, jl.noniterative, jl.admm_tv, jl.merge_readings):
        with pytest.raises(ValueError, match=r"expected a gray sensor.*jotlight.reconstruct"):
            call(bits)
    with pytest.raises(ValueError, match="expected a gray sensor"):
        jl.pretrained(sensor)(bits)
    with pytest.raises(ValueError, match="expected a gray sensor"):
        jl.plan(sensor, 0.1)


def test_a_dark_capture_of_a_mosaic_serves():
    sensor = jl.Sensor(frames=64, mosaic="RGGB", dark_counts=0.02)
    dark = sensor.expose(np.zeros((12, 10, 3)), rng=0)
    calibration = jl.calibrate(dark, false_positive_rate=0.01)
    found = calibration.applied_to(sensor)
    assert found.mosaic == sensor.mosaic
    bits = jl.Bits(sensor.expose(IMAGE, rng=2).packed, 10, found)
    assert jl.reconstruct(bits, method="mle", demosaicing="differences").shape == (12, 10, 3)
