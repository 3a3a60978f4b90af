import numpy as np
import pytest
from scipy.ndimage import convolve

import jotlight as jl
from jotlight.estimators.denoise import DENOISERS
from reference import methods


def identity(z):
    return z


def blur(z):
    return convolve(z, np.full((3, 3), 1 / 9), mode="reflect")


@pytest.fixture
def counts():
    return np.random.default_rng(0).integers(0, 17, (9, 11))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"threshold": 3, "max_intensity": 9.0},
        {"dark_counts": 0.2, "efficiency": 0.5, "gain": 20.0, "max_intensity": 3.0},
    ],
    ids=str,
)
def test_without_denoising_the_algebraic_inverse_gives_the_maximum_likelihood_estimate(
    counts, options
):
    sensor = jl.Sensor(frames=16, **options)
    estimate = jl.noniterative(counts, sensor, denoiser=identity, inverse="algebraic")
    np.testing.assert_allclose(estimate, jl.mle(counts, sensor), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("inverse", jl.vst.INVERSES)
@pytest.mark.parametrize("threshold", [1, 2])
def test_the_estimate_agrees_with_the_steps_of_the_paper(counts, inverse, threshold):
    sensor = jl.Sensor(
        frames=16, threshold=threshold, dark_counts=0.1, efficiency=0.8, max_intensity=2.0
    )
    z = blur(methods.anscombe(counts, 16))
    if inverse == "exact":
        denoised = np.vectorize(lambda value: methods.exact_inverse(value, 16))(z)
    else:
        denoised = methods.algebraic_inverse(z, 16)
    expected = methods.mle(
        denoised, 16, threshold=threshold, sensitivity=0.8, dark=0.1, max_intensity=2.0
    )
    estimate = jl.noniterative(counts, sensor, denoiser=blur, inverse=inverse)
    np.testing.assert_allclose(estimate, expected, atol=2e-5)


def test_the_denoiser_receives_noise_of_the_standard_deviation_noise():
    inputs = []
    counts = np.random.default_rng(1).binomial(64, 0.4, (200, 200))
    jl.noniterative(counts, jl.Sensor(frames=64), denoiser=lambda z: inputs.append(z) or z)
    (z,) = inputs
    assert (z.dtype, z.shape) == (np.float32, (200, 200))
    assert z.std() == pytest.approx(jl.vst.NOISE, rel=0.02)


@pytest.mark.parametrize("name", [name for name in jl.denoise.DENOISERS if name != "bm3d"])
def test_a_name_selects_the_function_of_that_name(counts, name):
    sensor = jl.Sensor(frames=16)
    function = getattr(jl.denoise, name)
    np.testing.assert_array_equal(
        jl.noniterative(counts, sensor, denoiser=name),
        jl.noniterative(counts, sensor, denoiser=function),
    )


def test_the_defaults_are_total_variation_and_the_exact_inverse(counts):
    sensor = jl.Sensor(frames=16)
    np.testing.assert_array_equal(
        jl.noniterative(counts, sensor),
        jl.noniterative(counts, sensor, denoiser="tv", inverse="exact"),
    )


@pytest.mark.parametrize(
    ("oversampling", "frames"), [(1, 16), (2, 4), (4, 1)], ids=["frames", "both", "jots"]
)
def test_jots_and_frames_are_interchangeable(counts, oversampling, frames):
    sensor = jl.Sensor(oversampling=oversampling, frames=frames)
    expected = jl.noniterative(counts, jl.Sensor(frames=16), denoiser="gaussian")
    estimate = jl.noniterative(counts, sensor, denoiser="gaussian")
    np.testing.assert_array_equal(estimate, expected)


@pytest.mark.slow
@pytest.mark.parametrize("denoiser", [name for name in DENOISERS if name != "bm3d"])
def test_the_exact_inverse_has_a_smaller_error_on_a_real_capture(data, denoiser):
    capture = np.load(data / "real/swissspad2_bird/counts.npz")
    counts, later = capture["k16"], capture["k64"].astype(int) - capture["k16"]
    sensor = jl.Sensor(frames=16, max_intensity=4.0)

    def error(inverse):
        estimate = jl.noniterative(counts, sensor, denoiser=denoiser, inverse=inverse)
        difference = 1 - np.exp(-estimate.astype(float)) - later / 48
        return np.mean(difference[later >= 0] ** 2)

    assert error("exact") < error("algebraic")


def test_the_maximum_likelihood_estimate_of_a_real_capture_agrees_with_the_reference(data):
    counts = np.load(data / "real/swissspad2_bird/counts.npz")["k16"]
    estimate = jl.mle(counts, jl.Sensor(frames=16, max_intensity=4.0))
    np.testing.assert_allclose(estimate, methods.mle(counts, 16, max_intensity=4.0), rtol=1e-6)


def test_pixels_with_dead_jots_have_the_intensity_of_pixels_without():
    mask = np.zeros((8, 8), bool)
    mask[::2, ::2] = True
    bits = np.zeros((3, 8, 8), bool)
    bits[:2] = True
    sensor = jl.Sensor(oversampling=2, frames=3, mask=mask, max_intensity=9.0)
    estimate = jl.noniterative(
        jl.Bits.from_array(bits), sensor, denoiser=identity, inverse="algebraic"
    )
    np.testing.assert_allclose(estimate, np.log(3), rtol=1e-5)


@pytest.mark.parametrize("dead", [0.0, 7.0])
@pytest.mark.parametrize("method", [jl.mle, jl.noniterative])
def test_dark_counts_of_dead_jots_are_ignored(method, dead):
    mask = np.tile(np.eye(2, dtype=bool), (3, 4))
    bits = jl.Bits.from_array(np.random.default_rng(7).random((9, 6, 8)) < 0.6)
    sensor = jl.Sensor(oversampling=2, frames=9, mask=mask, dark_counts=0.25)
    estimate = method(bits, sensor.replace(dark_counts=np.where(mask, dead, 0.25)))
    np.testing.assert_allclose(estimate, method(bits, sensor), rtol=1e-5)


@pytest.mark.parametrize("threshold", [1, 2])
def test_hot_pixels_of_many_bits_are_corrected_for_their_own_dark_counts(threshold):
    rng = np.random.default_rng(2)
    frames, light = 40_000, 0.7
    dark = np.full((40, 40), 0.1)
    dark[::5, ::5] = 0.9
    rate = light + dark
    probability = methods.gammainc(threshold, rate)
    counts = rng.binomial(frames, probability)
    sensor = jl.Sensor(frames=frames, threshold=threshold, dark_counts=dark)
    estimate = jl.noniterative(counts, sensor, denoiser=identity)
    np.testing.assert_allclose(
        estimate,
        jl.mle(counts, sensor),
        atol=4 / frames,
        err_msg="each pixel by its own dark count",
    )
    hot = estimate[::5, ::5]
    slope = (
        np.diff(methods.gammainc(threshold, light + 0.9 + np.array([-0.5, 0.5]) * 1e-6))[0] / 1e-6
    )
    deviation = np.sqrt(probability[0, 0] * (1 - probability[0, 0]) / frames) / slope
    assert hot.mean() == pytest.approx(light, abs=5 * deviation / np.sqrt(hot.size) + 2 / frames)


@pytest.mark.parametrize("threshold", [1, 3])
def test_hot_pixels_without_ones_give_0_and_with_only_ones_give_s(threshold):
    sensor = jl.Sensor(frames=16, threshold=threshold, dark_counts=[[0.0, 0.1, 5.0]])
    for count, light in (0, 0), (16, 1):
        estimate = jl.noniterative([[count] * 3], sensor, denoiser=identity, inverse="algebraic")
        np.testing.assert_allclose(estimate, light, atol=1e-6)


def test_dead_pixels_in_a_dark_region_are_filled_with_darkness():
    mask = np.zeros((20, 20), bool)
    mask[8:12, 12:15] = True
    counts = np.random.default_rng(3).integers(0, 10, (20, 20))
    counts[:, 9:] = 0
    bright = np.where(mask, 9, counts)
    sensor = jl.Sensor(frames=9, mask=mask)
    with pytest.warns(jl.JotlightWarning, match="12 of 400 pixels"):
        estimate = jl.noniterative(bright, sensor, denoiser=identity)
    assert (estimate[8:12, 12:15] < 1e-6).all()


@pytest.mark.parametrize("denoiser", [name for name in DENOISERS if name != "bm3d"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 3)])
def test_tiny_images_have_finite_estimates(denoiser, shape):
    counts = np.random.default_rng(4).integers(0, 17, shape)
    estimate = jl.noniterative(counts, jl.Sensor(frames=16), denoiser=denoiser)
    assert estimate.shape == shape
    assert np.isfinite(estimate).all()


