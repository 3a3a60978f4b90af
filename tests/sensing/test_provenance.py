"""How a capture was turned, as its provenance keeps it."""

import itertools

import numpy as np
import pytest

from jotlight.formats.orientation import FLIPS, orient_image
from jotlight.sensing.provenance import Provenance

TURNS = list(itertools.product(range(4), (None, *FLIPS)))


@pytest.mark.parametrize("second", TURNS)
@pytest.mark.parametrize("first", TURNS)
def test_turns_one_after_the_other_are_the_one_that_is_kept(first, second):
    image = np.arange(6).reshape(2, 3)
    provenance = Provenance("npy", "a.npy").reoriented(*first).reoriented(*second)
    quarters, mirrored = provenance.orientation
    expected = orient_image(orient_image(image, *first), *second)
    kept = orient_image(image, quarters, "horizontal" if mirrored else None)
    np.testing.assert_array_equal(kept, expected)
    assert Provenance.from_json(provenance.to_json()) == provenance


def test_a_turn_that_is_not_known_stays_so():
    told = {"format": "npy", "name": "a.npy", "notes": []}
    provenance = Provenance.from_json(told)
    assert provenance.orientation is provenance.reoriented(1, None).orientation is None
    assert provenance.to_json() == told


@pytest.mark.parametrize("orientation", [3, [4, False], [0], [0, "no"], {"a": 1}])
def test_a_turn_that_is_none_is_refused(orientation):
    with pytest.raises(ValueError, match="quarter turns and whether mirrored"):
        Provenance.from_json(
            {"format": "npy", "name": "a.npy", "notes": [], "orientation": orientation}
        )
