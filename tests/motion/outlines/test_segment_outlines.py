"""Outlines between two segments that may be wrong."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.outlines.segment_outlines import _are_in_doubt, _with_other_outlines
from jotlight.motion.tiles import tile_counts
from moving import blocks_of, occluded


@pytest.mark.slow
@pytest.mark.parametrize("is_reversed", [False, True])
def test_wrong_outlines_of_slow_segments_are_replaced(is_reversed):
    """A large object hides its background everywhere, so the bits do not show that it is wrong."""
    size, velocities = (48, 64), ((0, 0), (0, 1))
    mask = np.zeros(size, bool)
    mask[14:34, 22:42] = True
    bits, _ = occluded(velocities, (np.ones(size, bool), mask), 20)
    blocks = blocks_of(bits, 20)
    shape = 20, 2, *tile_counts(size)
    times = blocks.centers - 10
    tracks = [
        Track(
            blocks,
            10,
            np.broadcast_to(np.outer(times, each)[:, :, None, None], shape).copy(),
            np.ones(20, bool),
            np.zeros((20, 3, *shape[2:])),
        )
        for each in velocities
    ]
    labels = np.zeros(size, np.uint8)
    labels[:, 8:] = 1
    wrong = Paths(tracks[::-1], 1 - labels) if is_reversed else Paths(tracks, labels)
    assert _are_in_doubt(wrong)
    # Small objects are not in doubt, and neither are those that part by 24 pixels.
    assert not _are_in_doubt(Paths(tracks, (np.indices(size)[0] == 0).astype(np.uint8)))
    faster = [dataclasses.replace(track, nodes=1.3 * track.nodes) for track in tracks]
    assert not _are_in_doubt(Paths(faster, labels))
    found = _with_other_outlines(wrong)
    # The object is in front.
    speed = [np.ptp(track.nodes[:, 1].mean(axis=(1, 2))) for track in found.tracks]
    assert speed[1] > 10 > speed[0]
    assert (found.labels == mask).mean() > 0.95
    assert _with_other_outlines(found).labels is found.labels
