"""All parameters of a network as one vector."""

import numpy as np

import jotlight as jl
from jotlight.training import parameter_vector, with_parameters


def test_parameters_that_change_are_a_stage_of_the_history():
    network = jl.Network.initial(jl.Sensor())
    vector = parameter_vector(network)
    assert with_parameters(network, vector).history == network.history
    changed = with_parameters(network, 0.5 * vector)
    np.testing.assert_allclose(parameter_vector(changed), 0.5 * vector, rtol=1e-6)
    assert changed.history == {**network.history, "stages": ["parameters set from a vector"]}
