"""Arguments of the engine's network that do not fit each other are errors."""

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.networks.inference.engine_backed import sensor_model

SENSOR = jl.Sensor(frames=16)
NETWORK = jl.pretrained(SENSOR, "small").engine_network
MODEL = sensor_model(SENSOR)


def places(number):
    return list(np.empty((number, 8, 8), np.float32))


@pytest.mark.parametrize(("of", "trials"), [([16], [16, 16]), ([16, 16], [16])])
def test_each_image_of_equivalent_counts_has_its_numbers(of, trials):
    counts = np.full((2, 8, 8), 4, np.float32)
    with pytest.raises(ValueError, match=r"(of|trials): expected 2, got 1"):
        NETWORK.equivalent_counts(counts, of, trials, MODEL, places(2), None)


def test_counts_among_no_bits_are_refused():
    counts = np.full((1, 8, 8), 4, np.float32)
    with pytest.raises(ValueError, match="of: expected numbers of bits above 0, got 0"):
        NETWORK.equivalent_counts(counts, [0], [16], MODEL, places(1), None)


def test_negative_equivalent_counts_are_refused():
    counts = np.full((1, 8, 8), 4, np.float32)
    counts[0, 5, 7] = -0.5
    with pytest.raises(ValueError, match=r"counts: expected finite numbers .*, got -0\.5"):
        NETWORK.equivalent_counts(counts, [16], [16], MODEL, places(1), None)


@pytest.mark.parametrize("count", [30, -3])
def test_a_count_that_does_not_fit_the_trials_is_named(count):
    counts = np.full((1, 20, 20), 4, np.int32)
    counts[0, 5, 7] = count
    out = list(np.empty((1, 20, 20), np.float32))
    with pytest.raises(ValueError, match=f"counts: expected 0 to 16 ones of a pixel, got {count}"):
        NETWORK.counts(counts, 16.0, (1.0, 0.0), MODEL, out, None)


def test_images_to_denoise_have_pixels_and_trials():
    network = jl.pretrained(SENSOR, "medium").engine_network
    fractions = np.full((8, 8), 0.5, np.float32)
    with pytest.raises(ValueError, match="trials: expected numbers above 0, got 0"):
        network.denoise([fractions], [0], False, None)
    empty = np.empty((0, 8), np.float32)
    with pytest.raises(ValueError, match="image: expected at least one pixel"):
        network.denoise([empty], [empty], False, None)


def test_weights_that_exceed_the_memory_are_an_error():
    with pytest.raises(MemoryError):
        engine.conditioning_weights(4.0, (1.0, 256.0), 10**17)
