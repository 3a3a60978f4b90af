"""Batches of training patches."""

import numpy as np
import pytest
from scipy.stats import binom

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.torch.patches import Batch, PatchLoader  # noqa: E402
from jotlight.training.patch_sources import ImagePatches  # noqa: E402

NUMBER = 400
SENSOR = jl.Sensor(oversampling=4, max_intensity=0.8)
LEVEL = np.float32(0.3)


def first_batch(network, batch=NUMBER):
    """Return the first batch of patches of a uniform image."""
    loader = PatchLoader(ImagePatches([np.full((9, 9), LEVEL)]), network, SENSOR, 0, batch, 8)
    return loader.batch(0, slice(0, batch), 1)


@pytest.mark.parametrize("tied", [True, False])
def test_one_patch_in_16_is_far_too_bright_or_too_dark(tied):
    batch = first_batch(jl.Network.initial(SENSOR, tied=tied, taps=3))
    truth, fractions = batch.truth.numpy()[:, 0], batch.data.numpy().mean((1, 2, 3))
    fractions /= SENSOR.trials if tied else 1
    levels = truth[:, 0, 0]
    assert (truth == levels[:, None, None]).all()
    is_extreme = levels != LEVEL
    low, high = binom.ppf([1e-6, 1 - 1e-6], NUMBER, 1 / 16)
    assert low <= is_extreme.sum() <= high
    assert levels.max() == np.float32(SENSOR.max_intensity)
    assert levels.min() < LEVEL / 10
    # Only the bits of a patch beyond the range tell how bright it is.
    assert fractions.max() > 0.99 > SENSOR.probability(np.full((1, 1), 0.8)).max()
    within = levels < SENSOR.max_intensity
    rates = levels[within].astype(float) * SENSOR.gain / SENSOR.trials
    expected = -np.expm1(-rates)
    trials = SENSOR.trials * 64
    deviations = np.sqrt(expected * (1 - expected) / trials)
    assert (abs(fractions[within] - expected) < 6 * deviations + 1 / trials).all()


def test_a_process_gets_its_part_of_the_patches_of_all():
    images = [np.random.default_rng(0).random((20, 24), np.float32)]
    network = jl.Network.residual(SENSOR, "small", rng=0)
    loader = PatchLoader(ImagePatches(images), network, SENSOR, 1, 64, 8)
    whole, part = loader.batch(5, slice(0, 64), 1), loader.batch(5, slice(16, 32), 1)
    np.testing.assert_array_equal(whole.data[16:32], part.data)
    np.testing.assert_array_equal(whole.truth[16:32], part.truth)


@pytest.mark.parametrize(
    ("trials_range", "fraction"),
    [((1, 256), 1 / 2 + np.log(100 / 9) / np.log(256) / 2), ((1, 8), 0), ((20, 50), 1)],
)
def test_half_of_the_steps_use_a_usual_number_of_trials(trials_range, fraction):
    network = jl.Network.conditional("small", trials_range=trials_range, rng=0)
    loader = PatchLoader(ImagePatches([np.full((9, 9), LEVEL)]), network, SENSOR, 0, 1, 8)
    trials = np.array([loader.batch(step, slice(0, 1), 1).trials for step in range(NUMBER)])
    low, high = trials_range
    assert low <= trials.min() < np.sqrt(low * high) < trials.max() <= high
    low, high = [fraction * NUMBER] * 2
    if 0 < fraction < 1:
        low, high = binom.ppf([1e-6, 1 - 1e-6], NUMBER, fraction)
    # Rounding moves numbers across the bounds of the usual range.
    assert low - 6 <= ((trials >= 9) & (trials <= 100)).sum() <= high + 6


def test_most_patches_for_conditional_networks_have_a_usual_light():
    network = jl.Network.conditional("small", rng=0)
    batch = first_batch(network)
    light = batch.light_per_intensity.numpy() * LEVEL
    usual = ((light >= 0.08) & (light <= 1)).mean()
    # Three quarters, and the others that lie there by chance.
    fraction = 3 / 4 + 1 / 4 * np.log(1 / 0.08) / np.log(3 / 0.02)
    low, high = binom.ppf([1e-6, 1 - 1e-6], NUMBER, fraction) / NUMBER
    assert low <= usual <= high
    assert light.min() < 0.05
    assert light.max() > 2
    assert (batch.dark_counts.numpy() == 0).mean() == pytest.approx(0.5, abs=0.15)


def batch_of(truth, light=1.0, dark_counts=0.0, trials=16):
    """Return a batch of one row of intensities, without data."""
    values = torch.tensor(truth, dtype=torch.float32).reshape(1, 1, 1, -1)
    light, dark_counts = torch.tensor([light]), torch.tensor([dark_counts])
    return Batch(torch.zeros_like(values), values, trials, light, dark_counts)


def z_of(intensities, light=1.0, dark_counts=0.0):
    """Return arcsin √p of intensities as a batch of one row."""
    rates = np.asarray(intensities, float) * light + dark_counts
    z = np.arcsin(np.sqrt(-np.expm1(-rates)))
    return torch.tensor(z, dtype=torch.float32).reshape(1, 1, 1, -1)


@pytest.mark.parametrize(("light", "dark_counts"), [(1.0, 0.0), (0.3, 0.1)])
def test_errors_are_those_of_intensities(light, dark_counts):
    rng = np.random.default_rng(0)
    truth = rng.random(50)
    batch = batch_of(truth, light, dark_counts)
    estimates = truth + rng.normal(0, [[0.01], [0.1]], (2, 50)).clip(-truth, 1 - truth)
    ratios = [
        float(batch.errors_of(z_of(estimate, light, dark_counts))[0]) / np.mean(square)
        for estimate, square in zip(estimates, (estimates - truth) ** 2, strict=True)
    ]
    assert ratios[0] == pytest.approx(ratios[1], rel=1e-3)


def test_the_best_estimate_is_the_mean_intensity():
    # The mean of arcsin √p belongs to an intensity of 0.39.
    truth, intensities = [0.0, 1.0], np.linspace(0.01, 1, 100)
    errors = [float(batch_of(truth).errors_of(z_of([value] * 2))[0]) for value in intensities]
    assert intensities[np.argmin(errors)] == pytest.approx(0.5)


@pytest.mark.parametrize("light", [0.02, 1.0, 50.0])
def test_errors_have_gradients_everywhere(light):
    z = torch.linspace(-3, 3, 61).reshape(1, 1, 1, -1).requires_grad_()
    batch = batch_of(np.linspace(0, 30, 61), light)
    batch.errors_of(z).sum().backward()
    assert torch.isfinite(z.grad).all()
    is_right = abs(z - z_of(np.linspace(0, 30, 61), light)) < 0.01
    assert ((z.grad != 0) | (abs(z) < 1e-6) | is_right).all()
