"""The settings of films: which frames an image may use."""

import dataclasses

import pytest

from jotlight.motion.films.settings import FilmSettings
from moving import film_settings


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
    settings = film_settings(32, causal=causal)
    assert settings.window_at(400) == range(400, 432)
    assert settings.more_frames(range(stop), 400) == expected
    assert settings.more_frames(range(390, stop), 400).start == 390


def test_the_model_is_known():
    options = dataclasses.asdict(film_settings(32))
    with pytest.raises(ValueError, match="model: expected one of auto, none, affine"):
        FilmSettings(**{**options, "model": "rigid"})


@pytest.mark.parametrize("wrong", [{"causal": "no"}, {"causal": None}, {"memory": "no"}])
def test_choices_of_two_are_true_or_false(wrong):
    options = dataclasses.asdict(film_settings(32))
    with pytest.raises(TypeError, match=f"{next(iter(wrong))}: expected True or False, got"):
        FilmSettings(**{**options, **wrong})
