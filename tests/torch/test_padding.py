"""Mirrored padding in PyTorch."""

import shutil

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from jotlight.torch.padding import mirror_pad  # noqa: E402


@pytest.mark.parametrize("rows", [(0, 0), (1, 0), (0, 3), (9, 7)])
@pytest.mark.parametrize("columns", [(0, 0), (1, 1), (2, 1), (13, 20)])
def test_margins_are_those_of_numpy_also_if_wider_than_the_planes(rows, columns):
    planes = np.random.default_rng(0).random((2, 3, 4, 5))
    expected = np.pad(planes, ((0, 0), (0, 0), rows, columns), mode="symmetric")
    np.testing.assert_array_equal(mirror_pad(torch.from_numpy(planes), rows, columns), expected)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("c++") is None, reason="torch.compile needs a C++ compiler")
def test_compiled_padding_can_be_trained_after_a_convolution():
    """The default backend interleaves the channels of a convolution."""
    taps = torch.rand(8, 8, 3, 3)

    def convolve(planes):
        return torch.nn.functional.conv2d(mirror_pad(planes, (1, 1), (1, 1)), taps).relu()

    planes = torch.rand(2, 8, 6, 5, requires_grad=True)
    torch._dynamo.reset()
    compiled = torch.compile(convolve, fullgraph=True)
    actual, expected = (
        torch.autograd.grad(f(planes).sum(), planes)[0] for f in (compiled, convolve)
    )
    torch.testing.assert_close(actual, expected)
