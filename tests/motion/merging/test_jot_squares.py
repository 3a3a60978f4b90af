"""Sums over squares of jots: their motion, displacements, and merged colors behind a mosaic."""

import functools

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.metrics import psnr
from jotlight.motion.films.film import film
from jotlight.motion.merging import jot_squares
from jotlight.motion.merging.jot_squares import enlarge_motion, in_squares, squares_side
from jotlight.motion.merging.mosaic_colors import _with_neighbors, sensors_of_colors
from jotlight.motion.tiles import tile_centers
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance
from moving import behind

FRAMES, SIZE, LARGE = 96, (96, 112), (128, 160)
RANDOM = Mosaic(np.random.default_rng(1).integers(3, size=LARGE), "RGB")


def small(mosaic="RGGB", motion="shake"):
    """Return a moving color scene, and its bits."""
    return behind(mosaic, motion, FRAMES, SIZE)


@functools.cache
def aligned_colors(mosaic):
    """Return the motion of a large scene that shakes."""
    return jl.align(behind(mosaic, "shake", FRAMES, LARGE)[1])


def by_loops(bits, side, good):
    """Return the sums over squares of jots of one frame at a time."""
    frames = bits.to_array() * good
    rows, columns = frames.shape[1] // side, frames.shape[2] // side
    sums = np.zeros((len(frames), rows, columns), int)
    for row in range(rows):
        for column in range(columns):
            part = frames[:, row * side : (row + 1) * side, column * side : (column + 1) * side]
            sums[:, row, column] = part.sum(axis=(1, 2))
    return sums


