"""The orientation of a capture in its provenance."""

import itertools

import numpy as np
import pytest

from jotlight.formats.frames.orientation import FLIPS, orient_image
from jotlight.sensing.parameters.provenance import Provenance

TURNS = list(itertools.product(range(4), (None, *FLIPS)))


@pytest.mark.parametrize("first", TURNS)
def test_successive_rotations_and_flips_are_combined(first):
    image = np.arange(6).reshape(2, 3)
    for second in TURNS:
        provenance = Provenance("npy", "a.npy").reoriented(*first).reoriented(*second)
        quarters, mirrored = provenance.orientation
        expected = orient_image(orient_image(image, *first), *second)
        kept = orient_image(image, quarters, "horizontal" if mirrored else None)
        np.testing.assert_array_equal(kept, expected)
        assert Provenance.from_json(provenance.to_json()) == provenance


def test_an_unknown_orientation_stays_unknown():
    value = {"format": "npy", "name": "a.npy", "notes": []}
    provenance = Provenance.from_json(value)
    assert provenance.orientation is provenance.reoriented(1, None).orientation is None
    assert provenance.to_json() == value


@pytest.mark.parametrize("orientation", [3, [4, False], [0], [0, "no"], {"a": 1}])
def test_an_impossible_orientation_is_refused(orientation):
    with pytest.raises(ValueError, match="quarter turns and whether mirrored"):
        Provenance.from_json(
            {"format": "npy", "name": "a.npy", "notes": [], "orientation": orientation}
        )
