"""The motion of more frames, carried to a window: outlines, and the end of the window."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.films.candidates import Candidates
from jotlight.motion.films.carrying import carry
from jotlight.motion.films.merging import FilmMerging
from jotlight.motion.merging.jot_squares import enlarge_motion, in_squares
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
    window, start = 64, 16
    settings = film_settings(window, model="affine", memory=False)
    losses = []
    for rng in range(4):
        scene, bits = behind(rng=rng)
        part = bits[start : start + window]
        frames, _ = in_squares(bits[: start + window], bits.sensor, None)
        squares, sensor = in_squares(part, part.sensor, None)
        candidates = Candidates(squares, start, None, FilmMerging(sensor, settings.step), settings)
        carried = candidates.of_more_frames(frames, 0).image.motion
        truth = scene.image(start + window - 1)
        alone, found = (
            quality_of_end(part, motion, truth)
            for motion in (
                jl.align(part, model="affine"),
                enlarge_motion(carried, 2, bits.shape[1:]),
            )
        )
        losses.append(alone - found)
    assert np.mean(losses) < 0.3


def quality_of_end(bits, motion, truth):
    """Return the PSNR of the image of the last frame, without its border."""
    merged = jl.merge(bits, at=len(bits) - 1, motion=motion)
    inner = (slice(8, -8),) * 2
    return jl.metrics.psnr(jl.reconstruct(merged)[inner], truth[inner], data_range=1.0)


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
