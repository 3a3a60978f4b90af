"""Films of frames that arrive one after the other."""

import itertools

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.films.film import film
from jotlight.motion.films.live_film import LiveFilm
from jotlight.sensing.data import periodic_rates
from moving import record


@pytest.mark.slow
@pytest.mark.parametrize(
    "sizes",
    [
        pytest.param((1,), marks=pytest.mark.exhaustive),
        (7, 30),
        pytest.param((100,), marks=pytest.mark.exhaustive),
    ],
)
def test_frames_that_arrive_in_any_parts_make_the_same_film(sizes):
    _, bits = record("shake", 64, (48, 48), rng=1)
    live = LiveFilm(bits.sensor, window=32, step=8)
    images, start = [], 0
    for size in itertools.cycle(sizes):
        images += live.add(bits[start : start + size])
        start += size
        if start >= len(bits):
            break
    expected = list(film(bits, window=32, step=8, causal=True))
    assert len(images) == len(expected)
    for one, two in zip(images, expected, strict=True):
        np.testing.assert_array_equal(one.merged.ones, two.merged.ones)
        assert one.merged.sensor == two.merged.sensor
        assert one.is_carried == two.is_carried


@pytest.mark.slow
def test_a_live_film_keeps_four_windows_of_frames(monkeypatch):
    _, bits = record("static", 32, (32, 32), rng=1)
    live = LiveFilm(bits.sensor, window=16, step=4, model="none")
    packed, shown = np.asarray(bits.packed), []
    shows = live._state.next_image

    def next_image(known, start):
        assert len(known.numbers) == min(64, start + 16)
        assert known.numbers.stop == start + 16
        np.testing.assert_array_equal(known.data.packed, packed[np.array(known.numbers) % 32])
        shown.append(known.data)
        return shows(known, start)

    monkeypatch.setattr(live._state, "next_image", next_image)
    number = sum(len(live.add(bits)) for _ in range(5))
    assert number == len(shown) == 1 + (160 - 16) // 4
    assert len(live._kept) == 80
    # Frames that an image may refer to are not overwritten later.
    np.testing.assert_array_equal(shown[-3].packed, packed[np.arange(88, 152) % 32])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 0, "step": 1}, "window: expected"),
        ({"window": 16, "step": 17}, "step: expected a whole number from 1 to 16"),
        ({"window": 16, "step": 4, "model": "rigid"}, "model: expected one of auto"),
        ({"window": 16, "step": 4, "upsample": 4}, "upsample: expected"),
    ],
)
def test_bad_options_of_a_live_film_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        LiveFilm(jl.Sensor(), **options)


def test_other_frames_of_a_live_film_are_refused():
    live = LiveFilm(jl.Sensor(), window=16, step=4)
    live.add(jl.Bits.from_array(np.zeros((4, 16, 16), bool)))
    with pytest.raises(ValueError, match="the size of earlier frames, 16 x 16, got 16 x 15"):
        live.add(jl.Bits.from_array(np.zeros((4, 16, 15), bool)))
    with pytest.raises(TypeError, match=r"frames: expected jotlight\.Bits"):
        live.add(np.zeros((4, 16, 16)))


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (jl.Sensor(frames=8, threshold=2), "threshold: the data state threshold 2, but"),
        (jl.Sensor(frames=8, mosaic="RGGB"), "mosaic: .*; pass the sensor of the data unless"),
    ],
)
def test_a_live_film_warns_once_about_frames_of_another_sensor(stated, message):
    live = LiveFilm(jl.Sensor(), window=16, step=4)
    bits = jl.Bits.from_array(np.zeros((8, 16, 16), bool), stated)
    with pytest.warns(jl.JotlightWarning, match=message) as warned:
        live.add(bits[:4])
    live.add(bits[4:])  # warnings are errors
    assert len(warned) == 1


@pytest.mark.parametrize(
    ("sensor", "wrong", "message"),
    [
        (jl.Sensor(efficiency=np.full((16, 16), 0.5)), (8, 8), r"efficiency: .* shape \(8, 8\)"),
        (jl.Sensor(oversampling=4), (16, 18), "multiples of the oversampling 4, got 16 x 18"),
        (jl.Sensor(mosaic="RGGB"), (16, 16, 3), "expected gray frames"),
    ],
)
def test_frames_that_do_not_fit_a_live_film_are_refused_at_once(sensor, wrong, message):
    live = LiveFilm(sensor, window=16, step=4)
    with pytest.raises(ValueError, match=message):
        live.add(jl.Bits.from_array(np.zeros((4, *wrong), bool)))
    assert live.add(jl.Bits.from_array(np.zeros((4, 16, 16), bool))) == []


@pytest.mark.slow
@pytest.mark.parametrize("known", [False, True])
def test_a_live_film_tests_the_periods_of_its_jots_once(monkeypatch, known):
    _, bits = record("shake", 64, (128, 128), rng=1)
    bits = bits.replace(tested_for_periods=known)
    tested, find = [], periodic_rates.find_periodic_rates

    def counted(counts):
        tested.append(counts.shape)
        return find(counts)

    monkeypatch.setattr(periodic_rates, "find_periodic_rates", counted)
    live = LiveFilm(bits.sensor, window=32, step=8)
    images = [image for start in range(0, 64, 8) for image in live.add(bits[start : start + 8])]
    assert len(images) == 5
    assert len(tested) == (0 if known else 1)
