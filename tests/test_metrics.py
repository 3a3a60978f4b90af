"""Measures of image quality."""

import re
import threading

import numpy as np
import pytest
import skimage.metrics
from scipy.signal import convolve2d

import jotlight as jl
from jotlight import metrics


@pytest.fixture(params=[(24, 31), (12, 15, 3)], ids=["gray", "color"])
def pair(request):
    rng = np.random.default_rng(0)
    truth = rng.random(request.param)
    return np.clip(truth + rng.normal(0, 0.1, truth.shape), 0, 1), truth


def ssim_of_channel(a, b, peak):
    distance = np.arange(-5, 6)
    line = np.exp(-0.5 * (distance / 1.5) ** 2)
    window = np.outer(line, line) / line.sum() ** 2

    def mean(image):
        return convolve2d(image, window, mode="valid")

    covariance = mean(a * b) - mean(a) * mean(b)
    variances = mean(a**2) - mean(a) ** 2 + mean(b**2) - mean(b) ** 2
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    luminance = (2 * mean(a) * mean(b) + c1) / (mean(a) ** 2 + mean(b) ** 2 + c1)
    return np.mean(luminance * (2 * covariance + c2) / (variances + c2))


@pytest.mark.parametrize("peak", [1.0, 2.5])
def test_psnr_agrees_with_scikit_image(pair, peak):
    expected = skimage.metrics.peak_signal_noise_ratio(*pair[::-1], data_range=peak)
    assert metrics.psnr(*pair, data_range=peak) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("measure", [metrics.psnr, metrics.ssim])
def test_gray_levels_without_their_range_are_reported(pair, measure):
    estimate, truth = (255 * image for image in pair)
    axis = {"channel_axis": -1} if measure is metrics.ssim and truth.ndim == 3 else {}
    with pytest.warns(jl.JotlightWarning, match=r"data_range: .* up to 25\d.*pass data_range=255"):
        measure(estimate, truth, **axis)
    with pytest.warns(jl.JotlightWarning, match="data_range=65535 for gray levels"):
        measure(estimate, 257 * truth, **axis)
    stated = measure(estimate, truth, data_range=255, **axis)
    assert stated == pytest.approx(measure(*pair, **axis))
    bright = np.where(truth > 200, truth, truth / 255)  # a few lights in a scene
    assert np.isfinite(measure(estimate, bright, **axis))


def test_snr_is_the_ratio_of_the_powers(pair):
    estimate, truth = pair
    ratio = np.linalg.norm(truth) / np.linalg.norm(estimate - truth)
    assert metrics.snr(estimate, truth) == pytest.approx(20 * np.log10(ratio), rel=1e-12)


@pytest.mark.parametrize("peak", [1.0, 2.5])
def test_ssim_agrees_with_the_formula_of_wang_et_al(pair, peak):
    planes = [np.atleast_3d(image).transpose(2, 0, 1) for image in pair]
    expected = np.mean([ssim_of_channel(a, b, peak) for a, b in zip(*planes, strict=True)])
    axis = None if pair[0].ndim == 2 else -1
    found = metrics.ssim(*pair, data_range=peak, channel_axis=axis)
    assert found == pytest.approx(expected, rel=1e-9)


def test_float32_images_are_compared_in_float64():
    estimate, truth = np.full((8, 8), 1e4, np.float32), np.full((8, 8), 1e4 + 2**-10, np.float32)
    found = metrics.psnr(estimate, truth, data_range=1.0)
    assert found == pytest.approx(20 * np.log10(2**10), rel=1e-12)


@pytest.mark.parametrize("function", [metrics.psnr, metrics.snr])
def test_the_ratios_of_equal_images_are_infinite(function, pair):
    assert function(pair[1], pair[1]) == float("inf")


def test_equal_images_have_a_similarity_of_one(pair):
    axis = None if pair[0].ndim == 2 else -1
    assert metrics.ssim(pair[1], pair[1], channel_axis=axis) == pytest.approx(1, abs=1e-12)


