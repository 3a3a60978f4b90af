"""Flags: outlines, rejected bits, and disagreement mark pixels that are not to be trusted."""

import dataclasses

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

import jotlight as jl
from jotlight.motion.agreement import flags as motion_flags
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import disagreement
from jotlight.motion.motion import Motion
from jotlight.motion.tiles import tile_counts
from moving import record

SIZE = 192, 256
NOWHERE = np.zeros(SIZE, np.uint8)


def find_flags(sums, labels, **options):
    return motion_flags.find_flags(sums, disagreement(sums.before, sums.after), labels, **options)


def consistent(accepted=1.0, change=None):
    rng = np.random.default_rng(0)
    share = np.broadcast_to(np.asarray(accepted, np.float32), SIZE)
    halves = []
    for is_after in (False, True):
        p = np.full(SIZE, 0.3)
        if is_after and change is not None:
            p[change] = 0.5
        trials = np.rint(60 * share).astype(np.int32)
        sums = Sums.zeros(SIZE)
        halves.append(Sums(rng.binomial(trials, p).astype(np.int32), trials, sums.remainders, 60))
    return Consistent(*halves, share, np.zeros((0, *SIZE), np.uint8))


@pytest.mark.parametrize(("unclear", "share"), [(False, 0.1), (True, 0.25)])
def test_a_consistent_scene_has_few_flags(unclear, share):
    assert find_flags(consistent(), NOWHERE, is_unclear=unclear).mean() < share


@pytest.mark.parametrize("unclear", [False, True])
def test_dead_jots_are_flagged_but_not_their_neighbors(unclear):
    share = np.ones(SIZE, np.float32)
    dead = np.random.default_rng(1).random(SIZE) < 0.01
    share[dead] = 0
    flags = find_flags(consistent(share), NOWHERE, is_unclear=unclear)
    assert flags[dead].all()
    usual = find_flags(consistent(), NOWHERE, is_unclear=unclear).mean()
    assert flags[~dead].mean() < usual + 0.05


def test_outlines_are_flagged_within_eight_pixels():
    labels = NOWHERE.copy()
    labels[:, 40:] = 1
    flags = find_flags(consistent(), labels)
    assert flags[:, 32:49].all()
    assert flags[:, :31].mean() < 0.15
    assert flags[:, 50:].mean() < 0.15


def test_pixels_whose_bits_were_rejected_are_flagged():
    accepted = np.ones(SIZE)
    accepted[30, 40] = 0.5
    flags = find_flags(consistent(accepted), NOWHERE)
    assert flags[27:34, 37:44].all()
    assert flags.mean() < 0.1


def test_a_change_after_the_reference_time_is_flagged():
    flags = find_flags(consistent(change=(slice(20, 44), slice(30, 60))), NOWHERE)
    assert flags[20:44, 30:60].all()
    assert not flags.all()


def test_more_neighbors_are_flagged_in_unclear_scenes():
    accepted = np.ones(SIZE)
    accepted[30, 40] = 0.5
    few, more = (
        find_flags(consistent(accepted), NOWHERE, is_unclear=unclear) for unclear in (False, True)
    )
    assert more[22:39, 32:49].all()
    assert (few <= more).all()
    assert few.sum() < more.sum()


@pytest.mark.parametrize("size", [(60, 70), (3, 50)])
def test_pixels_near_an_outline_are_those_of_a_maximum_filter(size):
    labels = (np.random.default_rng(2).random(size) < 0.01).astype(np.uint8)
    outlines = np.zeros(size, bool)
    outlines[:, 1:] |= labels[:, 1:] != labels[:, :-1]
    outlines[1:] |= labels[1:] != labels[:-1]
    zeros = Sums.zeros(size)
    ones = dataclasses.replace(zeros, trials=np.ones(size, np.int32))
    sums = Consistent(ones, ones, np.ones(size, np.float32), np.zeros((0, *size), np.uint8))
    found = motion_flags.find_flags(sums, np.ones(size), labels)
    np.testing.assert_array_equal(found, maximum_filter(outlines, 17))


def motion_of(model, labels=NOWHERE):
    nodes = np.zeros((int(labels.max()) + 1, 2, 2, *tile_counts(labels.shape)), np.float32)
    information = np.ones((*nodes.shape[:2], 3, *nodes.shape[3:]), np.float32)
    return Motion(nodes, labels, np.array([0.0, 119.0]), 60.0, model, information)


def of_image(sums, motion, *, is_unclear):
    disagreements, unclear = disagreement(sums.before, sums.after), np.full(SIZE, is_unclear)
    return motion_flags.flags_of_image(sums, disagreements, motion, unclear=unclear)


def scene_with_edge(ones, trials=120, seed=3):
    """Return the sums of a scene with a vertical edge, whose pixels have some ones on average."""
    rng, halves = np.random.default_rng(seed), []
    p = np.where(np.arange(SIZE[1]) < 100, 0.5, 1.5) * ones / trials * np.ones(SIZE)
    p /= p.mean() * trials / ones
    for _ in range(2):
        sums = Sums.zeros(SIZE)
        sums.trials[:], sums.frames = trials // 2, trials // 2
        halves.append(dataclasses.replace(sums, ones=rng.binomial(sums.trials, p).astype(np.int32)))
    return Consistent(*halves, np.ones(SIZE, np.float32), np.zeros((0, *SIZE), np.uint8))


