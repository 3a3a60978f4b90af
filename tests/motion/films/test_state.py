"""What films carry: the motion, unless it is lost, and the motion in more frames."""

import dataclasses

import numpy as np
import pytest

from jotlight.errors import hide_warnings
from jotlight.motion.films import schedule as film_schedule
from jotlight.motion.films.candidates import Candidate, Candidates
from jotlight.motion.films.film import film
from moving import record


def ignore(self, value):
    """Set no value of a property."""


@pytest.fixture
def attempts(monkeypatch):
    """Return the first frames of the windows whose motion is estimated from more frames.

    A carried image has 90 % of flagged pixels, one along a motion from more frames has 10 % or 95 %
    (``attempts(True)`` or ``attempts(False)``), and one along a motion from its window 60 %.
    """
    starts, longer = [], Candidates.of_more_frames

    def counted(self, frames, first):
        starts.append(self.start)
        # It is the same motion, so that images only differ in what they carry.
        return dataclasses.replace(longer(self, frames, first), warnings=["more frames"])

    def prepare(is_better):
        def flagged(self):
            if self.image.is_carried:
                return 0.9
            return (0.1 if is_better else 0.95) if self.warnings == ["more frames"] else 0.6

        monkeypatch.setattr(Candidates, "of_more_frames", counted)
        monkeypatch.setattr(Candidate, "flagged", property(flagged, ignore), raising=False)
        monkeypatch.setattr(Candidates, "explains_more", lambda *_: is_better)
        return starts

    return prepare


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:more frames:jotlight.JotlightWarning")
@pytest.mark.parametrize(
    ("causal", "is_better", "model"),
    [
        (True, True, "affine"),
        pytest.param(True, True, "auto", marks=pytest.mark.exhaustive),
        pytest.param(False, True, "auto", marks=pytest.mark.exhaustive),
        pytest.param(True, False, "auto", marks=pytest.mark.exhaustive),
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
        monkeypatch.setattr(film_schedule._Doubt, "is_due", lambda *_, **__: False)
        for image, other in zip(images, film(bits, **options), strict=True):
            np.testing.assert_array_equal(image.merged.ones, other.merged.ones)


@pytest.mark.slow
def test_a_motion_is_carried_although_all_pixels_are_flagged(monkeypatch):
    """It is lost only where the sums of a window without motion predict the bits better."""
    monkeypatch.setattr(film_schedule, "_MAX_FLAGGED", 1.0)  # no motion in more frames
    monkeypatch.setattr(film_schedule, "_MAX_LOSS", 1.0)  # no fresh motion
    _, bits = record("shake", frames=20, shape=(48, 48), photons=1.0)
    for name in ("find_flags", "flags_of_image"):
        monkeypatch.setattr(
            f"jotlight.motion.merge.{name}",
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


@pytest.mark.parametrize("is_fewer", [True, False])
def test_a_fresh_motion_is_shown_unless_it_flags_more_pixels(monkeypatch, is_fewer):
    monkeypatch.setattr(film_schedule, "_MAX_LOSS", -1.0)  # each carried motion is compared
    flagged = property(lambda self: 0.2 if self.image.is_carried == is_fewer else 0.05, ignore)
    monkeypatch.setattr(Candidate, "flagged", flagged, raising=False)
    _, bits = record("shake", frames=20, shape=(48, 48), photons=1.0)
    images = list(film(bits, window=16, step=4, model="affine"))
    assert [image.is_carried for image in images] == [False, not is_fewer]


def test_a_motion_without_doubt_is_not_estimated_again(monkeypatch):
    _, bits = record("static", frames=56, shape=(96, 96))
    starts, longer = [], Candidates.of_more_frames
    monkeypatch.setattr(
        Candidates,
        "of_more_frames",
        lambda self, *arguments: starts.append(0) or longer(self, *arguments),
    )
    images = list(film(bits, window=32, step=8))
    assert max(image.merged.flags.mean() for image in images) < 0.5
    assert starts == []