def test_the_similarity_of_a_stack_is_the_mean_of_its_images():
    first, second = np.random.default_rng(1).random((2, 5, 14, 20))
    expected = np.mean([metrics.ssim(*each) for each in zip(first, second, strict=True)])
    assert metrics.ssim(first, second) == pytest.approx(expected, rel=1e-12)
    with pytest.raises(ValueError, match="looks like color; pass channel_axis=-1"):
        metrics.ssim(first[..., :3], second[..., :3])


def test_black_truth_has_no_signal():
    assert metrics.snr(np.ones((2, 2)), np.zeros((2, 2))) == float("-inf")


@pytest.mark.parametrize("function", [metrics.psnr, metrics.snr, metrics.ssim])
@pytest.mark.parametrize(
    ("estimate", "truth", "error", "message"),
    [
        (np.ones((16, 16), int), np.ones((16, 16)), TypeError, "estimate: expected floats"),
        (np.ones((16, 16)), np.ones((16, 16), np.uint8), TypeError, "truth: expected floats"),
        (np.ma.ones((16, 16)), np.ones((16, 16)), TypeError, "estimate: .* got a masked one"),
        (np.ones((16, 16)), np.ma.ones((16, 16)), TypeError, "truth: .* got a masked one"),
        (np.ones((16, 16)), np.ones((16, 17)), ValueError, "expected the same shape"),
        (np.ones((16, 16)), np.ones((16, 16, 1)), ValueError, "expected the same shape"),
        (np.ones(16), np.ones(16), ValueError, "estimate: expected shape"),
        (np.ones((0, 16)), np.ones((0, 16)), ValueError, "estimate: expected shape"),
    ],
)
def test_other_types_and_shapes_are_refused(function, estimate, truth, error, message):
    with pytest.raises(error, match=message):
        function(estimate, truth)


@pytest.mark.parametrize("function", [metrics.psnr, metrics.ssim])
@pytest.mark.parametrize("peak", [0, -1.0, np.nan, np.inf, "1", [1.0, 2.0]])
def test_the_range_is_a_finite_number_above_0(function, peak):
    with pytest.raises(ValueError, match="data_range: expected a finite number above 0, got "):
        function(np.ones((16, 16)), np.zeros((16, 16)), data_range=peak)


def test_a_part_without_masked_pixels_is_compared():
    image = np.ma.masked_array(np.full((80, 64), 0.5), np.arange(80 * 64).reshape(80, 64) > 70 * 64)
    with pytest.raises(TypeError, match=r"such as (.+)$") as error:
        metrics.psnr(image, image.data)
    part = eval(re.search(r"such as (.+)$", str(error.value))[1], {"image": image})
    assert metrics.psnr(part, part + 0.1) == pytest.approx(20)


def test_integer_images_are_divided_by_their_white_level():
    integers = np.random.default_rng(2).integers(0, 256, (2, 16, 16), dtype=np.uint8)
    message = r"such as (image / \S+) for an 8-bit photograph$"
    with pytest.raises(TypeError, match=message) as error:
        metrics.psnr(*integers)
    formula = re.search(message, str(error.value))[1]
    found = metrics.psnr(*(eval(formula, {"image": image}) for image in integers))
    expected = skimage.metrics.peak_signal_noise_ratio(*integers)
    assert found == pytest.approx(expected, rel=1e-12)


def test_ssim_refuses_images_smaller_than_its_window():
    with pytest.raises(ValueError, match="at least 11 x 11 pixels"):
        metrics.ssim(np.ones((10, 40)), np.ones((10, 40)))
    assert metrics.ssim(np.ones((11, 11)), np.ones((11, 11))) == pytest.approx(1)


def test_the_metrics_are_public():
    assert jl.metrics is metrics


def test_ctrl_c_does_not_wait_for_ssim(monkeypatch):
    # Only the main thread reacts to Ctrl-C, so the library computes in another one.
    threads = []

    def similarity(*_, **options):
        threads.append(threading.current_thread())
        return 0.5

    monkeypatch.setattr("skimage.metrics.structural_similarity", similarity)
    assert jl.metrics.ssim(np.zeros((11, 11)), np.zeros((11, 11))) == 0.5
    assert threads[0] is not threading.current_thread()
