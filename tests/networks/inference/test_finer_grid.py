"""The image of counts on a grid of half pixels: exact steps, and what the image shows."""

import itertools

import numpy as np
import pytest
from scipy.optimize import approx_fprime

import jotlight as jl
from jotlight.networks.inference.finer_grid import (
    Prior,
    Squares,
    average_squares,
    coarse_counts,
    enlarge,
    fit_light,
    spread_squares,
)
from jotlight.sensing.likelihood.likelihood import Likelihood

RNG = np.random.default_rng(0)
SIZE = 6, 8


def matrix_of(function, size):
    """Return the matrix of a linear function of images, column by column."""
    columns = []
    for place in np.ndindex(*size):
        unit = np.zeros(size)
        unit[place] = 1
        columns.append(function(unit).ravel())
    return np.stack(columns, axis=1)


def test_each_reading_averages_four_pixels():
    image = RNG.random(SIZE)
    means = average_squares(image)
    for row, column in itertools.product(range(SIZE[0]), range(SIZE[1])):
        square = [
            image[min(row + down, SIZE[0] - 1), min(column + right, SIZE[1] - 1)]
            for down, right in itertools.product((0, 1), (0, 1))
        ]
        assert means[row, column] == pytest.approx(np.mean(square))


def test_spreading_is_the_adjoint():
    forth, back = (matrix_of(each, SIZE) for each in (average_squares, spread_squares))
    np.testing.assert_allclose(back, forth.T)