@pytest.mark.parametrize(
    ("denoiser", "error", "message"),
    [
        (
            "no-such-denoiser",
            ValueError,
            f"one of {', '.join(DENOISERS)} or a callable, got 'no-such",
        ),
        (None, TypeError, "a name or a callable, got None"),
        (3, TypeError, "a name or a callable, got 3"),
        (lambda z: z[1:], ValueError, r"image of shape \(9, 11\), got shape \(8, 11\)$"),
        (lambda z: z.T, ValueError, r"got shape \(11, 9\)$"),
        (lambda z: None, ValueError, r"got shape \(\)$"),
        (lambda z: z * np.nan, ValueError, r"got shape \(9, 11\) with NaN or infinity"),
        (lambda z: z + np.inf, ValueError, "with NaN or infinity"),
    ],
)
def test_an_invalid_denoiser_or_result_is_refused(counts, denoiser, error, message):
    with pytest.raises(error, match=message):
        jl.noniterative(counts, jl.Sensor(frames=16), denoiser=denoiser)


def test_the_estimate_stays_in_0_to_s_for_any_result_of_the_denoiser(counts):
    def wild(z):
        return np.linspace(-1e6, 1e6, z.size).reshape(z.shape)

    for inverse in jl.vst.INVERSES:
        sensor = jl.Sensor(frames=16, max_intensity=2.0)
        estimate = jl.noniterative(counts, sensor, denoiser=wild, inverse=inverse)
        assert (estimate.min(), estimate.max()) == (0, 2)


def test_an_unknown_inverse_is_refused_before_any_work(counts):
    def never(z):
        raise AssertionError

    with pytest.raises(ValueError, match="inverse: expected one of exact, algebraic"):
        jl.noniterative(counts, jl.Sensor(frames=16), denoiser=never, inverse="best")
