"""Missing attributes of networks, and errors inside of their properties."""

import pickle

import pytest

import jotlight as jl

SENSOR = jl.Sensor(oversampling=4)


class Broken(jl.Network):
    @property
    def broken(self):
        return self.missing_inside


def test_an_error_inside_of_a_property_is_shown():
    network = Broken(jl.Network.initial(SENSOR).layers, SENSOR)
    with pytest.raises(AttributeError, match=r"^'Broken' object has no attribute 'missing_inside'"):
        _ = network.broken


def test_an_error_of_another_object_inside_of_a_property_is_shown():
    network = jl.Network.initial(SENSOR)
    network.layers = [object()] * 2
    with pytest.raises(AttributeError, match=r"^'object' object has no attribute"):
        _ = network.halo


def test_a_missing_attribute_is_named_and_can_have_a_default():
    network = jl.Network.initial(SENSOR)
    with pytest.raises(
        AttributeError, match=r"^'Network' object has no attribute 'other'$"
    ) as info:
        _ = network.other
    assert (info.value.name, info.value.obj) == ("other", network)
    assert getattr(network, "other", 3) == 3
    assert not hasattr(network, "eval")
    assert pickle.loads(pickle.dumps(network)).sensor == SENSOR
