"""Splits of a capture's bits into input and target, and the likelihood of the target."""

import numpy as np
import pytest
from scipy import stats

import jotlight as jl

torch = pytest.importorskip("torch")

from jotlight.sensing.data.pixel_counts import count_pixels  # noqa: E402
from jotlight.torch.bit_splitting import BitSplitter  # noqa: E402

SCENE = np.kron([[0.1, 0.7, 0.3], [0.9, 0.2, 0.5], [0.4, 0.8, 0.1]], np.ones((16, 16)))
SENSOR = jl.Sensor(frames=8)
CONDITIONAL = jl.Network.conditional("small", rng=0)
SINGLE_K = jl.Network.residual(SENSOR, "small", rng=0)
FALSE_ALARMS = 1e-9
"""Probability that a correct program fails a statistical test."""


def bit_splitter(network, sensor, data, seed=0):
    channels = [count_pixels(data, sensor, None)]
    return BitSplitter(network, sensor, channels, np.random.default_rng(seed))


@pytest.mark.parametrize("frames", [2, 3, 8, 40])
def test_every_bit_belongs_to_exactly_one_part(frames):
    sensor = SENSOR.replace(frames=frames)
    bits = sensor.expose(SCENE, rng=frames)
    splitter = bit_splitter(CONDITIONAL, sensor, bits)
    ((training_ones, training_trials),), (held_out,) = splitter.training_bits, splitter.held_out
    held_out_ones, held_out_trials = held_out.planes[0, 1:3].numpy()
    np.testing.assert_array_equal(training_ones + held_out_ones, bits.counts())
    np.testing.assert_array_equal(training_trials + held_out_trials, frames)
    assert (training_ones >= 0).all()
    assert (training_ones <= training_trials).all()
    # A tenth of the bits is held out; its fractional part becomes one more bit in some pixels.
    whole, tenths = divmod(frames, 10)
    extra = int(held_out_trials.sum()) - whole * held_out_trials.size
    assert set(np.unique(held_out_trials)) <= {whole, whole + 1}
    assert stats.binomtest(extra, held_out_trials.size, tenths / 10).pvalue > FALSE_ALARMS
    rng = np.random.default_rng(0)
    for _ in range(5):
        split = splitter.draw(rng, 3, 20)
        counts, ones, trials = split.planes[:, :3].unbind(1)
        assert split.planes.shape == (3, 5, 20, 20)
        assert split.input_trials == split.network_trials < frames
        assert ((ones >= 0) & (ones <= trials)).all()
        assert ((counts >= 0) & (counts <= split.input_trials)).all()
        assert trials.max() <= frames - 1
        assert trials.sum() > 0


def test_dead_jots_have_no_bits_in_any_part():
    mask = np.zeros(SCENE.shape, bool)
    mask[10:14, 20:23] = mask[40, 40] = True
    sensor = SENSOR.replace(mask=mask)
    with pytest.warns(jl.JotlightWarning, match="13 of 2304 pixels have no valid bit"):
        splitter = bit_splitter(CONDITIONAL, sensor, sensor.expose(SCENE, rng=0))
    assert splitter.held_out[0].planes[0, 2].numpy()[mask].max() == 0
    assert splitter.training_bits[0][1][mask].max() == 0


