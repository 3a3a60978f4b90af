"""The automatic weight of total variation."""

import numpy as np
import pytest

import jotlight as jl
from reference.iterative import run, scene


def automatic(counts, trials=16, norm="isotropic", **options):
    counts = np.asarray(counts)
    likelihood = jl.Likelihood(counts, trials=trials, **options)
    problem = jl.Problem(jl.operators.scaling(counts.shape, 1.0), likelihood, 4.0)
    return jl.tv.automatic_weight(problem, norm=norm)


def test_darker_parts_have_larger_weights():
    counts = np.random.default_rng(16).binomial(16, np.linspace(0.05, 0.9, 40) * np.ones((30, 1)))
    weight = automatic(counts)
    assert weight.shape == (30, 40)
    columns = weight.mean(axis=0)
    assert (np.diff(columns[::8]) < 0).all()
    assert columns[0] > 2 * columns[-1]


def test_with_more_bits_a_scene_is_smoothed_less_relative_to_its_noise():
    rng = np.random.default_rng(17)
    share = -np.expm1(-scene(64, 64))
    few, many = (automatic(rng.binomial(bits, share), bits) for bits in (16, 256))
    # The noise is 1/√I. Were λ ∝ √I alone, the ratio would be the upper bound √(256/16) = 4.
    assert 1 < many.mean() / few.mean() < 4


@pytest.mark.parametrize("turn", [np.flipud, np.fliplr, np.rot90, np.transpose])
def test_rotated_and_mirrored_data_give_rotated_and_mirrored_weights(turn):
    counts = np.random.default_rng(18).binomial(16, -np.expm1(-scene(12, 16)))
    turned = automatic(np.ascontiguousarray(turn(counts)))
    np.testing.assert_allclose(turned, turn(automatic(counts)), rtol=1e-9)


def test_the_anisotropic_weight_is_smaller_by_the_mean_over_directions():
    counts = np.random.default_rng(18).binomial(16, 0.4, (20, 20))
    np.testing.assert_allclose(
        automatic(counts, norm="anisotropic"), np.pi / 4 * automatic(counts), rtol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize("kernel", ["box", "linear", "cubic"])
@pytest.mark.parametrize("fill", ["zeros", "ones", "noise"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (8, 8)], ids=str)
def test_the_weight_is_finite_and_positive_for_tiny_and_extreme_data(
    shape, fill, kernel, threshold
):
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, threshold=threshold)
    probability = {"zeros": 0.0, "ones": 1.0, "noise": 0.3}[fill]
    jots = (4, 2 * shape[0], 2 * shape[1])
    bits = jl.Bits.from_array(np.random.default_rng(19).random(jots) < probability)
    estimate, history, _ = run(jl.admm_tv, bits, sensor)
    assert history.weight.shape == estimate.shape == shape
    assert np.isfinite(history.weight).all()
    assert (history.weight > 0).all()
    if fill != "noise":
        np.testing.assert_allclose(estimate, probability, atol=0.05)


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_the_weight_is_finite_and_positive_with_dead_jots(kernel):
    mask = np.random.default_rng(20).random((32, 32)) < 0.4
    mask[8:24, 8:16] = True
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, mask=mask)
    bits = sensor.expose(np.full((16, 16), 0.5), rng=21)
    estimate, history, _ = run(jl.admm_tv, bits, sensor)
    assert np.isfinite(history.weight).all()
    assert (history.weight > 0).all()
    assert np.abs(estimate - 0.5).mean() < 0.08


def test_the_error_of_a_weight_that_is_no_number_shows_it():
    with pytest.raises(ValueError, match=r"weight: expected a number, .* got '2'"):
        jl.tv.check_map("weight", "2", (4, 4))


def test_rare_photons_have_the_same_weight_in_any_number_of_frames():
    counts = np.random.default_rng(22).poisson(100 * scene(40, 40))
    few, many = (automatic(counts, frames) / frames for frames in (10**4, 10**8))
    np.testing.assert_allclose(many, few, rtol=0.05)


@pytest.mark.parametrize("ones", [0.02, 0.3])
def test_dim_flat_scenes_keep_their_light_without_dots(ones):
    sensor = jl.Sensor(frames=64, gain=2 * ones)
    counts = sensor.expose(np.full((96, 96), 0.5), rng=0).counts()
    estimate, history = jl.admm_tv(counts, sensor, return_history=True)
    assert history.converged
    assert estimate.mean() == pytest.approx(counts.mean() / sensor.gain, rel=0.03)
    assert estimate.std() < 0.05 * estimate.mean()


def test_dim_scenes_are_nearly_as_good_as_with_the_best_weight():
    image = jl.datasets.photograph("camera")[::4, ::4][32:96, 32:96].astype(float)
    sensor = jl.Sensor(frames=16, gain=16 * 0.01)
    counts = sensor.expose(image, rng=0).counts()
    problem = jl.Problem(
        jl.operators.scaling(image.shape, sensor.gain / 16), jl.Likelihood(counts, 16), 1.0
    )
    automatic = jl.tv.automatic_weight(problem)
    quality = {
        factor: jl.metrics.psnr(jl.admm_tv(counts, sensor, weight=factor * automatic), image)
        for factor in (0.7, 1, 1.5)
    }
    assert quality[1] > max(quality.values()) - 0.5
