"""Random numbers of PyTorch, which are the same in each run of a test."""

import pytest


@pytest.fixture(autouse=True)
def seeded():
    """Seed the random numbers of PyTorch."""
    torch = pytest.importorskip("torch")
    torch.manual_seed(0)
