import numpy as np
import pytest
import scipy.stats
import skimage.data

from jotlight import datasets


@pytest.mark.parametrize("name", datasets.PHOTOGRAPHS)
def test_photographs_are_gray_levels_divided_by_255(name):
    image = datasets.photograph(name)
    assert image.dtype == np.float32
    np.testing.assert_array_equal(np.rint(image * 255), getattr(skimage.data, name)())
    assert image.max() <= 1


def test_a_photograph_is_decoded_once_and_each_array_is_the_callers_own(monkeypatch):
    first = datasets.photograph("coins")
    monkeypatch.setattr("skimage.data.coins", None)
    second = datasets.photograph("coins")
    first[:] = 0
    np.testing.assert_array_equal(second, datasets.photograph("coins"))
    assert second.max() > 0


def test_the_first_photographs_are_gray_and_the_rest_in_color():
    dimensions = [datasets.photograph(name).ndim for name in datasets.PHOTOGRAPHS]
    assert dimensions == [2, 2, 2, 3, 3, 3, 3]


def test_the_error_of_an_unknown_photograph_lists_the_names():
    with pytest.raises(ValueError, match=r"one of camera, .*, rocket, got 'lena'"):
        datasets.photograph("lena")


def test_the_uniform_scene_is_uniform_and_independent():
    scene = datasets.uniform_scene((200, 300), rng=0)
    assert (scene.dtype, scene.shape) == (np.float32, (200, 300))
    # False alarm: 1 in 1000, once, since the seed is fixed.
    assert scipy.stats.kstest(scene.ravel(), "uniform").pvalue > 1e-3
    for neighbors in (
        (scene[1:] - 0.5) * (scene[:-1] - 0.5),
        (scene[:, 1:] - 0.5) * (scene[:, :-1] - 0.5),
    ):
        assert abs(neighbors.mean()) < 4 * neighbors.std() / np.sqrt(neighbors.size)


def test_a_seed_repeats_a_scene_and_a_generator_advances():
    np.testing.assert_array_equal(datasets.uniform_scene(rng=7), datasets.uniform_scene(rng=7))
    assert (datasets.uniform_scene(rng=7) != datasets.uniform_scene(rng=8)).any()
    rng = np.random.default_rng(7)
    np.testing.assert_array_equal(datasets.uniform_scene(rng=rng), datasets.uniform_scene(rng=7))
    assert (datasets.uniform_scene(rng=rng) != datasets.uniform_scene(rng=7)).any()
    assert (datasets.uniform_scene() != datasets.uniform_scene()).any()
