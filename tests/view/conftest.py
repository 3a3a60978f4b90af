"""A server that several files of tests ask."""

import pytest

import jotlight as jl
from jotlight.view.viewed import Viewed

TITLE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def photo():
    return jl.datasets.photograph("camera")[100:140, 180:240]


@pytest.fixture(scope="module")
def bits(photo):
    return jl.Sensor(frames=200, max_intensity=4.0).expose(photo, rng=0)


@pytest.fixture(scope="module")
def server(bits):
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    pytest.importorskip("starlette")
    from view_servers import serving

    with serving(Viewed.from_data(bits, TITLE)) as running:
        yield running