@pytest.mark.parametrize("threshold", [1, 3])
def test_derivatives_are_those_of_the_likelihood(threshold):
    trials = RNG.integers(0, 30, SIZE).astype(float)
    ones = RNG.binomial(trials.astype(int), 0.4).astype(float)
    efficiency, dark = 0.5 + 0.4 * RNG.random(SIZE), 0.1 * RNG.random(SIZE)
    squares = Squares(ones, trials, efficiency, dark, threshold)
    light = 0.5 + RNG.random(SIZE)
    score, information = squares.derivatives(light)
    likelihood = Likelihood(
        ones.astype(np.int32),
        trials=trials,
        threshold=threshold,
        efficiency=efficiency,
        dark_counts=dark,
    )
    numeric = approx_fprime(light.ravel(), lambda x: likelihood.value(x.reshape(SIZE)), 1e-6)
    np.testing.assert_allclose(score.ravel(), numeric, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(information, likelihood.information(light), rtol=1e-6)


def test_the_fitted_light_solves_the_equations():
    trials = RNG.integers(20, 60, SIZE).astype(float)
    squares = Squares(np.round(0.3 * trials), trials, 1.0, 0.0, 1)
    light = 0.2 + 0.3 * RNG.random(SIZE)
    score, information = squares.derivatives(average_squares(light))
    precision = 0.25 * information.mean() * np.ones(SIZE)
    matrix = matrix_of(average_squares, SIZE)
    left = matrix.T @ np.diag(information.ravel()) @ matrix + np.diag(precision.ravel())
    expected = light.ravel() + np.linalg.solve(left, matrix.T @ score.ravel())
    found = fit_light(squares, light, precision).ravel()
    scale = abs(expected - light.ravel()).max()
    np.testing.assert_allclose(found, expected, atol=0.03 * scale)


def test_the_noise_of_a_step_is_at_most_that_which_the_network_expects():
    """For equal squares and all frequencies: D b²/(D b² + K/4)² is at most 1/K."""
    response = np.linspace(0, 1, 101) ** 2
    for trials, k in itertools.product((4.0, 64.0, 1000.0), repeat=2):
        noise = trials * response / (trials * response + 0.25 * k) ** 2
        assert noise.max() <= 1 / k + 1e-12


def zone_plate(size, slope):
    rows, columns = np.indices((size, size)) - (size - 1) / 2
    squared = rows**2 + columns**2
    return 0.5 + 0.45 * np.cos(np.pi * slope * squared), slope * np.sqrt(squared)


def merged_of(image, trials, photons=0.5, seed=0):
    """Return exact counts of the squares of a fine image, (2 H, 2 W)."""
    gain = photons / image.mean()
    sensor = jl.Sensor(frames=int(4 * np.max(trials)), gain=gain * int(4 * np.max(trials)))
    p = -np.expm1(-gain * average_squares(image))
    ones = np.random.default_rng(seed).binomial(np.broadcast_to(trials, image.shape), p)
    trials = np.broadcast_to(np.asarray(trials, float), image.shape)
    return jl.Merged(ones, trials, sensor, upsample=2)


def test_frequencies_beyond_those_of_the_sensor_appear():
    image, frequency = zone_plate(128, 0.3 / 64)
    merged = merged_of(image, 100)
    network = jl.pretrained(merged.sensor)
    fine = network.reconstruct(merged)
    coarse = enlarge(network.reconstruct(coarse_counts(merged)))
    # Frequencies are in cycles per fine pixel, so half a cycle per jot is a quarter.
    ring = (abs(frequency - 0.25) < 0.02)[8:-8, 8:-8]
    contrasts = []
    for estimate in (fine, coarse):
        shown, truth = (each[8:-8, 8:-8][ring] - 0.5 for each in (estimate, image))
        contrasts.append(float((shown - shown.mean()) @ truth / (truth @ truth)))
    assert contrasts[0] > 0.6
    assert contrasts[1] < 0.35
    inner = slice(8, -8), slice(8, -8)
    psnr = [jl.metrics.psnr(each[inner], image[inner], data_range=1) for each in (fine, coarse)]
    assert psnr[0] > psnr[1] + 3


def test_a_scene_without_detail_gets_no_lines():
    rows, columns = np.indices((96, 96))
    image = 0.5 + 0.3 * np.sin(rows / 30) * np.cos(columns / 25)
    merged = merged_of(image, 64, photons=0.2)
    network = jl.pretrained(merged.sensor)
    fine = network.reconstruct(merged)
    errors = [fine - image, enlarge(network.reconstruct(coarse_counts(merged))) - image]
    # Differences of neighbors show lines.
    lines = [np.sqrt(np.mean(np.diff(each[8:-8, 8:-8], axis=1) ** 2)) for each in errors]
    assert lines[0] < max(1.5 * lines[1], 0.003)
    rms = [np.sqrt(np.mean(each[8:-8, 8:-8] ** 2)) for each in errors]
    assert rms[0] < 1.1 * rms[1]


def test_pixels_without_readings_are_completed():
    image, _ = zone_plate(64, 0.1 / 32)
    trials = np.zeros((64, 64), int)
    trials[::2, ::2] = 200  # as of a scene that stands still
    merged = merged_of(image, trials)
    estimate = jl.pretrained(merged.sensor).reconstruct(merged)
    inner = slice(8, -8), slice(8, -8)
    assert jl.metrics.psnr(estimate[inner], image[inner], data_range=1) > 27


@pytest.mark.parametrize("photons", [0.01, 3.0])
def test_dim_and_bright_light(photons):
    """Very bright sensors estimate the probability of a zero."""
    image = np.full((48, 48), 0.5)
    image[:, 24:] = 0.25
    merged = merged_of(image, 400, photons=photons)
    estimate = jl.pretrained(merged.sensor).reconstruct(merged)
    for columns in (slice(4, 20), slice(28, 44)):
        # At 0.01 photons, the mean of the data has an error of 1.6 to 2.2 % itself.
        fraction = merged.ones[:, columns].sum() / merged.trials[:, columns].sum()
        expected = -np.log1p(-fraction) / merged.sensor.light_per_intensity
        assert estimate[:, columns].mean() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("threshold", [1, 3])
def test_coarse_counts_are_sums(threshold):
    ones, trials = RNG.integers(0, 5, (4, 6)), RNG.integers(5, 9, (4, 6)).astype(float)
    trials[:2, :2], ones[:2, :2] = 0, 0
    dark = RNG.random((4, 6))
    efficiency = RNG.uniform(0.1, 1, (4, 6))
    maps = {"dark_counts": dark, "efficiency": efficiency}
    merged = jl.Merged(ones, trials, jl.Sensor(threshold=threshold), **maps, upsample=2)
    coarse = coarse_counts(merged)
    for row, column in np.ndindex(2, 3):
        square = slice(2 * row, 2 * row + 2), slice(2 * column, 2 * column + 2)
        assert coarse.ones[row, column] == ones[square].sum()
        assert coarse.trials[row, column] == trials[square].sum()
        weights = trials[square] if trials[square].any() else None
        expected = np.average(dark[square], weights=weights)
        if threshold == 1:  # as many ones
            expected = -np.log(np.average(np.exp(-dark[square]), weights=weights))
        assert coarse.dark_counts[row, column] == pytest.approx(expected)
        expected = np.average(efficiency[square], weights=weights)
        assert coarse.efficiency[row, column] == pytest.approx(expected)


def test_an_enlarged_ramp_is_at_its_place():
    """Pixel i is the mean of the squares of 2 i and 2 i + 1, which are around 2 i + 1."""
    fine = np.arange(40.0) * np.ones((8, 1))
    squares = average_squares(fine)
    coarse = squares.reshape(4, 2, 20, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(enlarge(coarse)[:, 8:-8], fine[:, 8:-8], atol=0.01)


def test_a_map_of_trials_turns_with_the_image():
    sensor = jl.Sensor(frames=100)
    trials = np.linspace(10, 200, 32 * 48, dtype=np.float32).reshape(32, 48)
    light = 0.2 + 0.1 * RNG.random((32, 48))
    prior = Prior(jl.pretrained(sensor), sensor, False, None)
    turned = prior.denoise(np.rot90(light), np.ascontiguousarray(np.rot90(trials)), (3,))
    np.testing.assert_allclose(np.rot90(turned, 3), prior.denoise(light, trials, (0,)), rtol=1e-4)


def test_other_methods_refuse_a_finer_grid():
    merged = merged_of(np.full((16, 16), 0.5), 16)
    for method in ("mle", "admm-tv", "held-out"):
        with pytest.raises(ValueError, match="data: expected counts of single pixels"):
            jl.reconstruct(merged, method=method)
    with pytest.raises(ValueError, match="data: expected counts of single pixels"):
        jl.uncertainty(merged)
    plain = jl.Merged(merged.ones, merged.trials, merged.sensor)
    with pytest.raises(ValueError, match="the same grid"):
        jl.pretrained(merged.sensor).reconstruct([merged, plain])
    with pytest.raises(ValueError, match="upsample: expected"):
        jl.Merged(merged.ones, merged.trials, merged.sensor, upsample=4)


def test_the_network_is_chosen_for_many_trials():
    """Above 1,000 trials, other merged counts would be blended on held-out bits."""
    merged = merged_of(np.full((16, 16), 0.5), 400)
    estimate, info = jl.reconstruct(merged, return_info=True)
    assert info.method == "network-medium"
    np.testing.assert_array_equal(estimate, jl.pretrained(merged.sensor).reconstruct(merged))
