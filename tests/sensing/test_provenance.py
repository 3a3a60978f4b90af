"""How a capture was turned, as its source keeps it."""

import itertools

import numpy as np
import pytest

from jotlight.formats.orientation import FLIPS, orient_image
from jotlight.sensing.provenance import Source

TURNS = list(itertools.product(range(4), (None, *FLIPS)))


@pytest.mark.parametrize("second", TURNS)
@pytest.mark.parametrize("first", TURNS)
def test_turns_one_after_the_other_are_the_one_that_is_kept(first, second):
    image = np.arange(6).reshape(2, 3)
    source = Source("npy", "a.npy").turned_by(*first).turned_by(*second)
    quarters, mirrored = source.turned
    expected = orient_image(orient_image(image, *first), *second)
    kept = orient_image(image, quarters, "horizontal" if mirrored else None)
    np.testing.assert_array_equal(kept, expected)
    assert Source.from_json(source.to_json()) == source


def test_a_turn_that_is_not_known_stays_so():
    told = {"format": "npy", "name": "a.npy", "notes": []}
    source = Source.from_json(told)
    assert source.turned is source.turned_by(1, None).turned is None
    assert source.to_json() == told


@pytest.mark.parametrize("turned", [3, [4, False], [0], [0, "no"], {"a": 1}])
def test_a_turn_that_is_none_is_refused(turned):
    with pytest.raises(ValueError, match="quarter turns and whether mirrored"):
        Source.from_json({"format": "npy", "name": "a.npy", "notes": [], "turned": turned})