@pytest.mark.parametrize("network", [CONDITIONAL, SINGLE_K], ids=["conditional", "single K"])
@pytest.mark.parametrize("threshold", [1, 2])
def test_the_truth_has_the_highest_likelihood(network, threshold):
    """The likelihood also holds with maps of dark counts and efficiency."""
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(
        frames=200,
        gain=200.0 * threshold,
        threshold=threshold,
        dark_counts=rng.uniform(0, 0.3, SCENE.shape),
        efficiency=rng.uniform(0.3, 1, SCENE.shape),
    )
    if network is SINGLE_K:
        network = jl.Network.residual(
            sensor.replace(dark_counts=0.1, efficiency=0.6), "small", rng=0
        )
    splitter = bit_splitter(network, sensor, sensor.expose(SCENE, rng=1))
    (held_out,) = splitter.held_out

    def negative_log_likelihood(scene):
        estimate = torch.from_numpy(scene)[None, None]
        if splitter.conditional:
            without_maps = splitter.sensor_with_trials(200)
            estimate = torch.from_numpy(without_maps.probability(scene))[None, None].double()
        return float(splitter.negative_log_likelihood(estimate, held_out))

    best = negative_log_likelihood(SCENE)
    # It is the entropy of the bits, up to their own noise.
    p = sensor.probability(SCENE).astype(float)
    trials = held_out.planes[0, 2].numpy()
    entropy = -(p * np.log(p) + (1 - p) * np.log1p(-p))
    deviation = np.sqrt((trials * p * (1 - p) * np.log(p / (1 - p)) ** 2).sum()) / trials.sum()
    sigmas = stats.norm.isf(FALSE_ALARMS / 2)
    assert abs(best - (trials * entropy).sum() / trials.sum()) < sigmas * deviation + 1e-4
    for other in (0.8 * SCENE, 1.2 * SCENE, SCENE + 0.1, SCENE[::-1].copy()):
        assert negative_log_likelihood(other) > best


@pytest.mark.parametrize("threshold", [1, 2])
def test_the_gradient_of_the_likelihood_agrees_with_finite_differences(threshold):
    sensor = SENSOR.replace(threshold=threshold, dark_counts=np.full(SCENE.shape, 0.1))
    for network in (
        CONDITIONAL,
        jl.Network.residual(sensor.replace(dark_counts=0.1), "small", rng=0),
    ):
        splitter = bit_splitter(network, sensor, sensor.expose(SCENE, rng=1))
        (held_out,) = splitter.held_out
        estimate = torch.from_numpy(0.2 + 0.5 * SCENE)[None, None].requires_grad_()
        splitter.negative_log_likelihood(estimate, held_out).backward()
        direction = torch.from_numpy(np.random.default_rng(0).normal(size=SCENE.shape))[None, None]
        ends = [
            float(splitter.negative_log_likelihood(estimate.detach() + e * direction, held_out))
            for e in (1e-5, -1e-5)
        ]
        slope = float((estimate.grad * direction).sum())
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(slope, rel=1e-4)


def test_a_single_bit_is_either_hidden_or_an_input():
    mask = np.zeros(SCENE.shape, bool)
    mask[10:14, 20:23] = True
    sensor = jl.Sensor(mask=mask)
    bits = sensor.expose(SCENE, rng=0)
    splitter = bit_splitter(CONDITIONAL, sensor, bits)
    ((training_ones, training_trials),), (held_out,) = splitter.training_bits, splitter.held_out
    held_out_ones, held_out_trials = held_out.planes[0, 1:3].numpy()
    np.testing.assert_array_equal(training_trials + held_out_trials, ~mask)
    np.testing.assert_array_equal(training_ones + held_out_ones, bits.counts() * ~mask)
    split = splitter.draw(np.random.default_rng(0), 40, 48)
    counts, ones, trials = split.planes[:, :3].unbind(1)
    assert split.network_trials == 1
    assert set(counts.unique().tolist()) <= {0, 1}
    # A tenth of the pixels is hidden, besides the tenth that is held out.
    hidden = float(trials.mean())
    assert hidden == pytest.approx(0.9 * 0.1, abs=0.01)
    assert (ones <= trials).all()


def test_a_capture_whose_only_bit_is_held_out_is_refused():
    mask = np.ones((16, 16), bool)
    mask[5, 5] = False
    sensor = jl.Sensor(mask=mask)
    bits = sensor.expose(np.full((16, 16), 0.5), rng=0)
    network = jl.Network.conditional("small", rng=0)
    # The bit is held out with a probability of a tenth, as with one of these seeds.
    seeds = [
        seed for seed in range(100) if np.random.default_rng(seed).random((16, 16))[5, 5] > 0.9
    ]
    with pytest.raises(ValueError, match="but all are held out; pass a capture with more"):
        bit_splitter(network, sensor, bits, seeds[0])
