"""The images of one connection, and the notes that come with them."""

import json
import struct

import numpy as np
import pytest

import jotlight as jl
from jotlight.view.pipeline import ImageRequest, Pipeline
from jotlight.view.state import ViewState
from jotlight.view.viewed import Viewed
from jotlight.view.workshop import Workshop


@pytest.fixture
def pipeline():
    bits = jl.Sensor(frames=32, max_intensity=4.0).expose(np.full((32, 32), 0.5), rng=0)
    workshop = Workshop(Viewed.from_data(bits))
    yield Pipeline(workshop)
    workshop.close()


def notes_of(pipeline, **state):
    request = ImageRequest(1, ViewState(**state))
    counts, _ = pipeline.count(request, [])
    return header_of(pipeline.refine(request, counts))["notes"]


def header_of(message):
    (length,) = struct.unpack("<I", message[:4])
    return json.loads(message[4 : 4 + length])


def test_the_warning_of_a_failed_alignment_stays_with_every_method(pipeline):
    for method in ("mle", "network-medium", "mle"):
        [note] = notes_of(pipeline, window=10, method=method, align=True)
        assert "expected 16 or more frames" in note
    assert notes_of(pipeline, window=10, method="mle") == []
    assert notes_of(pipeline, window=32, method="mle", align=True) == []


def test_the_uncertainty_of_counts_is_unknown_and_its_note_says_why(pipeline):
    request = ImageRequest(1, ViewState(method="counts", overlays=("uncertainty",)))
    pipeline.count(request, ["counts"])
    [message] = pipeline.overlays(request)
    header = header_of(message)
    assert header["unknown"]
    assert header["note"] == "uncertainty: counts are no estimate; choose a method"
    # Counts that an estimate replaces soon say nothing.
    request = ImageRequest(2, ViewState(method="network-small", overlays=("uncertainty",)))
    assert list(pipeline.overlays(request)) == []
