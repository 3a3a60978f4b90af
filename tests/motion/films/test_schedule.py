"""When the motion of a film is estimated again."""

import types

import pytest

from jotlight.motion.films.schedule import FilmSchedule, _Doubt
from moving import film_settings


def candidate(*, is_carried=True, flagged=0.0, agreeing=1.0, model="affine", start=0):
    """Return what the schedule reads of an image."""
    return types.SimpleNamespace(
        image=types.SimpleNamespace(is_carried=is_carried, start=start),
        motion=types.SimpleNamespace(model=model),
        flagged=flagged,
        agreeing=agreeing,
    )


@pytest.mark.parametrize("causal", [False, True])
def test_a_motion_is_old_after_33_images_unless_the_film_is_causal(causal):
    schedule = FilmSchedule(film_settings(32, causal=causal))
    schedule.add(candidate(is_carried=False), is_compared=False)
    ages = []
    for number in range(1, 80):
        is_old = schedule.is_old(candidate())
        if is_old:
            ages.append(number)
        schedule.add(candidate(), is_compared=is_old)
    assert ages == ([] if causal else [33, 66])


def test_a_motion_is_old_if_fewer_bits_agree_than_when_it_was_estimated():
    schedule = FilmSchedule(film_settings(32))
    schedule.add(candidate(is_carried=False, agreeing=0.9), is_compared=False)
    for agreeing, is_old in ((0.88, False), (0.86, True), (0.88, False)):
        assert schedule.is_old(candidate(agreeing=agreeing)) == is_old
        schedule.add(candidate(agreeing=agreeing), is_compared=False)
    # After a comparison that the carried motion won, its bits are the usual ones.
    schedule.add(candidate(agreeing=0.86), is_compared=True)
    assert not schedule.is_old(candidate(agreeing=0.84))


def attempts(schedule, model, ends, *, are_better):
    """Return the ends of the windows whose motion is also estimated from up to 128 frames.

    `are_better` states whether the images along these motions are shown.
    """
    found = []
    for end in ends:
        around = range(max(0, end - 128), end)
        carried = candidate(model=model, start=end - 32)
        is_due = schedule.needs_more_frames(carried, around, is_lost=False)
        found += [end] * is_due
        is_carried = not (is_due and are_better)
        schedule.add(candidate(is_carried=is_carried, model=model), is_compared=False)
    return found


@pytest.mark.parametrize(
    ("causal", "model", "are_better", "expected"),
    [
        (True, "segments", True, [40, 52, 68, 88, 112, 140, 172, 204, 236, 268]),
        (True, "tiles", True, [40, 52, 68, 88, 112, 140, 172, 204, 236, 268]),
        (True, "segments", False, [40, 60, 120]),
        (False, "segments", False, [40, 60, 120]),
        (True, "affine", True, []),
        (False, "affine", True, []),
    ],
)
def test_the_motion_of_parts_is_estimated_again_from_more_frames(
    causal, model, are_better, expected
):
    schedule = FilmSchedule(film_settings(32, causal=causal))
    fresh = candidate(is_carried=False, model=model)
    assert not schedule.needs_more_frames(fresh, range(32), is_lost=True)
    schedule.add(fresh, is_compared=True)
    assert attempts(schedule, model, range(36, 272, 4), are_better=are_better) == expected


def test_a_fresh_motion_of_a_window_is_that_of_its_frames():
    schedule = FilmSchedule(film_settings(32, causal=True))
    fresh = candidate(is_carried=False, model="segments", start=68)
    assert not schedule.needs_more_frames(fresh, range(100), is_lost=False)
    schedule.add(fresh, is_compared=True)
    assert attempts(schedule, "segments", range(104, 120, 4), are_better=True) == [108]


def test_the_number_of_flagged_images_between_two_attempts_doubles():
    schedule = FilmSchedule(film_settings(32))
    flagged = candidate(flagged=0.9)
    found = [schedule.needs_more_frames(flagged, range(40), is_lost=False) for _ in range(20)]
    assert [number for number, is_due in enumerate(found) if is_due] == [1, 2, 4, 8, 16]


def test_no_attempt_is_counted_where_no_more_frames_are_known():
    schedule = FilmSchedule(film_settings(32))
    flagged = candidate(flagged=0.9)
    for _ in range(5):
        assert not schedule.needs_more_frames(flagged, range(32), is_lost=True)
    assert schedule.needs_more_frames(flagged, range(33), is_lost=True)


def test_a_single_flagged_image_is_no_reason_to_doubt():
    doubt = _Doubt()
    shares = [0.9, 0.1, 0.9, 0.9, 0.1, 0.9]
    due = [doubt.is_due(share, is_new=False) for share in shares]
    assert due == [False, False, False, True, False, False]
    assert _Doubt().is_due(0.9, is_new=True)
