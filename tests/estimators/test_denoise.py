import importlib.util
import inspect
import sys

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators import denoise
from jotlight.evaluation.methods import METHODS

needs_bm3d = pytest.mark.skipif(
    importlib.util.find_spec("bm3d") is None, reason="the package bm3d is not installed"
)
NAMES = [
    pytest.param(name, marks=[needs_bm3d] if name == "bm3d" else []) for name in denoise.DENOISERS
]


@pytest.mark.parametrize("name", NAMES)
def test_the_mean_square_error_is_at_least_halved(name):
    rows, columns = np.mgrid[:32, :32]
    scene = 3 + np.sin(rows / 6) + (columns > 16)
    noisy = (scene + np.random.default_rng(0).normal(0, jl.vst.NOISE, scene.shape)).astype(
        np.float32
    )
    denoised = denoise.DENOISERS[name](noisy)
    assert (denoised.shape, denoised.dtype) == (scene.shape, np.float32)
    assert np.mean((denoised - scene) ** 2) < 0.5 * np.mean((noisy - scene) ** 2)


@pytest.mark.parametrize("name", NAMES)
def test_the_input_is_not_modified(name):
    noisy = np.random.default_rng(1).normal(3, 0.5, (16, 16)).astype(np.float32)
    before = noisy.copy()
    denoise.DENOISERS[name](noisy)
    np.testing.assert_array_equal(noisy, before)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dtype", [np.int32, np.uint8, np.float64])
def test_integers_are_denoised_as_floats_of_the_same_values(name, dtype):
    counts = np.random.default_rng(4).binomial(16, 0.3, (24, 32)).astype(dtype)
    expected = denoise.DENOISERS[name](counts.astype(np.float32))
    np.testing.assert_array_equal(denoise.DENOISERS[name](counts), expected)
    assert expected.mean() == pytest.approx(counts.mean(), rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_each_image_of_a_stack_is_denoised(name):
    stack = np.random.default_rng(5).normal(3, 0.5, (2, 3, 16, 20)).astype(np.float32)
    found = denoise.DENOISERS[name](stack)
    assert found.shape == stack.shape
    for index in np.ndindex(2, 3):
        np.testing.assert_array_equal(found[index], denoise.DENOISERS[name](stack[index]))
    color = denoise.DENOISERS[name](stack, channel_axis=1)
    np.testing.assert_array_equal(color, found)


def test_colors_are_not_taken_for_columns():
    with pytest.raises(ValueError, match="looks like color; pass channel_axis=-1"):
        jl.denoise.tv(np.zeros((24, 32, 3), np.float32))


@pytest.mark.parametrize("wrong", [np.zeros(5), [["a", "b"]], 3, np.zeros((0, 5))])
def test_what_is_no_image_is_refused(wrong):
    with pytest.raises(ValueError, match=r"image: expected (numbers|shape \(H, W\))"):
        jl.denoise.tv(wrong)


@pytest.mark.parametrize(("function", "name"), [(denoise.tv, "weight"), (denoise.nlm, "strength")])
@pytest.mark.parametrize("wrong", [0, -1.0, np.nan, "0.5"])
def test_a_strength_must_be_positive(function, name, wrong):
    with pytest.raises(ValueError, match=f"{name}: expected a finite number above 0, got"):
        function(np.ones((8, 8)), wrong)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(1, 1), (8, 8), (1, 9)])
def test_tiny_images_keep_their_shape(name, shape):
    image = np.random.default_rng(2).normal(3, 0.5, shape).astype(np.float32)
    denoised = denoise.DENOISERS[name](image)
    assert denoised.shape == shape
    assert np.isfinite(denoised).all()


@pytest.mark.parametrize(
    ("function", "option"),
    [(denoise.gaussian, "sigma"), (denoise.tv, "weight"), (denoise.nlm, "strength")],
)
def test_a_larger_strength_leaves_less_noise(function, option):
    noisy = np.random.default_rng(3).normal(3, 0.5, (48, 48)).astype(np.float32)
    remaining = [function(noisy, **{option: value}).std() for value in (0.1, 0.5, 2)]
    assert remaining[0] > remaining[1] > remaining[2]


def test_the_gaussian_has_the_stated_standard_deviation_in_pixels():
    image = np.zeros((41, 41), np.float32)
    image[20, 20] = 1
    spread = denoise.gaussian(image, 2.5).sum(0)
    distance = np.arange(41) - 20
    assert np.sqrt(spread @ distance**2) == pytest.approx(2.5, rel=0.01)


def test_resolve_denoiser_accepts_a_name_or_a_callable():
    assert denoise.resolve_denoiser("tv") is denoise.tv
    assert denoise.resolve_denoiser(np.copy) is np.copy


def test_without_its_package_bm3d_names_the_extra_and_its_license(monkeypatch):
    monkeypatch.setitem(sys.modules, "bm3d", None)
    with pytest.raises(jl.MissingExtraError, match=r"jotlight\[bm3d\].*non-commercial"):
        jl.noniterative(np.zeros((4, 4), int), jl.Sensor(), denoiser="bm3d")


@pytest.mark.parametrize("sigma", [-1, np.nan, np.inf])
def test_bad_standard_deviations_are_refused(sigma):
    with pytest.raises(ValueError, match="sigma: expected a number from 0 to 1000, got"):
        denoise.gaussian(np.ones((8, 8), np.float32), sigma=sigma)


def test_without_its_package_the_bm3d_method_is_unavailable(monkeypatch):
    method = METHODS["noniterative-bm3d"]
    assert method.available == (importlib.util.find_spec("bm3d") is not None)
    monkeypatch.setitem(sys.modules, "bm3d", None)
    assert not method.available


def test_a_denoiser_in_a_thread_raises_its_errors_and_uses_the_callers_numpy_settings():
    with pytest.raises(ValueError, match=r"sigma: .* got \[1, 2, 3\]"):
        jl.denoise.gaussian(np.ones((8, 8), np.float32), sigma=[1, 2, 3])
    with np.errstate(all="raise"):
        jl.denoise.gaussian(np.ones((8, 8), np.float32))


@pytest.mark.parametrize("name", denoise.DENOISERS)
def test_help_lists_the_axis_of_color_channels(name):
    function = denoise.DENOISERS[name]
    axis = inspect.signature(function).parameters["channel_axis"]
    assert axis.kind is inspect.Parameter.KEYWORD_ONLY
    assert axis.default is None
    assert "channel_axis : int, optional" in function.__doc__
