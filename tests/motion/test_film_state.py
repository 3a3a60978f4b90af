"""What films carry: doubt about the motion, and the motion in more frames."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import hide_warnings
from jotlight.motion import film_state
from jotlight.motion.film import film
from jotlight.motion.film_image import FilmSettings
from jotlight.motion.film_state import FilmState
from jotlight.motion.merge import as_paths
from moving import record


def settings_of(window, *, causal=True):
    return FilmSettings(
        window=window,
        step=window // 4,
        model="auto",
        causal=causal,
        memory=None,
        upsample=1,
        threads=None,
    )


@pytest.fixture
def attempts(monkeypatch):
    """Return the first frames of the windows whose motion is estimated from more frames.

    A carried image has 90 % of flagged pixels, one along a motion from more frames has 10 % or 95 %
    (``attempts(True)`` or ``attempts(False)``), and one along a motion from its window 60 %.
    """
    starts, longer = [], FilmState._of_more_frames

    def counted(self, frames, first, part, start):
        starts.append(start)
        # It is the same motion, so that images only differ in what they carry.
        found = longer(self, frames, first, part, start)
        return dataclasses.replace(found, warnings=["more frames"])

    def prepare(is_better):
        def flagged(self):
            if self.image.is_carried:
                return 0.9
            return (0.1 if is_better else 0.95) if self.warnings == ["more frames"] else 0.6

        monkeypatch.setattr(FilmState, "_of_more_frames", counted)
        monkeypatch.setattr(film_state._Candidate, "flagged", property(flagged))
        monkeypatch.setattr(film_state._Candidate, "explains_more", lambda *_: is_better)
        return starts

    return prepare


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:more frames:jotlight.JotlightWarning")
@pytest.mark.parametrize(
    ("causal", "is_better", "model"),
    [
        (True, True, "affine"),
        (True, True, "auto"),
        (False, True, "auto"),
        (True, False, "auto"),
        (False, False, "auto"),
    ],
)
def test_a_doubtful_motion_is_estimated_from_more_frames(
    monkeypatch, attempts, causal, is_better, model
):
    """The better image is shown, and the film goes on with its motion and its memory."""
    shape = (64, 64) if model == "affine" else (96, 96)
    _, bits = record("shake", frames=96, shape=shape, photons=1.0)
    starts = attempts(is_better)
    options = {"window": 32, "step": 8, "causal": causal, "model": model}
    images = list(film(bits, **options))
    assert len(images) == 9
    # The number of images between attempts doubles. A causal film has no more frames at first.
    assert starts == ([8, 16, 32, 64] if causal else [0, 8, 24, 56])
    assert [image.is_carried for image in images] == [
        start > 0 and not (is_better and start in starts) for start in range(0, 65, 8)
    ]
    if not is_better:
        # Attempts that fail change neither the motion nor the memory.
        monkeypatch.setattr(film_state._Doubt, "is_due", lambda *_, **__: False)
        for image, other in zip(images, film(bits, **options), strict=True):
            np.testing.assert_array_equal(image.merged.ones, other.merged.ones)


@pytest.mark.slow
def test_the_motion_that_explains_the_bits_is_better_unless_merging_rejected_it():
    _, bits = record("shake", frames=32, photons=1.0)
    state = FilmState(bits.sensor, settings_of(window=32))
    right = state._fresh(bits, 0)
    nodes = 1.5 * right.motion.nodes
    wrong_motion = dataclasses.replace(right.motion, nodes=nodes)
    paths = as_paths(wrong_motion, right.paths.blocks)
    wrong = dataclasses.replace(right, motion=wrong_motion, paths=paths)
    assert right.explains_more(wrong)
    assert not wrong.explains_more(right)
    rejected = dataclasses.replace(right, image=dataclasses.replace(right.image, still=range(16)))
    assert wrong.explains_more(rejected)
    assert not rejected.explains_more(wrong)


@pytest.mark.slow
def test_a_motion_is_carried_although_all_pixels_are_flagged(monkeypatch):
    """It is lost only where the sums of a window without motion predict the bits better."""
    monkeypatch.setattr(film_state, "_MAX_FLAGGED", 1.0)  # no motion in more frames
    monkeypatch.setattr(film_state, "_MAX_LOSS", 1.0)  # no fresh motion
    _, bits = record("shake", frames=20, shape=(48, 48), photons=1.0)
    monkeypatch.setattr(
        "jotlight.motion.merge.find_flags",
        lambda _, disagreements, *__, **___: np.ones(disagreements.shape, bool),
    )
    for window, is_lost in ((None, False), (range(6, 10), True)):
        monkeypatch.setattr("jotlight.motion.merge.find_window", lambda *_, window=window: window)
        with hide_warnings():
            images = list(film(bits, window=16, step=4, model="affine"))
        assert [image.merged.flags.all() for image in images] == [True, True]
        assert [image.is_rejected for image in images] == [is_lost, is_lost]
        assert images[0].still == window
        assert images[1].is_carried != is_lost


@pytest.mark.slow
def test_segments_are_aligned_again_as_the_frames_of_a_causal_film_become_more():
    _, bits = record("shake", frames=32, photons=1.0)
    affine = jl.align(bits)
    segments = dataclasses.replace(affine, model="segments")
    for causal, motion, expected in (
        (True, segments, [48, 72, 108, 128]),
        (True, affine, []),
        (False, segments, []),
    ):
        state = FilmState(bits.sensor, settings_of(window=32, causal=causal))
        state._frames, found = 32, []
        for known in [*range(32, 128), *[128] * 40]:
            if state._has_more(range(known), motion):
                state._frames = known
                found.append(known)
        assert found == expected


def test_a_single_flagged_image_is_no_reason_to_doubt():
    doubt = film_state._Doubt()
    shares = [0.9, 0.1, 0.9, 0.9, 0.1, 0.9]
    due = [doubt.is_due(share, is_new=False) for share in shares]
    assert due == [False, False, False, True, False, False]
    assert film_state._Doubt().is_due(0.9, is_new=True)


@pytest.mark.parametrize(
    ("causal", "stop", "expected"),
    [
        (True, 1000, range(304, 432)),
        (True, 432, range(304, 432)),
        (False, 1000, range(352, 480)),
        (False, 440, range(352, 440)),
    ],
)
def test_more_frames_are_those_of_four_windows(causal, stop, expected):
    settings = settings_of(window=32, causal=causal)
    assert settings.more_frames(0, stop, 400) == expected
    assert settings.more_frames(390, stop, 400).start == 390


def test_a_motion_without_doubt_is_not_estimated_again(monkeypatch):
    _, bits = record("static", frames=56, shape=(96, 96))
    starts, longer = [], FilmState._of_more_frames
    monkeypatch.setattr(
        FilmState,
        "_of_more_frames",
        lambda self, *arguments: starts.append(0) or longer(self, *arguments),
    )
    images = list(film(bits, window=32, step=8))
    assert max(image.merged.flags.mean() for image in images) < 0.5
    assert starts == []
