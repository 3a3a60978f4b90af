"""Counts and bits that modules refuse, as the engine does."""

import warnings

import numpy as np
import pytest

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.torch import Network  # noqa: E402
from jotlight.torch.data_checks import check_values  # noqa: E402

SENSOR = jl.Sensor(frames=16)


@pytest.fixture(scope="module")
def network():
    return Network(jl.pretrained(SENSOR, "small"))


@pytest.mark.parametrize("wrong", [17, 255])
def test_counts_above_the_trials_are_refused_with_the_message_of_the_engine(network, wrong):
    counts = np.arange(64).reshape(8, 8) % 17
    counts[3, 5] = wrong
    with pytest.raises(ValueError, match="counts: expected 0 to K = 16 ones") as engine:
        network.to_network().reconstruct(counts)
    for dtype in (torch.int32, torch.float32):
        with pytest.raises(ValueError, match="counts: expected 0 to K = 16 ones") as module:
            network(torch.from_numpy(counts)[None, None].to(dtype))
        assert str(module.value) == str(engine.value)


def test_negative_counts_are_refused(network):
    with pytest.raises(ValueError, match=r"counts: expected 0 to K = 16 .* got -1 to 0"):
        network(torch.tensor([[[[0, -1]]]]))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_infinity_and_nan_are_refused(network, value):
    data = torch.ones(1, 1, 4, 4)
    data[0, 0, 1, 2] = value
    with pytest.raises(ValueError, match=r"counts: expected 0 to K = 16 .* got .*(nan|inf)"):
        network(data)


def test_bits_are_0_or_1():
    check_values(torch.tensor([True, False]), SENSOR, is_bits=True)
    with pytest.raises(ValueError, match="bits: expected 0 and 1, got 0 to 2"):
        check_values(torch.tensor([0, 2]), SENSOR, is_bits=True)


def test_means_in_place_of_counts_cause_a_warning(network):
    module = torch.nn.Sequential(network)
    with pytest.warns(
        jl.JotlightWarning, match="look like means, .* multiply means by K"
    ) as caught:
        module(torch.rand(1, 1, 4, 4))
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    "dtype", [torch.bool, torch.uint8, torch.uint16, torch.bfloat16, torch.float16, torch.float64]
)
def test_legal_data_of_any_type_pass(dtype):
    for trials in (16, 259):
        top = min(trials, 255) if dtype == torch.uint8 else trials
        data = torch.tensor([[0, 1, top]]).to(dtype)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            check_values(data, jl.Sensor(frames=trials), is_bits=False)


def test_expected_counts_pass_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_values(torch.tensor([0.25, 16.0]), SENSOR, is_bits=False)


def test_values_that_need_gradients_or_do_not_exist_are_not_read():
    check_values(torch.full((3,), 99.0, requires_grad=True), SENSOR, is_bits=False)
    check_values(torch.zeros(3, device="meta"), SENSOR, is_bits=False)
    check_values(torch.zeros(0), SENSOR, is_bits=False)
    torch.func.vmap(lambda x: (check_values(x, SENSOR, is_bits=False), x)[1])(torch.zeros(2, 3))
