"""Where held-out bits contradict an estimate, and by how much."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.intervals.error_scale import HalfErrors, divide_bits
from jotlight.evaluation.intervals.unlikely import _errors_of_sums as errors_of_sums
from jotlight.evaluation.intervals.unlikely import find_contradictions

ROWS, COLUMNS = np.indices((128, 128)) - 64
RADIUS = np.hypot(ROWS, COLUMNS)


def measure(p, ones, trials, **changes):
    """Return the errors of an estimate of the probability p, by both halves of some ones."""
    halves = divide_bits(np.asarray(ones, np.int32), np.full(np.shape(ones), float(trials)))
    z = np.arcsin(np.sqrt(np.broadcast_to(p, np.shape(ones))))
    each = [HalfErrors.measure(z, *pair) for pair in (halves, halves[::-1])]
    return [dataclasses.replace(one, **changes) for one in each]


def test_estimates_are_unlikely_where_single_pixels_predict_bits_better():
    truth = np.full((80, 80), 0.5)
    ones = np.random.default_rng(5).binomial(64, truth)
    z = np.full(truth.shape, np.pi / 4)
    z[:, 40:] += 0.4
    z[:20, 40:] -= 0.8
    flags, (bright, dark) = find_contradictions(measure(np.sin(z) ** 2, ones, 64))
    assert not flags[:, :20].any()
    assert flags[:, 60:].all()
    np.testing.assert_allclose(np.sqrt(bright[40:, 60:]), 0.4, atol=0.04)
    np.testing.assert_allclose(np.sqrt(dark[:10, 60:]), 0.4, atol=0.04)
    # Neighborhoods do not know the sign. They show at least the error of single pixels.
    assert np.sqrt(max(dark[40:, 60:].max(), bright[:10, 60:].max())) < 0.1
    np.testing.assert_array_equal((bright > 0) | (dark > 0), flags)


def test_sums_show_a_bright_rim_around_a_bright_object():
    """Single pixels cannot: most of them have no one."""
    truth = np.where(RADIUS < 25, 0.4, 5e-4)
    wrong = np.where((RADIUS >= 25) & (RADIUS < 29), 4e-3, truth)
    ones = np.random.default_rng(0).binomial(1000, truth)
    halves = measure(wrong, ones, 1000)
    flags, (squared, _) = find_contradictions(halves)
    rim = wrong != truth
    assert flags[rim].mean() > 0.99
    assert not flags[~rim].any()
    error = np.arcsin(np.sqrt(4e-3)) - np.arcsin(np.sqrt(5e-4))
    assert 0.9 * error < np.median(np.sqrt(squared[rim])) < 1.3 * error
    # At jots with half the slope, the same error of p is twice that of z.
    changed = [dataclasses.replace(half, relative_slope=0.5) for half in halves]
    _, (of_others, _) = find_contradictions(changed)
    np.testing.assert_allclose(np.sqrt(of_others[rim & flags]), 2 * np.sqrt(squared[rim & flags]))


@pytest.mark.parametrize("p", [3e-5, 1e-3, 0.2, 0.999])
@pytest.mark.parametrize("trials", [4, 64, 4096])
def test_noise_contradicts_nothing(p, trials):
    ones = np.random.default_rng(trials).binomial(trials, p, (128, 256))
    flags, _ = find_contradictions(measure(p, ones, trials))
    assert flags.mean() < 0.02  # neighborhoods err at three standard deviations
    assert not errors_of_sums(measure(p, ones, trials)).any()


def test_pixels_whose_errors_are_unknown_do_not_count():
    ones = np.zeros((40, 40), np.int32)
    halves = measure(0.3, ones, 16)
    assert find_contradictions(halves)[0].all()
    unknown = [dataclasses.replace(half, known=np.zeros((40, 40), bool)) for half in halves]
    assert not errors_of_sums(unknown).any()


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
@pytest.mark.parametrize("frames", [16, 100])
def test_bits_that_are_brighter_than_the_largest_intensity_widen_no_interval(frames):
    image = np.full((32, 32), 3.0)
    image[:, :16] = 0.3
    bits = jl.Sensor(frames=frames).expose(image, rng=2)
    found = jl.uncertainty(bits, estimate=jl.reconstruct(bits))
    assert found.low[:, 20:].mean() > 0.3
    assert not found.unlit[:, 16:].any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "sky", "flagged", "covered"), [(1000, 5e-4, 0.5, 0.7), (10_000, 5e-4, 0.99, 0.9)]
)
def test_intervals_beside_a_bright_object_on_a_dark_sky(frames, sky, flagged, covered):
    truth = np.where(RADIUS < 25, 0.5, 0) + sky
    sensor = jl.Sensor(frames=frames, max_intensity=10.0)
    counts = np.random.default_rng(0).binomial(frames, -np.expm1(-truth))
    known = jl.uncertainty(counts, sensor, method="network-medium", confidence_level=0.9)
    inside, rim = (known.low <= truth) & (truth <= known.high), (RADIUS > 25) & (RADIUS < 28)
    assert known.unlikely[rim].mean() > flagged
    assert inside[rim].mean() > covered
    assert not known.unlikely[RADIUS > 45].any()
