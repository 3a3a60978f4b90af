import importlib.util
import sys
import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators import denoise
from jotlight.evaluation.methods import METHODS

needs_bm3d = pytest.mark.skipif(
    importlib.util.find_spec("bm3d") is None, reason="the package bm3d is not installed"
)
NAMES = ["gaussian", "tv", "nlm", pytest.param("bm3d", marks=needs_bm3d)]


def test_every_denoiser_has_a_name():
    assert sorted(denoise.DENOISERS) == ["bm3d", "gaussian", "nlm", "tv"]


@pytest.mark.parametrize("name", NAMES)
def test_noise_is_reduced_and_the_scene_kept(name):
    rows, columns = np.mgrid[:32, :32]
    scene = 3 + np.sin(rows / 6) + (columns > 16)
    noisy = (scene + np.random.default_rng(0).normal(0, jl.vst.NOISE, scene.shape)).astype(
        np.float32
    )
    given = denoise.DENOISERS[name](noisy)
    assert (given.shape, given.dtype) == (scene.shape, np.float32)
    assert np.mean((given - scene) ** 2) < 0.5 * np.mean((noisy - scene) ** 2)


@pytest.mark.parametrize("name", NAMES)
def test_the_input_is_not_changed(name):
    noisy = np.random.default_rng(1).normal(3, 0.5, (16, 16)).astype(np.float32)
    before = noisy.copy()
    denoise.DENOISERS[name](noisy)
    np.testing.assert_array_equal(noisy, before)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (1, 9)])
def test_the_shape_of_the_smallest_images_is_kept(name, shape):
    image = np.random.default_rng(2).normal(3, 0.5, shape).astype(np.float32)
    given = denoise.DENOISERS[name](image)
    assert given.shape == shape
    assert np.isfinite(given).all()


@pytest.mark.parametrize(
    ("function", "option"),
    [(denoise.gaussian, "sigma"), (denoise.tv, "weight"), (denoise.nlm, "strength")],
)
def test_more_strength_leaves_less_noise(function, option):
    noisy = np.random.default_rng(3).normal(3, 0.5, (48, 48)).astype(np.float32)
    left = [function(noisy, **{option: value}).std() for value in (0.1, 0.5, 2)]
    assert left[0] > left[1] > left[2]


def test_a_gaussian_has_the_standard_deviation_in_pixels():
    image = np.zeros((41, 41), np.float32)
    image[20, 20] = 1
    spread = denoise.gaussian(image, 2.5).sum(0)
    distance = np.arange(41) - 20
    assert np.sqrt(spread @ distance**2) == pytest.approx(2.5, rel=0.01)


def test_pick_gives_what_was_named_or_given():
    assert denoise.resolve_denoiser("tv") is denoise.tv
    assert denoise.resolve_denoiser(np.copy) is np.copy


def test_without_its_package_bm3d_says_which_extra_and_licence(monkeypatch):
    monkeypatch.setitem(sys.modules, "bm3d", None)
    with pytest.raises(jl.MissingExtraError, match=r"jotlight\[bm3d\].*non-commercial"):
        jl.noniterative(np.zeros((4, 4), int), jl.Sensor(), denoiser="bm3d")


def test_without_its_package_the_method_is_not_available(monkeypatch):
    method = METHODS["noniterative-bm3d"]
    assert method.available == (importlib.util.find_spec("bm3d") is not None)
    monkeypatch.setitem(sys.modules, "bm3d", None)
    assert not method.available


def test_a_denoiser_that_works_beside_hands_on_errors_and_the_callers_settings():
    with pytest.raises(RuntimeError, match="sequence argument"):
        jl.denoise.gaussian(np.ones((8, 8), np.float32), sigma=[1, 2, 3])
    with np.errstate(all="raise"):
        jl.denoise.gaussian(np.ones((8, 8), np.float32))


def test_methods_are_the_same_in_parts_of_any_size(monkeypatch):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(frames=9, dark_counts=rng.random((30, 40)), mask=rng.random((30, 40)) < 0.1)
    counts = rng.integers(0, 10, (30, 40))
    network = jl.Network.initial(jl.Sensor(frames=9), taps=7)

    def pictures():
        return [
            jl.mle(counts, sensor),
            jl.noniterative(counts, sensor, denoiser="gaussian"),
            network.reconstruct(counts),
        ]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        whole = pictures()
        monkeypatch.setattr("jotlight.chunks._MAX_PIXELS", 7)
        monkeypatch.setattr("jotlight.networks.inference.FLOPS_PER_BAND", 1)
        for one, other in zip(whole, pictures(), strict=True):
            np.testing.assert_array_equal(one, other)
