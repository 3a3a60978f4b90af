"""The merging of the windows of a film: how many templates test their blocks."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.agreement.consistency import find_consistent
from jotlight.motion.films import merging as film_merging
from jotlight.motion.films.merging import FilmMerging
from moving import blocks_of, constant_motion, paths_of


@pytest.mark.parametrize(
    ("model", "frames", "rings"),
    [
        ("none", 256, (4, 4)),
        ("affine", 256, (4, 4)),
        ("affine", 64, (2, 2)),
        ("segments", 256, (2, 2)),
        ("tiles", 256, (2, 2)),
    ],
)
def test_long_windows_with_one_motion_have_wider_rings(model, frames, rings, monkeypatch):
    found = []

    def record(*args, **options):
        found.append(options["rings"])
        return find_consistent(*args, **options)

    monkeypatch.setattr(film_merging, "find_consistent", record)
    bits = jl.Bits.from_array(np.random.default_rng(0).random((frames, 32, 32)) < 0.3)
    blocks = blocks_of(bits)
    still = np.zeros((len(blocks.centers), 2))
    motion = constant_motion(still, blocks.size, blocks.centers, frames / 2, model)
    merging = FilmMerging(jl.Sensor(frames=frames), 8, may_stand_still=False)
    merging.merge(paths_of(blocks, still, frames / 2), motion, 0, None)
    assert found == [rings]
