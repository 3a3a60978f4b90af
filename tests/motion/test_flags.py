"""Flags: outlines, rejected bits, and disagreement mark pixels that are not to be trusted."""

import numpy as np
import pytest

from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import Consistent
from jotlight.motion.flags import find_flags, is_unclear

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


@pytest.mark.parametrize(("unclear", "share"), [(False, 0.1), (True, 0.25)])
def test_a_consistent_scene_has_few_flags(unclear, share):
    assert find_flags(consistent(), NOWHERE, is_unclear=unclear).mean() < share


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
    assert flags[26:35, 36:45].all()
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


@pytest.mark.parametrize(
    ("model", "accepted", "unclear"),
    [
        ("tiles", 1.0, True),
        ("affine", 0.96, True),
        ("none", 0.96, True),
        ("affine", 0.995, False),
        ("segments", 0.96, False),
    ],
)
def test_scenes_are_unclear_if_the_model_does_not_explain_them(model, accepted, unclear):
    assert is_unclear(consistent(accepted), model) == unclear
