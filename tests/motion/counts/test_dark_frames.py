"""Frames without light: how they are found, and that they change neither motion nor counts."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import JotlightWarning
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.burst import as_burst
from jotlight.motion.counts.dark_frames import as_spans, find_dark, report_dark
from jotlight.motion.counts.sensor_blocks import as_blocks
from jotlight.motion.displacements.affine import keep_velocities
from jotlight.motion.films.film import film
from jotlight.motion.films.live_film import LiveFilm
from moving import blocks_of, record


def darkened(bits, *spans, keep=0.0):
    """Return bits without those of some spans of frames, or with a fraction of them."""
    array = bits.to_array().copy()
    for span in spans:
        array[slice(*span)] &= np.random.default_rng(9).random(array[slice(*span)].shape) < keep
    return jl.Bits.from_array(array, bits.sensor)


@pytest.mark.parametrize("mean", [100, 3.0, 0.2])
@pytest.mark.parametrize("dark", [(0, 400), (300, 500), (900, 1000), (600, 660)])
def test_dark_spans_are_found_also_in_dim_light(mean, dark):
    rng = np.random.default_rng(3)
    light = np.full(1000, mean)
    light[slice(*dark)] = 0
    found = find_dark(rng.poisson(light), 0.0)
    inside = np.zeros(1000, bool)
    inside[slice(*dark)] = True
    assert not found[~inside].mean() > 0.2 * (mean < 1)
    if mean > 1:
        margin = int(np.ceil(320 / mean))
        assert found[dark[0] + margin : dark[1] - margin].all()
        assert not found[: max(0, dark[0] - margin)].any()
        assert not found[dark[1] + margin :].any()


@pytest.mark.parametrize("mean", [0.01, 1.0, 30.0, 1000.0])
def test_lit_frames_are_never_dark_by_chance(mean):
    rng = np.random.default_rng(4)
    light = mean * (1 + 0.5 * np.sin(np.arange(20_000) / 7))
    assert not find_dark(rng.poisson(light), 0.0).any()


def test_frames_with_nothing_but_dark_counts_are_dark():
    rng = np.random.default_rng(5)
    light = np.where(np.arange(200) < 80, 0, 3000)
    ones = rng.poisson(500 + light)
    assert not find_dark(ones, 0.0).any()
    np.testing.assert_array_equal(find_dark(ones, 500.0), light == 0)
    assert not find_dark(rng.poisson(np.full(200, 500)), 510.0).any()


def test_dark_counts_of_jots_are_no_light():
    _, bits = record("static", frames=40, shape=(32, 48), dark_counts=0.02)
    array = bits.to_array().copy()
    array[10:20] = np.random.default_rng(0).random(array[10:20].shape) < 1 - np.exp(-0.02)
    dark = jl.Bits.from_array(array, bits.sensor)
    blocks = as_blocks(as_burst(dark), block_edges(40), bits.sensor, None)
    assert blocks.burst.dark_spans == [range(10, 20)]


def test_spans_are_listed_in_the_warning():
    with pytest.warns(JotlightWarning, match="not used: 0 to 3, 8, 10 to 11, and others$"):
        report_dark([range(4), range(8, 9), range(10, 12), range(20, 21)])
    with pytest.warns(
        JotlightWarning,
        match="5 and dark ones that follow it; the image shows time 7, which is dark",
    ):
        report_dark([range(5, 9)], 7.0, 9)
    assert as_spans(np.zeros(4, bool)) == []


def test_dark_frames_are_not_counted():
    rng = np.random.default_rng(0)
    array = rng.random((32, 33, 41)) < 0.4
    array[8:13] = array[20] = False
    lit = np.r_[0:8, 13:20, 21:32]
    blocks = as_blocks(as_burst(jl.Bits.from_array(array)), block_edges(32), jl.Sensor(), None)
    fields, times = rng.normal(0, 3, (2, 2, 3, 3)), (0.0, 31.0)
    found = blocks.count(range(32), fields, times)
    without = blocks_of(jl.Bits.from_array(array[lit]))
    places = lit / 31
    expected = without._count_plane(
        without.burst.read(0, 26, None)[0][1], fields.astype("f4"), places
    )
    np.testing.assert_array_equal(found.ones, expected.ones)
    np.testing.assert_array_equal(found.trials, expected.trials)
    np.testing.assert_allclose(found.remainders, expected.remainders, atol=1e-5)
    assert found.frames == 26
    still = blocks.count_unmoved([range(5, 15), range(19, 22)])
    assert (still.trials == 7).all()
    assert still.frames == 7
    none = blocks.count(range(8, 13), fields, times)
    assert none.frames == 0
    assert not none.trials.any()
    assert not none.remainders.any()


def test_the_motion_is_searched_from_the_middle_of_the_light():
    _, bits = record("static", frames=64, shape=(96, 96))
    middles = []
    for spans in ([], [(0, 32)], [(28, 36)], [(24, 64)], [(0, 20), (24, 64)]):
        blocks = as_blocks(as_burst(darkened(bits, *spans)), block_edges(64), bits.sensor, None)
        middles.append(blocks.middle)
        assert blocks.is_lit[np.searchsorted(blocks.edges, blocks.middle, "right") - 1]
    assert middles == [32, 48, 40, 12, 22]


def test_every_nth_frame_is_not_counted_if_a_strobe_leaves_it_dark():
    _, bits = record("static", frames=256, shape=(96, 96), photons=2.0)
    blocks = blocks_of(bits, number=4)
    dark = np.ones(256, bool)
    dark[blocks.with_enough_light().frames(0).start + 1 :: 2] = False
    assert blocks.with_enough_light().step == 2
    burst = dataclasses.replace(blocks.burst, dark=dark)
    strobe = dataclasses.replace(blocks, burst=burst)
    assert strobe.with_enough_light().is_lit.all()


def test_points_keep_their_velocities_before_and_after_all_light():
    _, bits = record("static", frames=64, shape=(32, 48))
    blocks = as_blocks(
        as_burst(darkened(bits, (0, 16), (40, 64))), block_edges(64), bits.sensor, None
    )
    nodes = np.random.default_rng(0).normal(size=(16, 2, 2, 3))
    found = keep_velocities(nodes, blocks)
    np.testing.assert_array_equal(found[4:10], nodes[4:10])
    step = nodes[4] - nodes[5]
    np.testing.assert_allclose(found[0], nodes[4] + 4 * step)
    step = nodes[9] - nodes[8]
    np.testing.assert_allclose(found[15], nodes[9] + 6 * step)
    assert keep_velocities(nodes, blocks_of(bits)) is nodes


SHAKE = {"frames": 128, "shape": (96, 96), "photons": 0.3}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spans", "at"),
    [
        ([(0, 64)], None),
        ([(0, 64)], 20),
        ([(56, 72)], None),
        ([(56, 72)], 30),
        ([(48, 80)], 100),
        ([(40, 128)], 30),
        ([(56, 80)], 5),
        ([(24, 48), (70, 73)], None),
    ],
)
def test_lit_frames_have_the_same_motion_as_without_dark_ones(spans, at):
    _, bits = record("shake", **SHAKE)
    with pytest.warns(JotlightWarning, match=f"dark frames are not used: {spans[0][0]} to"):
        motion = jl.align(darkened(bits, *spans), at=at)
    assert motion.model == "affine"
    lit = [t for t in range(4, 128, 8) if not any(start <= t < stop for start, stop in spans)]
    reference = lit[len(lit) // 2]
    from_there = motion.seen_from(reference)
    whole = jl.align(bits).seen_from(reference)
    errors = [np.hypot(*(from_there.at(t) - whole.at(t))).mean() for t in lit]
    assert np.median(errors) < 0.3
    assert max(errors) < 0.6


@pytest.mark.slow
def test_merged_counts_have_no_dark_frames():
    scene, bits = record("shake", **SHAKE)
    with pytest.warns(JotlightWarning, match="dark frames are not used: 48 to 79"):
        motion = jl.align(darkened(bits, (48, 80)))
    assert not 48 <= motion.reference < 80
    with pytest.warns(JotlightWarning, match="dark frames are not used: 48 to 79"):
        merged = jl.merge(darkened(bits, (48, 80)))
    assert merged.trials.max() == 96
    image = jl.reconstruct(merged)
    assert jl.metrics.psnr(image, scene.image(int(motion.reference))) > 33
    assert np.median(merged.posterior_error) < 1


def test_too_few_lit_frames_show_no_motion():
    _, bits = record("static", frames=32, shape=(32, 48))
    with pytest.warns(JotlightWarning) as found:
        motion = jl.align(darkened(bits, (5, 32)))
    assert motion.model == "none"
    assert "16 or more frames with light" in str(found[0].message)
    assert motion.reference < 5


@pytest.mark.slow
@pytest.mark.parametrize("is_live", [False, True])
def test_films_report_a_dark_span_once_and_show_the_last_frame(is_live):
    _, bits = record("shake", frames=192, shape=(64, 64), photons=0.3)
    dark = darkened(bits, (100, 124))
    live = LiveFilm(bits.sensor, window=64, step=16)
    with pytest.warns(JotlightWarning) as found:
        images = live.add(dark) if is_live else list(film(dark, window=64, step=16, causal=True))
    texts = [str(each.message) for each in found if "dark" in str(each.message)]
    assert texts == ["dark frames are not used: 100 and dark ones that follow it"]
    assert [image.motion.reference for image in images] == [63.0] * 9
