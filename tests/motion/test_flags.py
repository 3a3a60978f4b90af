"""Flags: outlines, rejected bits, and disagreement mark pixels that are not to be trusted."""

import numpy as np
import pytest

from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import Consistent
from jotlight.motion.flags import find_flags

SIZE = 192, 256
NOWHERE = np.zeros(SIZE, np.uint8)


def consistent(accepted=1.0, change=None):
    rng = np.random.default_rng(0)
    halves = []
    for is_after in (False, True):
        p = np.full(SIZE, 0.3)
        if is_after and change is not None:
            p[change] = 0.5
        trials = np.full(SIZE, 60, np.int32)
        sums = Sums.zeros(SIZE)
        halves.append(Sums(rng.binomial(trials, p).astype(np.int32), trials, sums.remainders, 60))
    share = np.broadcast_to(np.asarray(accepted, np.float32), SIZE)
    return Consistent(*halves, share, np.zeros((0, *SIZE), np.uint8))


@pytest.mark.parametrize(
    ("model", "share"), [("none", 0.1), ("affine", 0.1), ("segments", 0.1), ("tiles", 0.25)]
)
def test_a_consistent_scene_has_few_flags(model, share):
    assert find_flags(consistent(), NOWHERE, model).mean() < share


def test_outlines_are_flagged_within_eight_pixels():
    labels = NOWHERE.copy()
    labels[:, 40:] = 1
    flags = find_flags(consistent(), labels, "segments")
    assert flags[:, 32:49].all()
    assert flags[:, :31].mean() < 0.15
    assert flags[:, 50:].mean() < 0.15


def test_pixels_whose_bits_were_rejected_are_flagged():
    accepted = np.ones(SIZE)
    accepted[30, 40] = 0.5
    flags = find_flags(consistent(accepted), NOWHERE, "affine")
    assert flags[26:35, 36:45].all()
    assert flags.mean() < 0.1


def test_a_change_after_the_reference_time_is_flagged():
    flags = find_flags(consistent(change=(slice(20, 44), slice(30, 60))), NOWHERE, "affine")
    assert flags[20:44, 30:60].all()
    assert not flags.all()


@pytest.mark.parametrize(("model", "share"), [("tiles", 1.0), ("affine", 0.96), ("none", 0.96)])
def test_more_neighbors_are_flagged_in_unclear_scenes(model, share):
    accepted = np.full(SIZE, share)
    accepted[30, 40] = 0.5
    flags = find_flags(consistent(accepted), NOWHERE, model)
    assert flags[18:43, 28:53].all()
    clear = find_flags(consistent(accepted), NOWHERE, "segments")
    assert clear.sum() < flags.sum()
