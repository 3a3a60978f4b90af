"""States of PyTorch networks: knots must agree, up to rounding."""

import pytest

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.torch import Network  # noqa: E402

SENSOR = jl.Sensor(oversampling=4)


def test_the_state_of_a_network_with_other_knots_is_refused():
    module = Network(jl.Network.initial(SENSOR))
    state = Network(jl.Network.initial(SENSOR, nu=0.2)).state_dict()
    before = [parameter.clone() for parameter in module.parameters()]
    with pytest.raises(ValueError, match=r"state_dict: expected splines with knots from .* got"):
        module.load_state_dict(state)
    assert all(map(torch.equal, before, module.parameters()))
    with pytest.raises(ValueError, match="expected the knots of 2 layers, got those of 6"):
        module.load_state_dict(Network(jl.pretrained(SENSOR, "small")).state_dict())


def test_a_state_may_be_rounded_or_hold_the_parameters_alone():
    module = Network(jl.Network.initial(SENSOR))
    before = [parameter.clone() for parameter in module.parameters()]
    module.load_state_dict({name: value.half() for name, value in module.state_dict().items()})
    module.load_state_dict(dict(zip(dict(module.named_parameters()), before, strict=True)))
    assert all(map(torch.equal, before, module.parameters()))
    with pytest.raises(RuntimeError, match=r"Missing key.*filters\.0"):
        module.load_state_dict({})
