"""Patches of films: parts of the same place, and of images with similar numbers of trials."""

import numpy as np
import pytest

from jotlight.networks.planes.film_planes import PLANES
from jotlight.training.film_patches import FilmExample, FilmPatches


def numbered(trials, shape=(12, 15)):
    """Return an image whose planes and truth state the place of each pixel."""
    truth = np.arange(np.prod(shape), dtype=np.float32).reshape(shape)
    planes = np.stack([truth + 1000 * index for index in range(PLANES)])
    return FilmExample(planes, truth, trials, 0.25)


def test_planes_and_truth_are_cut_and_turned_alike():
    rng, example = np.random.default_rng(0), numbered(64.0)
    seen = set()
    for _ in range(60):
        part = example.cut(rng, 5)
        np.testing.assert_array_equal(
            part.planes - 1000 * np.arange(PLANES)[:, None, None], [part.truth] * PLANES
        )
        assert len(np.unique(part.truth)) == 25
        steps = part.truth[0, 1] - part.truth[0, 0], part.truth[1, 0] - part.truth[0, 0]
        seen.add(tuple(float(step) for step in steps))
        assert (part.trials, part.light_per_intensity) == (64.0, 0.25)
    assert len(seen) == 8  # all symmetries of a square


@pytest.mark.slow
def test_the_patches_of_a_step_have_similar_numbers_of_trials():
    source = FilmPatches([numbered(float(trials)) for trials in range(400, 0, -1)])
    assert source.max_side == 12
    rng, firsts = np.random.default_rng(0), []
    for _ in range(50):
        found = [each.trials for each in source.draw_similar(rng, 4, 8)]
        assert max(found) - min(found) <= 4 * 8
        firsts.append(found[0])
    assert min(firsts) < 100
    assert max(firsts) > 300
    drawn = [each.trials for _ in range(600) for each in source.draw_similar(rng, 4, 8)]
    ends = np.mean([each <= 40 or each > 360 for each in drawn])
    assert 0.15 < ends < 0.25  # as frequent as others: 80 of 400 images
    assert source.draw(rng, 4).values.shape == (4, 4)


def test_fingerprints_differ_and_bad_input_is_refused():
    one, other = numbered(64.0), numbered(64.0)
    assert FilmPatches([one]).fingerprint() == FilmPatches([other]).fingerprint()
    other.planes[3, 4, 5] += 1
    assert FilmPatches([one]).fingerprint() != FilmPatches([other]).fingerprint()
    other.planes[3, 4, 5] -= 1
    other.truth[1, 2] += 1
    assert FilmPatches([one]).fingerprint() != FilmPatches([other]).fingerprint()
    with pytest.raises(ValueError, match="examples: expected at least one"):
        FilmPatches([])
    with pytest.raises(ValueError, match=r"planes: expected shape \(14, 4, 5\), got \(8, 4, 5\)"):
        FilmExample(np.zeros((8, 4, 5)), np.zeros((4, 5)), 4.0, 1.0)
