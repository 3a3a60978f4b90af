"""The motion of more frames, carried to a window: outlines, and the end of the window."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.carrying import carry
from jotlight.motion.film_candidates import Candidates
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.squares import enlarge_motion, in_squares
from moving import behind, film_settings, in_memory, photographed


@pytest.mark.slow
def test_a_window_keeps_the_outlines_that_more_frames_show():
    """Regions without detail look the same along both motions."""
    scene = photographed("layers", 128, sensor=jl.Sensor(frames=256), photons=0.1, rng=0)
    bits = in_memory(scene)
    motion = jl.align(bits)
    assert len(motion.nodes) == 2
    start, window = 128, 64
    motion = dataclasses.replace(motion, times=motion.times - start, reference=0.0)
    sensor = bits.sensor.replace(frames=window)
    paths = carry(motion, bits[start : start + window], sensor, 0)
    outlines = motion.seen_from(window / 2).labels
    assert (paths.labels != outlines).mean() < 0.04  # 0.16 if each pixel chose anew


@pytest.mark.slow
def test_the_end_of_a_window_moves_as_its_own_bits_show():
    """A causal image shows the last frame. The blocks of more frames are longer."""
    scene, bits = behind()
    window, start = 64, 16
    part = bits[start : start + window]
    frames, _ = in_squares(bits[: start + window], bits.sensor, None)
    squares, sensor = in_squares(part, part.sensor, None)
    settings = film_settings(window, model="affine", memory=False)
    candidates = Candidates(squares, start, None, FilmMerging(sensor, settings.step), settings)
    found = candidates.of_more_frames(frames, 0)
    truth = scene.image(start + window - 1)

    def quality(motion):
        merged = jl.merge(part, at=window - 1, motion=motion)
        inner = (slice(8, -8),) * 2
        return jl.metrics.psnr(jl.reconstruct(merged)[inner], truth[inner], data_range=1.0)

    alone = quality(jl.align(part, model="affine"))
    assert quality(enlarge_motion(found.image.motion, 2, bits.shape[1:])) > alone - 0.3


@pytest.mark.slow
def test_new_motions_of_a_window_are_compared_in_the_same_blocks():
    """In longer blocks, more bits of a wrong motion agree."""
    bits = in_memory(photographed("shake", 64, sensor=jl.Sensor(frames=512), photons=0.5, rng=0))
    window, start = 256, 256
    settings = film_settings(window, model="affine", memory=False)
    sensor = bits.sensor.replace(frames=window)
    merging = FilmMerging(sensor, settings.step)
    candidates = Candidates(bits[start:], start, None, merging, settings)
    edges = [
        each.paths.blocks.edges for each in (candidates.fresh(), candidates.of_more_frames(bits, 0))
    ]
    np.testing.assert_array_equal(*edges)
