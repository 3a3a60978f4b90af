"""The motion of more frames, carried to a window: outlines, and the end of the window."""

import dataclasses

import pytest

import jotlight as jl
from jotlight.motion.carrying import carry
from jotlight.motion.film_candidates import Candidates
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.squares import enlarge_motion, in_squares
from moving import behind, film_settings, in_memory


@pytest.mark.slow
def test_a_window_keeps_the_outlines_that_more_frames_show():
    """Regions without detail look the same along both motions."""
    scene = jl.datasets.moving(
        jl.datasets.photograph("camera"),
        "layers",
        foreground=jl.datasets.photograph("astronaut").mean(axis=2),
        sensor=jl.Sensor(frames=256),
        shape=(128, 128),
        photons=0.1,
        rng=0,
    )
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