@pytest.mark.parametrize(("ones", "distance"), [(0.5, 24), (12, 16), (41, 11), (60, 9)])
def test_outlines_are_flagged_farther_in_dim_light(ones, distance):
    labels = NOWHERE.copy()
    labels[:, 60:] = 1
    flags = of_image(scene_with_edge(ones), motion_of("segments", labels), is_unclear=False)
    assert flags[:, 60 - distance : 60 + distance + 1].all()
    assert flags[:, 60 - distance - 1].mean() < 0.3
    assert flags[:, 60 + distance + 1].mean() < 0.3


def test_steep_pixels_are_flagged_if_something_moves_in_an_unclear_scene():
    sums = scene_with_edge(40)
    unclear, clear = (
        of_image(sums, motion_of(model), is_unclear=is_unclear)
        for model, is_unclear in (("tiles", True), ("affine", False))
    )
    assert unclear[:, 97:104].all()
    assert unclear.mean() < 0.5
    np.testing.assert_array_equal(clear, find_flags(sums, NOWHERE))
    shown = find_flags(sums, NOWHERE, is_unclear=True)
    for model in ("none", "affine"):  # there is much light
        flags = of_image(sums, motion_of(model), is_unclear=True)
        np.testing.assert_array_equal(flags, shown)
    dim = scene_with_edge(10)
    assert of_image(dim, motion_of("affine"), is_unclear=True)[:, 97:104].all()
    still = of_image(dim, motion_of("none"), is_unclear=True)
    np.testing.assert_array_equal(still, find_flags(dim, NOWHERE, is_unclear=True))


@pytest.mark.parametrize("distance", [0, 3])
def test_steep_pixels_are_flagged_if_the_outermost_frames_are_displaced(distance):
    sums, outermost = scene_with_edge(8), scene_with_edge(4, trials=60, seed=4)
    # The first and the last frames are displaced to opposite sides.
    first, last = (
        dataclasses.replace(each, ones=np.roll(each.ones, side * distance, axis=1))
        for each, side in ((outermost.before, 1), (outermost.after, -1))
    )
    sums = dataclasses.replace(
        sums, before=sums.before + first, after=sums.after + last, outermost=(first, last)
    )
    flags = of_image(sums, motion_of("affine"), is_unclear=False)
    assert flags[:, 98:103].all() == (distance > 0)


@pytest.mark.slow
def test_flags_contain_most_of_the_error_of_a_sheet():
    scene, bits = record("sheet", frames=64, shape=(128, 128), photons=0.2)
    merged, trials = jl.merge(bits), np.full((128, 128), 64.0)
    network = jl.pretrained(bits.sensor)
    ones = np.zeros((128, 128), np.int64)
    for time, frame in enumerate(bits.to_array()):
        positions = np.rint(np.indices(ones.shape) + scene.motion(time)).astype(int)
        seen = ((positions >= 0) & (positions < 128)).all(axis=0)
        ones[seen] += frame[tuple(positions[:, seen])]
        trials -= ~seen
    errors = [
        (network.reconstruct(counts) - scene.image()) ** 2
        for counts in (merged, jl.Merged(ones, trials, bits.sensor))
    ]
    excess = errors[0] - errors[1]
    assert merged.flags.mean() < 0.85
    assert excess[merged.flags].sum() > 0.9 * excess.sum()


def spot(size, share):
    """Return a map with a square of some size, of whose bits only a share was accepted."""
    accepted = np.ones(SIZE)
    accepted[:size, :size] = share
    return accepted


@pytest.mark.parametrize(
    ("model", "accepted", "unclear"),
    [
        ("tiles", 1.0, True),
        ("segments", spot(60, 0.5), False),
        ("affine", spot(60, 0.5), True),
        ("none", spot(60, 0.5), True),
        ("affine", spot(60, 0.9), False),  # weak
        ("affine", spot(8, 0.5), False),  # small
        ("affine", 0.7, False),  # everywhere, as in fine patterns
    ],
)
def test_scenes_are_unclear_if_bits_of_some_parts_are_rejected(model, accepted, unclear):
    pixels = motion_flags.unclear_pixels(consistent(accepted), np.ones(SIZE, np.float32), model)
    assert pixels.any() == unclear
    assert pixels.all() == (model == "tiles")


def test_scenes_are_unclear_if_parts_change_strongly():
    changed = consistent(change=(slice(40, 70), slice(50, 80)))
    for sums, unclear in ((consistent(), False), (changed, True)):
        disagreements = disagreement(sums.before, sums.after)
        pixels = motion_flags.unclear_pixels(sums, disagreements, "affine")
        assert pixels[40:70, 50:80].any() == unclear
        assert pixels[:, 150:].mean() < 0.3  # by chance


@pytest.mark.slow
def test_a_small_light_that_blinks_is_flagged_and_the_rest_of_the_image_is_not():
    bits = jl.Sensor(frames=64, gain=10.0).expose(np.full((96, 128), 0.5), rng=0)
    frames = bits.to_array()
    on = (
        np.random.default_rng(1).random((64, 7, 7))
        < np.where(np.arange(64) // 8 % 2, 0.9, 0.1)[:, None, None]
    )
    frames[:, 60:67, 30:37] = on
    flags = jl.merge(jl.Bits.from_array(frames, bits.sensor)).flags
    assert flags[60:67, 30:37].all()
    assert flags.mean() < 0.5
