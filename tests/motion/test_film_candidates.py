"""The images that a window may become: which is better, and that none changes the film."""

import copy
import dataclasses

import numpy as np
import pytest

from jotlight.motion.film_candidates import Candidates
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.merge import as_paths
from moving import film_settings, record


def candidates_of(bits, settings, start=0, memory=None):
    merging = FilmMerging(bits.sensor, settings.step)
    return Candidates(bits, start, memory, merging, settings)


@pytest.mark.slow
def test_the_motion_that_explains_the_bits_is_better_unless_merging_rejected_it():
    _, bits = record("shake", frames=32, photons=1.0)
    right = candidates_of(bits, film_settings(32)).fresh()
    nodes = 1.5 * right.motion.nodes
    wrong_motion = dataclasses.replace(right.motion, nodes=nodes)
    paths = as_paths(wrong_motion, right.paths.blocks)
    wrong = dataclasses.replace(right, motion=wrong_motion, paths=paths)
    assert right.explains_more(wrong)
    assert not wrong.explains_more(right)
    rejected = dataclasses.replace(right, image=dataclasses.replace(right.image, still=range(16)))
    assert wrong.explains_more(rejected)
    assert not rejected.explains_more(wrong)


def accepting(candidate, fraction):
    """Return a candidate with this fraction of accepted bits."""
    acceptance = np.full_like(candidate.image.merged.acceptance, fraction)
    merged = dataclasses.replace(candidate.image.merged, acceptance=acceptance)
    image = dataclasses.replace(candidate.image, merged=merged)
    return dataclasses.replace(candidate, image=image)


@pytest.mark.parametrize(
    ("difference", "other_model", "decides"),
    [(0.002, "tiles", False), (0.004, "tiles", True), (0.001, "none", True)],
)
def test_a_motion_along_which_more_bits_agree_is_better(
    monkeypatch, difference, other_model, decides
):
    _, bits = record("static", frames=24, shape=(32, 48))
    found = candidates_of(bits, film_settings(24, step=8, model="none")).fresh()
    few = accepting(found, 0.9)
    few = dataclasses.replace(few, motion=dataclasses.replace(few.motion, model=other_model))
    many = dataclasses.replace(accepting(found, 0.9 + difference), paths=copy.copy(found.paths))
    # The bits are more likely along the other one.
    gains = {id(few.paths): 2.0, id(many.paths): 1.0}
    gain = "jotlight.motion.film_candidates.likelihood_gain"
    monkeypatch.setattr(gain, lambda paths: gains[id(paths)])
    assert many.explains_more(few) == decides
    assert few.explains_more(many) != decides


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
