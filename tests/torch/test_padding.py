"""Mirrored padding in PyTorch."""

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
