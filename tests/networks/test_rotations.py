"""Networks that average their output over four rotations of the data."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.pretrained import pretrained_file

SENSOR = jl.Sensor(frames=16)
RNG = np.random.default_rng(0)
COUNTS = RNG.integers(0, 17, (32, 48))
DEAD = np.zeros(COUNTS.shape, bool)
DEAD[3:5, 30:] = True


def with_rotations(network: jl.Network, rotations: int) -> jl.Network:
    layers, range_ = network.layers, network.trials_range
    return jl.Network(layers, network.sensor, trials_range=range_, rotations=rotations)


SMALL = jl.Network.load(pretrained_file(SENSOR, "small"))
CONDITIONAL = jl.Network.load(pretrained_file(SENSOR, "small", is_conditional=True))


def mean_of_rotations(run, image):
    """Return the mean of `run` for the rotations of an image of even size, rotated back."""
    parts = [np.rot90(run(np.rot90(image, turn).copy()), -turn) for turn in range(4)]
    return np.mean(parts, axis=0)


def test_the_output_is_the_mean_of_the_outputs_for_rotated_counts():
    found = with_rotations(SMALL, 4).reconstruct([COUNTS, COUNTS // 2], SENSOR)
    assert found.dtype == np.float32
    for counts, estimate in zip((COUNTS, COUNTS // 2), found, strict=True):
        expected = mean_of_rotations(lambda data: SMALL.reconstruct(data, SENSOR), counts)
        np.testing.assert_allclose(estimate, expected, atol=1e-6)


@pytest.mark.parametrize("size", [(21, 34), (20, 35), (23, 1), (1, 1)])
def test_other_sizes_are_mirrored_at_the_end_before_rotation(size):
    counts = COUNTS[: size[0], : size[1]]
    padded = np.pad(counts, [(0, -length % 2) for length in size], "symmetric")
    expected = mean_of_rotations(lambda data: SMALL.reconstruct(data, SENSOR), padded)
    found = with_rotations(SMALL, 4).reconstruct(counts, SENSOR)
    np.testing.assert_allclose(found, expected[: size[0], : size[1]], atol=1e-6)


def test_a_part_has_the_estimate_of_the_whole_image():
    network = jl.pretrained(SENSOR, "extra-large")
    counts = RNG.integers(0, 17, (3 * network.halo + 30, 2 * network.halo))
    part = counts[16:-3]
    inner = slice(network.halo, -network.halo)
    whole = network(counts)[16:-3]
    np.testing.assert_allclose(network(part)[inner], whole[inner], atol=3e-5)


def test_the_probabilities_are_means_too():
    fractions = [(COUNTS / 16).astype(np.float32), np.full((4, 8), 0.25, np.float32)]
    found = with_rotations(CONDITIONAL, 4).denoise_probabilities(fractions, 16)
    for fraction, mean in zip(fractions, found, strict=True):
        expected = mean_of_rotations(lambda x: CONDITIONAL.denoise_probability(x, 16), fraction)
        np.testing.assert_allclose(mean, expected, atol=1e-6)


@pytest.mark.parametrize(
    "sensor",
    [
        SENSOR,
        jl.Sensor(frames=20),
        jl.Sensor(frames=1000),
        jl.Sensor(frames=16, gain=16 * 30),  # estimated from the zeros
        jl.Sensor(frames=16, kernel="quadratic"),
    ],
    ids=repr,
)
def test_rotated_data_lead_to_the_rotated_estimate(sensor):
    network = jl.pretrained(sensor, "extra-large")
    counts = RNG.integers(0, sensor.trials + 1, COUNTS.shape)
    np.testing.assert_allclose(
        network(np.rot90(counts)), np.rot90(network(counts)), atol=1e-5 * sensor.max_intensity
    )


@pytest.mark.filterwarnings("ignore:.* pixels have no valid bit")
def test_bits_with_dead_jots_have_the_estimate_of_their_counts():
    sensor = SENSOR.replace(mask=DEAD)
    bits = sensor.expose(np.full(COUNTS.shape, 0.4), rng=0)
    for network in (with_rotations(SMALL, 4), with_rotations(CONDITIONAL, 4)):
        np.testing.assert_array_equal(network(bits), network(bits.counts(), sensor))


@pytest.mark.slow
def test_files_and_descriptions_state_the_number(tmp_path):
    network = with_rotations(CONDITIONAL, 4)
    network.save(tmp_path / "four.safetensors")
    loaded = jl.Network.load(tmp_path / "four.safetensors")
    np.testing.assert_array_equal(loaded(COUNTS, SENSOR), network(COUNTS, SENSOR))
    assert "mean of 4 rotations" in repr(loaded)
    assert "rotations" in loaded._repr_html_()
    assert "rotations" not in repr(CONDITIONAL)


def test_extra_large_is_large_with_four_rotations():
    for frames in (16, 20):
        sensor = jl.Sensor(frames=frames)
        large, extra = (jl.pretrained(sensor, name) for name in ("large", "extra-large"))
        assert (large.rotations, extra.rotations) == (1, 4)
        np.testing.assert_array_equal(large.layers[3].filters, extra.layers[3].filters)


def test_onnx_models_have_one_rotation(tmp_path):
    with pytest.raises(
        ValueError,
        match=r"network: expected .* since ONNX models run it .* rotations = 4; use .* 'large'",
    ):
        with_rotations(SMALL, 4).export_onnx(tmp_path / "model.onnx")


def test_pytorch_modules_have_one_rotation():
    pytest.importorskip("torch")
    with pytest.raises(ValueError, match=r"network: expected .* since PyTorch modules run it in"):
        jl.torch.Network(with_rotations(SMALL, 4))