@pytest.mark.parametrize(
    ("mosaic", "oversampling", "side"),
    [("RGGB", 1, 2), ("RGB", 1, 3), ("RGGB", 2, 4), ("RGGB", 8, 16)],
)
def test_squares_hold_the_sums_of_good_jots(mosaic, oversampling, side, monkeypatch):
    rng = np.random.default_rng(0)
    height, width = 48, 144
    frames = rng.random((70, height, width)) < 0.3
    excluded = rng.random((height, width)) < 0.1
    sensor = jl.Sensor(oversampling=oversampling, frames=70, mosaic=mosaic, dark_counts=0.01)
    bits = jl.Bits.from_array(frames, sensor=sensor)
    assert squares_side(sensor) == side
    stack, own = in_squares(bits, sensor, excluded)
    monkeypatch.setattr(jot_squares, "_MAX_BYTES", 0)
    lazy, _ = in_squares(bits, sensor, excluded)
    assert isinstance(lazy.images, Frames)
    np.testing.assert_array_equal(np.asarray(lazy.images), stack.images)
    np.testing.assert_array_equal(stack.images, by_loops(bits, side, ~excluded))
    assert stack.trials == side**2
    assert own.trials == 70 * side**2
    # The sensor of squares predicts the mean number of ones of gray light, to the first order.
    plain = sensor.replace(mosaic=None, gain=sensor.gain)
    light = 1e-3
    passed = sensor.mosaic.sensitivity[sensor.mosaic.of_jots(height, width, oversampling)]
    rate = (plain.light_per_intensity * light * passed + 0.01) * ~excluded
    expected = rate.reshape(height // side, side, width // side, side).sum((1, 3))
    found = own.light_per_intensity * light * np.asarray(own.efficiency) + own.dark_counts
    np.testing.assert_allclose(found * side**2, expected, rtol=1e-4)


@pytest.mark.parametrize("side", [2, 3, 4])
def test_an_affine_motion_is_enlarged_exactly(side):
    small = (50, 70)
    size = (small[0] * side + 1, small[1] * side + side - 1)
    matrix, shift = np.array([[0.02, -0.01], [0.03, 0.01]]), np.array([1.5, -2.0])

    def displacement(places):
        return np.einsum("ij,j...->i...", matrix, places) + shift[:, None, None]

    nodes = np.stack([np.zeros((2, 4, 5)), displacement(tile_centers(small))])[None]
    information = np.ones((1, 2, 3, 4, 5), np.float32)
    motion = jl.Motion(
        nodes.astype(np.float32), np.zeros(small, np.uint8), np.array([0.0, 8.0]), 0.0,
        "affine", information,
    )  # fmt: skip
    found = enlarge_motion(motion, side, size)
    places = (np.indices(size) - (side - 1) / 2) / side
    np.testing.assert_allclose(found.at(8.0), side * displacement(places), atol=1e-4)
    assert found.size == size
    np.testing.assert_allclose(found.information, 1 / side**2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mosaic",
    [
        pytest.param("RGGB", id="RGGB"),
        pytest.param("RRGG/RRGG/GGBB/GGBB", id="quad", marks=pytest.mark.exhaustive),
        pytest.param(RANDOM, id="random"),
    ],
)
def test_the_motion_is_found(mosaic):
    scene, _ = behind(mosaic, "shake", FRAMES, LARGE)
    motion = aligned_colors(mosaic)
    assert motion.model != "none"
    for time in (4, 30, 90):
        error = motion.at(time) - scene.motion(time)
        assert np.median(np.hypot(*error)) < 1


@pytest.mark.slow
def test_a_still_scene_has_no_motion():
    _, bits = small("RGGB", motion="static")
    assert jl.align(bits).model == "none"


@pytest.mark.slow
def test_merged_colors_are_better_than_every_window():
    scene, bits = behind("RGGB", "shake", FRAMES, LARGE)
    truth = scene.image()
    merged = jl.merge(bits, motion=aligned_colors("RGGB"))
    assert merged.shape == (*LARGE, 3)
    trials = np.asarray(merged.trials).mean((0, 1))
    np.testing.assert_allclose(trials / FRAMES, [0.25, 0.5, 0.25], atol=0.05)
    found = psnr(jl.reconstruct(merged), truth, data_range=1.0)
    middle = FRAMES // 2
    windows = [
        psnr(jl.reconstruct(bits[middle - n : middle + n]), truth, data_range=1.0)
        for n in (1, 2, 4, 8, 16, 48)
    ]
    assert found > max(windows) + 1
    assert merged.flags.mean() < 0.3


@pytest.mark.slow
def test_each_color_has_the_bits_of_its_jots():
    _, bits = small("RGGB", motion="static")
    motion = jl.align(bits)
    with pytest.warns(jl.JotlightWarning, match="the scene stands still"):
        merged = jl.merge(bits, motion=motion)
    counts = bits.counts()
    places = bits.sensor.mosaic.full(*SIZE)
    for index in range(3):
        own = places == index
        # Few bits are left out, because they disagree with others by chance.
        assert (merged.ones[..., index][own] == counts[own]).mean() > 0.97
        assert (merged.ones[..., index][own] <= counts[own]).all()
        # The other pixels have the bits of their neighbors, which are half of them or a quarter.
        share = {0: 1 / 4, 1: 1 / 2, 2: 1 / 4}[index]
        trials = merged.trials[..., index][2:-2, 2:-2][~own[2:-2, 2:-2]]
        assert abs(np.median(trials) / (share * FRAMES) - 1) < 0.05


@pytest.mark.parametrize("side", [2, 4])
def test_pixels_with_few_bits_of_a_color_count_those_nearby(side):
    rng = np.random.default_rng(0)
    trials = rng.integers(0, 3, (14, 17)) * rng.integers(0, 20, (14, 17)).astype(float)
    ones = rng.binomial(trials.astype(int), 0.4).astype(np.int32)
    found_ones, found_trials = _with_neighbors(ones, trials, side)
    reach = side - 1
    padded = [np.pad(each.astype(float), reach, mode="reflect") for each in (ones, trials)]
    for row in range(14):
        for column in range(17):
            near = np.zeros(2)
            for i in range(-reach, reach + 1):
                for j in range(-reach, reach + 1):
                    weight = (side - abs(i)) * (side - abs(j)) / side**4
                    place = row + reach + i, column + reach + j
                    near += weight * np.array([padded[0][place], padded[1][place]])
            own = np.array([ones[row, column], trials[row, column]])
            share = np.clip(1 - own[1] / (0.5 * near[1]), 0, 1) if near[1] else 0
            expected = (1 - share) * own + share * near
            assert abs(found_ones[row, column] - expected[0]) <= 0.5 + 1e-9
            if found_ones[row, column] > 0:
                fraction = found_ones[row, column] / found_trials[row, column]
                assert fraction == pytest.approx(expected[0] / expected[1])
            if share == 0:
                assert found_ones[row, column] == own[0]
                assert found_trials[row, column] == pytest.approx(own[1])


@pytest.mark.slow
def test_slow_motions_lose_nothing_to_missing_colors():
    """Near the center of a rotation, a pixel sees one filter alone."""
    scene, bits = behind("RGGB", "rotate", FRAMES, LARGE, 1)
    merged = jl.merge(bits)
    assert merged.trials.min() > 0
    truth = scene.image()
    found = psnr(jl.reconstruct(merged), truth, data_range=1.0)
    middle = FRAMES // 2
    windows = [
        psnr(jl.reconstruct(bits[middle - n : middle + n]), truth, data_range=1.0)
        for n in (8, 16, 48)
    ]
    assert found > max(windows)


def test_what_cannot_be_merged_is_refused():
    sensor = jl.Sensor(frames=32, mosaic="RGBW")
    bits = jl.Bits.from_array(np.zeros((32, 32, 32), bool), sensor=sensor)
    with pytest.raises(
        ValueError,
        match=r"expected ideal filters R, G, and B .*; without motion, jotlight\.reconstruct",
    ):
        jl.merge(bits)
    bayer = jl.Bits(bits.packed, 32, sensor.replace(mosaic="RGGB", gain=sensor.gain))
    with pytest.raises(
        ValueError, match=r"with a mosaic, got 2; leave out upsample= \(--upsample\)"
    ):
        jl.merge(bayer, upsample=2)
    tiny = jl.Bits.from_array(
        np.zeros((32, 1, 32), bool), sensor=jl.Sensor(frames=32, mosaic="RGGB")
    )
    with pytest.raises(ValueError, match=r"expected 2 x 2 jots or more.*got 1 x 32"):
        jl.align(tiny)
    with pytest.raises(ValueError, match="ideal filters"):
        sensors_of_colors(jl.Sensor(mosaic="CMYG"), (4, 4))
    channels = jl.Bits.from_array(np.zeros((32, 8, 8, 3), bool), sensor=sensor)
    with pytest.raises(ValueError, match=r"expected gray frames \(T, H, W\) for a sensor with"):
        jl.align(channels)
    stack = CountStack(np.zeros((32, 8, 8), np.uint8), Provenance("npy", "a.npy"), trials=4)
    with pytest.raises(ValueError, match="sensor: expected 128 frames"):
        jl.align(stack, sensor.replace(frames=96))
    with pytest.raises(ValueError, match="an oversampling of 1, because images of counts show"):
        jl.align(stack, jl.Sensor(frames=32, oversampling=2, mosaic="RGGB"))


@pytest.mark.slow
def test_counts_behind_a_mosaic_have_the_motion_of_their_bits():
    scene, bits = small()
    counts = bits.to_array().reshape(FRAMES // 2, 2, *SIZE).sum(axis=1).astype(np.uint8)
    stack = CountStack(counts, Provenance("npy", "a.npy"), trials=2)
    motion = jl.align(stack, bits.sensor)
    for index in (3, 40):  # images of two frames
        true = scene.motion(2 * index + 0.5, 2 * motion.reference + 0.5)
        assert np.sqrt(((motion.at(index) - true) ** 2).mean()) < 0.5
    merged = jl.merge(stack, bits.sensor, motion=motion)
    assert merged.shape == (*SIZE, 3)
    assert merged.ones.sum() <= counts.sum()
    with pytest.raises(ValueError, match="film of a sensor with a mosaic, got counts"):
        film(stack, bits.sensor, window=32)


def test_an_all_zero_capture_is_assumed_to_stand_still():
    sensor = jl.Sensor(frames=32, mosaic="RGGB")
    bits = jl.Bits.from_array(np.zeros((32, 32, 32), bool), sensor=sensor)
    with pytest.warns(jl.JotlightWarning, match="all bits are 0"):
        assert jl.align(bits).model == "none"


def test_the_command_line_simulates_a_moving_mosaic(run, tmp_path):
    photograph = jl.datasets.photograph("astronaut")[:128:2, :160:2]
    jl.save_image(tmp_path / "s.png", photograph.astype(np.float32))
    options = ("--motion", "shake", "--mosaic", "RGGB", "-t", 32, "-k", 1, "-o", "b.npy")
    status, printed = run("simulate", "s.png", *options)
    assert status == 0, printed
    bits = jl.open(tmp_path / "b.npy")
    assert (bits.shape, bits.sensor.mosaic) == ((32, 64, 80), Mosaic("RGGB"))


@pytest.mark.slow
def test_the_command_line_merges_colors_along_the_motion(run, tmp_path):
    _, bits = behind("RGGB", "shake", 48, (64, 80))
    jl.save(bits, tmp_path / "bits.npy")
    status, printed = run(
        "reconstruct", "bits.npy", "--motion", "-o", "out.npy", "--save-motion", "m.safetensors"
    )
    assert status == 0, printed
    assert "motion: " in printed
    assert jl.Motion.load(tmp_path / "m.safetensors").size == (64, 80)
    found = np.load(tmp_path / "out.npy")
    expected, info = jl.reconstruct(jl.merge(bits), return_info=True)
    assert f"by {info.title} in" in printed
    assert info.method == "network-color"
    np.testing.assert_allclose(found, expected, atol=1e-5)
    named = ("bits.npy", "--motion", "-o", "named.npy", "--method", "network-color")
    assert run("reconstruct", *named)[0] == 0
    np.testing.assert_array_equal(np.load(tmp_path / "named.npy"), found)
    arguments = ("bits.npy", "--motion", "-o", "o.npy", "--demosaicing", "differences")
    assert "leave it out" in run("reconstruct", *arguments)[1]
    assert "expected one of network" in run("reconstruct", *arguments[:-1], "none")[1]


@pytest.mark.slow
def test_the_command_line_says_that_a_scene_behind_a_mosaic_stands_still(run, tmp_path):
    _, still = small("RGGB", motion="static")
    jl.save(still, tmp_path / "still.npy")
    status, printed = run("reconstruct", "still.npy", "--motion", "-o", "still_out.npy")
    assert status == 0, printed
    assert "by network, color in" in printed
    assert "the scene stands still" in printed
    assert "0 trials" not in printed
    arguments = ("still.npy", "--motion", "-o", "same.npy", "--demosaicing", "network")
    assert run("reconstruct", *arguments)[0] == 0
    np.testing.assert_array_equal(
        np.load(tmp_path / "same.npy"), np.load(tmp_path / "still_out.npy")
    )
    arguments = ("still.npy", "--motion", "-o", "o.npy", "--maps", "maps.npz")
    assert "maps: the scene stands still behind a mosaic" in run("reconstruct", *arguments)[1]
    np.testing.assert_allclose(
        np.load(tmp_path / "still_out.npy"), jl.reconstruct(still), atol=1e-5
    )
