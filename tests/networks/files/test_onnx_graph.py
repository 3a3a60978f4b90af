"""The operations of networks as ONNX nodes."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

import jotlight as jl

onnxruntime = pytest.importorskip("onnxruntime")
pytest.importorskip("onnx")
from jotlight.networks.files.onnx_graph import OPSET, GraphBuilder  # noqa: E402

RNG = np.random.default_rng(0)


def run(graph, values, output_shape=("n", "c", "h", "w")):
    """Return the output of the last node for an input `x`."""
    model = graph.model(("x", ("n", "c", "h", "w")), ("y", output_shape), "a test", {})
    session = onnxruntime.InferenceSession(model.SerializeToString())
    (output,) = session.run(None, {"x": values.astype(np.float32)})
    return output


@pytest.mark.parametrize("margins", [((1, 0), (1, 1)), ((2, 5), (0, 3)), ((0, 0), (7, 7))])
@pytest.mark.parametrize("size", [(1, 1), (3, 2), (8, 9)])
def test_margins_are_mirrored_as_numpy_does(margins, size):
    values = RNG.random((2, 3, *size))
    graph = GraphBuilder()
    graph.mirror_pad("x", margins)
    expected = np.pad(values, ((0, 0), (0, 0), *margins), mode="symmetric")
    np.testing.assert_array_equal(run(graph, values), expected.astype(np.float32))


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (4, 8)])
def test_sizes_become_multiples_of_the_divisor_and_are_cropped_again(size):
    values = RNG.random((1, 2, *size))
    rows, columns = ((0, -each % 4) for each in size)
    graph = GraphBuilder()
    padded = graph.pad_to_multiple("x", 4)
    expected = np.pad(values, ((0, 0), (0, 0), rows, columns), mode="symmetric")
    np.testing.assert_array_equal(run(graph, values), expected.astype(np.float32))
    graph = GraphBuilder()
    padded = graph.pad_to_multiple("x", 4)
    graph.crop(padded, "x")
    np.testing.assert_array_equal(run(graph, values), values.astype(np.float32))


def test_piecewise_cubics_are_those_of_scipy_and_constant_outside():
    cubics = RNG.normal(size=(3, 5, 4))
    graph = GraphBuilder()
    graph.piecewise_cubics("f", "x", cubics, -1.0, 0.5)
    # The last knot belongs to the last interval.
    z = np.concatenate([np.linspace(-2, 3, 501), [-1.0, 1.49999, 1.5, 1e9, -1e9, np.inf]])
    actual = run(graph, np.broadcast_to(z, (1, 3, 1, len(z))))
    for channel in range(3):
        function = PPoly(cubics[channel].T[::-1], np.arange(6.0))
        position = ((z.astype(np.float32) + 1) / np.float32(0.5)).clip(0, 5)
        np.testing.assert_allclose(actual[0, channel, 0], function(position), atol=3e-6)


def test_constants_of_the_same_name_are_stored_once():
    graph = GraphBuilder()
    graph.add("Add", graph.add("Mul", "x", 2.0), 2.0)
    assert len(graph.constants) == 1
    np.testing.assert_array_equal(run(graph, np.ones((1, 1, 1, 1))), 4)


def test_the_model_states_its_operators():
    graph = GraphBuilder()
    graph.add("Neg", "x")
    model = graph.model(("x", ("n",)), ("y", ("n",)), "a test", {"key": "value"})
    assert [(each.domain, each.version) for each in model.opset_import] == [("", OPSET)]
    assert {each.key: each.value for each in model.metadata_props} == {"key": "value"}
    assert (model.producer_name, model.producer_version) == ("jotlight", jl.__version__)
