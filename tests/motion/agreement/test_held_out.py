"""Frames that are held out: merged counts predict them, and better along the true motion."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.agreement import held_out
from jotlight.motion.agreement.held_out import Fold, central_frames, held_out_likelihood
from jotlight.networks.inference.trials_map import denoise_map
from moving import blocks_of, paths_of, shaken, total_of


def test_merged_counts_predict_frames_along_the_motion():
    """The fold's prediction of a frame is the merged image, moved to where the frame shows it."""
    _, blocks, shifts, reference = shaken()
    paths = paths_of(blocks, shifts, reference)
    image = np.arange(blocks.size[0] * blocks.size[1], dtype=float).reshape(blocks.size)
    for time in (reference - 5, reference + 20):
        row, column = (
            round(float(np.interp(time, blocks.centers, shifts[:, axis]))) for axis in (0, 1)
        )
        moved = held_out._moved(image, paths, time)
        inner = np.s_[40:-40, 40:-40]
        np.testing.assert_array_equal(moved[inner], np.roll(image, (row, column), (0, 1))[inner])


def test_frames_are_more_likely_along_the_true_motion():
    _, blocks, shifts, reference = shaken()
    likelihoods = []
    for factor in (1.0, 0.9, 0.5, 0.0):
        paths = paths_of(blocks, factor * shifts, reference)
        total = total_of(paths)
        likelihoods.append(held_out_likelihood(paths, total, central_frames(paths, total)))
    assert likelihoods == sorted(likelihoods, reverse=True)


def test_the_likelihood_is_that_of_the_bits():
    """The sum over single bits, from the probabilities of both folds."""
    bits, blocks, shifts, reference = shaken()
    paths = paths_of(blocks, shifts, reference)
    total = total_of(paths)
    held = central_frames(paths, total)
    expected = 0.0
    for start in (0, 1):
        fold = Fold.of(paths, total, held[start::2])
        for time, (one, zero) in zip(held[start::2], fold.logarithms, strict=True):
            seen = bits[time : time + 1].counts().astype(bool)
            np.testing.assert_allclose(np.exp(one) + np.exp(zero), 1, rtol=1e-6)
            expected += float(np.where(seen, one, zero).sum())
    assert held_out_likelihood(paths, total, held) == pytest.approx(expected, rel=1e-9)


def test_the_network_runs_in_the_threads_of_the_blocks(monkeypatch):
    _, blocks, shifts, reference = shaken()
    paths = paths_of(dataclasses.replace(blocks, threads=1), shifts, reference)
    total, found = total_of(paths), []

    def noting(*arguments, threads):
        found.append(threads)
        return denoise_map(*arguments, threads=threads)

    monkeypatch.setattr(held_out, "denoise_map", noting)
    fold = Fold.of(paths, total, central_frames(paths, total))
    assert np.isfinite(fold.gain(total)).all()
    assert found == [1, 1]


def test_held_out_bits_do_not_change_their_own_prediction():
    """Other bits in the held-out frames leave the prediction as it is."""
    bits, _, shifts, reference = shaken()
    predicted = []
    for seed in (0, 1):
        frames = bits.to_array().copy()
        rng = np.random.default_rng(seed)
        held = range(int(reference) - 2, int(reference) + 2, 2)
        frames[held] = rng.random(frames[held].shape) < 0.3
        blocks = blocks_of(type(bits).from_array(frames, bits.sensor))
        paths = paths_of(blocks, shifts, reference)
        fold = Fold.of(paths, total_of(paths), held)
        predicted.append(fold.logarithms[0][0])
    inner = np.s_[24:-24, 24:-24]
    np.testing.assert_allclose(predicted[0][inner], predicted[1][inner], atol=1e-5)
