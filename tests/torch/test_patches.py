"""What deep networks learn from."""

import numpy as np
import pytest
from scipy.stats import binom

import jotlight as jl

pytest.importorskip("torch")
from jotlight.torch.patches import PatchLoader

NUMBER = 400
SENSOR = jl.Sensor(oversampling=4, max_intensity=0.8)
LEVEL = np.float32(0.3)


def patches(network, batch=NUMBER):
    loader = PatchLoader([np.full((9, 9), LEVEL)], network, SENSOR, 0, batch, 8)
    return loader.batch(0, slice(0, batch), 1)


@pytest.mark.parametrize("tied", [True, False])
def test_some_patches_are_far_too_bright_or_too_dark(tied):
    seen = patches(jl.Network.initial(SENSOR, tied=tied, taps=3))
    truth, shares = seen.truth.numpy()[:, 0], seen.data.numpy().mean((1, 2, 3))
    shares /= SENSOR.bits_per_pixel if tied else 1
    levels = truth[:, 0, 0]
    assert (truth == levels[:, None, None]).all()
    far = levels != LEVEL
    low, high = binom.ppf([1e-6, 1 - 1e-6], NUMBER, 1 / 16)
    assert low <= far.sum() <= high
    assert levels.max() == np.float32(SENSOR.max_intensity)
    assert levels.min() < LEVEL / 10
    # What is past the range is known by its bits alone.
    assert shares.max() > 0.99 > SENSOR.probability(np.full((1, 1), 0.8)).max()
    within = levels < SENSOR.max_intensity
    rates = levels[within].astype(float) * SENSOR.gain / SENSOR.bits_per_pixel
    expected = -np.expm1(-rates)
    trials = SENSOR.bits_per_pixel * 64
    deviations = np.sqrt(expected * (1 - expected) / trials)
    assert (abs(shares[within] - expected) < 6 * deviations + 1 / trials).all()


def test_a_process_sees_its_part_of_the_patches_of_all():
    images = [np.random.default_rng(0).random((20, 24), np.float32)]
    network = jl.Network.residual(SENSOR, "small", rng=0)
    batch = PatchLoader(images, network, SENSOR, 1, 64, 8)
    whole, part = batch.batch(5, slice(0, 64), 1), batch.batch(5, slice(16, 32), 1)
    np.testing.assert_array_equal(whole.data[16:32], part.data)
    np.testing.assert_array_equal(whole.truth[16:32], part.truth)


@pytest.mark.parametrize(
    ("between", "share"),
    [((1, 256), 1 / 2 + np.log(100 / 9) / np.log(256) / 2), ((1, 8), 0), ((20, 50), 1)],
)
def test_half_of_the_steps_have_a_usual_k(between, share):
    network = jl.Network.conditional("small", trials_range=between, rng=0)
    batch = PatchLoader([np.full((9, 9), LEVEL)], network, SENSOR, 0, 1, 8)
    found = np.array([batch.batch(step, slice(0, 1), 1).trials for step in range(NUMBER)])
    assert between[0] <= found.min() < np.sqrt(between[0] * between[1]) < found.max() <= between[1]
    low, high = (
        binom.ppf([1e-6, 1 - 1e-6], NUMBER, share) if 0 < share < 1 else [share * NUMBER] * 2
    )
    # Whole numbers are found from up to half below and above.
    assert low - 6 <= ((found >= 9) & (found <= 100)).sum() <= high + 6


def test_networks_that_are_told_k_see_the_light_of_photographs_most_often():
    network = jl.Network.conditional("small", rng=0)
    seen = patches(network)
    flux = seen.rate_per_intensity.numpy() * LEVEL
    often = ((flux >= 0.08) & (flux <= 1)).mean()
    # Three quarters, and what the others have there by chance.
    share = 3 / 4 + 1 / 4 * np.log(1 / 0.08) / np.log(3 / 0.02)
    low, high = binom.ppf([1e-6, 1 - 1e-6], NUMBER, share) / NUMBER
    assert low <= often <= high
    assert flux.min() < 0.05
    assert flux.max() > 2
    assert (seen.dark_counts.numpy() == 0).mean() == pytest.approx(0.5, abs=0.15)
