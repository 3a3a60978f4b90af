"""The images that a window may become: which is better, and that none changes the film."""

import copy
import dataclasses
import types

import numpy as np
import pytest

from jotlight.motion.films.candidates import Candidates
from jotlight.motion.films.merging import FilmMerging
from jotlight.motion.merge import as_paths
from moving import film_settings, record


def candidates_of(bits, settings, start=0, memory=None):
    merging = FilmMerging(bits.sensor, settings.step)
    return Candidates(bits, start, memory, merging, settings)


@pytest.mark.slow
def test_the_motion_that_explains_the_bits_is_better_unless_merging_rejected_it():
    _, bits = record("shake", frames=32, photons=1.0)
    candidates = candidates_of(bits, film_settings(32))
    right = candidates.fresh()
    nodes = 1.5 * right.motion.nodes
    wrong_motion = dataclasses.replace(right.motion, nodes=nodes)
    paths = as_paths(wrong_motion, right.paths.blocks)
    wrong = dataclasses.replace(right, motion=wrong_motion, paths=paths)
    assert candidates.explains_more(right, wrong)
    assert not candidates.explains_more(wrong, right)
    rejected = dataclasses.replace(right, image=dataclasses.replace(right.image, still=range(16)))
    assert candidates.explains_more(wrong, rejected)
    assert not candidates.explains_more(rejected, wrong)


@pytest.mark.parametrize(
    ("causal", "models", "difference", "decides"),
    [
        (True, ("tiles", "tiles"), 0.001, True),
        (True, ("affine", "tiles"), 0.002, False),
        (True, ("affine", "tiles"), 0.004, True),
        (False, ("tiles", "tiles"), 0.2, False),
        (False, ("affine", "tiles"), 0.2, False),
        (False, ("segments", "tiles"), 0.002, False),
        (False, ("segments", "tiles"), 0.004, True),
        (False, ("affine", "segments"), 0.004, True),
    ],
)
def test_agreeing_bits_decide_at_the_last_frame_and_about_outlines(
    monkeypatch, causal, models, difference, decides
):
    """Otherwise, likelihoods do."""
    _, bits = record("static", frames=24, shape=(32, 48))
    settings = film_settings(24, step=8, model="none", causal=causal)
    candidates = candidates_of(bits, settings)
    found = candidates.fresh()
    few, many = (
        dataclasses.replace(
            found,
            agreeing=fraction,
            motion=types.SimpleNamespace(model=model),
            paths=copy.copy(found.paths),
        )
        for model, fraction in zip(models, (0.7, 0.7 + difference), strict=True)
    )
    # The bits are more likely along the other one.
    gains = {id(few.paths): 2.0, id(many.paths): 1.0}
    gain = "jotlight.motion.films.candidates.likelihood_gain"
    monkeypatch.setattr(gain, lambda paths: gains[id(paths)])
    assert candidates.explains_more(many, few) == decides
    assert candidates.explains_more(few, many) != decides


def test_each_candidate_has_a_memory_of_its_own():
    _, bits = record("static", frames=32, shape=(32, 48))
    settings = film_settings(24, step=8, model="none")
    first = candidates_of(bits[:24], settings, memory=settings.new_memory()).fresh()
    kept = dict(vars(first.memory))
    second = candidates_of(bits[8:], settings, start=8, memory=first.memory)
    carried, fresh = second.carried(first.motion, 8), second.fresh()
    assert (carried.image.is_carried, fresh.image.is_carried) == (True, False)
    assert carried.image.merged.trials.max() > 24
    np.testing.assert_array_equal(carried.image.merged.ones, fresh.image.merged.ones)
    assert all(vars(first.memory)[name] is value for name, value in kept.items())
    assert vars(carried.memory)["_sums"] is not kept["_sums"]
