"""Films of several kinds of jots: sums over squares, merged colors, and still windows."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts.sensor_blocks import excluded_jots
from jotlight.motion.films.candidates import Candidates
from jotlight.motion.films.film import film
from jotlight.motion.films.frames import FilmFrames
from jotlight.motion.films.kinds import FilmKinds
from jotlight.motion.films.live_film import LiveFilm
from jotlight.motion.merging.jot_squares import in_squares
from jotlight.motion.merging.mosaic_colors import is_mergeable
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.reading_groups import without_mosaic
from moving import behind, film_settings

FRAMES, SIZE = 96, (64, 80)
WINDOW, STEP = 64, 16


def small(mosaic="RGGB", motion="shake", rng=4):
    """Return a moving color scene of the size, and its bits."""
    return behind(mosaic, motion, FRAMES, SIZE, rng)


def quality(data, truth):
    inner = (slice(8, -8),) * 2
    return jl.metrics.psnr(jl.reconstruct(data)[inner], truth[inner], data_range=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("causal", [pytest.param(False, marks=pytest.mark.exhaustive), True])
def test_images_are_as_good_as_with_a_fresh_alignment(causal):
    gains = []
    for rng in (0, 3, 4):
        scene, bits = small(rng=rng)
        images = list(film(bits, window=WINDOW, step=STEP, causal=causal, memory=False))
        assert causal or images[-1].is_carried
        assert not any(image.is_rejected for image in images)
        for index, image in enumerate(images):
            assert image.data is image.merged
            assert image.merged.shape == (*SIZE, 3)
            assert image.motion.size == SIZE
            at = WINDOW - 1 if causal else WINDOW // 2
            assert image.motion.reference == at
            truth = scene.image(index * STEP + at)
            part = bits[index * STEP : index * STEP + WINDOW]
            found, fresh = (quality(each, truth) for each in (image.data, jl.merge(part, at=at)))
            gains.append(found - fresh)
            assert found > quality(part[at - 4 : at + 5], truth) + 2
    # Both alignments have random errors, mostly at the ends of a window.
    assert np.mean(gains) > -0.1
    assert min(gains) > -0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "window", "step", "model", "shape"),
    [
        (48, 32, 8, "affine", (48, 56)),
        (FRAMES, WINDOW, STEP, "auto", SIZE),
    ],
)
def test_live_images_are_those_of_a_causal_film(frames, window, step, model, shape):
    _, bits = behind("RGGB", "shake", frames, shape)
    live = LiveFilm(bits.sensor, window=window, step=step, model=model)
    found = [
        image for start in range(0, frames, 11) for image in live.add(bits[start : start + 11])
    ]
    expected = list(film(bits, window=window, step=step, causal=True, model=model))
    assert len(found) == len(expected) == 1 + (frames - window) // step
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.merged.ones, other.merged.ones)
        np.testing.assert_array_equal(one.merged.trials, other.merged.trials)


@pytest.mark.slow
def test_a_causal_film_remembers_colors():
    scene, bits = behind(frames=2 * FRAMES, shape=SIZE)
    # Without a memory, the frames before the last windows change nothing.
    recent = bits[-72:]
    last = [
        list(film(part, window=48, step=12, causal=True, memory=memory))[-1]
        for part, memory in ((recent, False), (bits, None))
    ]
    trials = [image.merged.trials.mean() for image in last]
    assert trials[1] > 1.1 * trials[0]
    truth = scene.image(2 * FRAMES - 1)
    assert quality(last[1].data, truth) > quality(last[0].data, truth) + 0.2


@pytest.mark.slow
@pytest.mark.parametrize("causal", [(False), True])
def test_a_still_window_keeps_its_bits(causal):
    bits = small(motion="static")[1][: WINDOW + STEP]
    for index, image in enumerate(film(bits, window=WINDOW, step=STEP, causal=causal)):
        assert image.motion.model == "none"
        part = bits[index * STEP : index * STEP + WINDOW]
        np.testing.assert_array_equal(np.asarray(image.data.packed), np.asarray(part.packed))
        assert image.data.sensor == part.sensor
        np.testing.assert_array_equal(jl.reconstruct(image.data), jl.reconstruct(part))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mosaic", "step"),
    [
        ("RGGB", 5),
        ("RGGB", 16),
        ("RGGB", 40),
        ("RGB", 16),
        (Mosaic([[0, 1, 1, 2], [1, 0, 2, 1]], "RGB"), 16),
    ],
)
def test_squares_of_windows_are_those_of_all_frames(mosaic, step):
    mask = np.random.default_rng(0).random(SIZE) < 0.05
    _, bits = small(mosaic)
    sensor = bits.sensor.replace(mask=mask, gain=bits.sensor.gain)
    bits = jl.Bits(bits.packed, SIZE[1], sensor)
    colors = FilmKinds(bits.sensor, SIZE, film_settings(32, step, memory=False))
    gray = without_mosaic(bits.sensor)
    # The third window does not follow the second one, and the last one begins before it.
    for start in (0, step, step + 30, 2 * step):
        stop = min(start + 32, FRAMES)
        first = max(0, start - 3)
        stack = colors.squares(FilmFrames(bits[first:], first), range(start, stop))
        expected, own = in_squares(bits[start:stop], bits.sensor, excluded_jots(gray))
        np.testing.assert_array_equal(stack.images, expected.images)
        assert colors.sensor_of_squares(stop - start) == own


def test_what_cannot_be_merged_is_refused_before_the_first_image():
    zeros = np.zeros((32, 32, 32), bool)
    for mosaic in ("RGBW", "CMYG", Mosaic("RGGB", white_balance=(2, 1, 1))):
        sensor = jl.Sensor(frames=32, mosaic=mosaic)
        assert not is_mergeable(sensor)
        bits = jl.Bits.from_array(zeros, sensor=sensor)
        with pytest.raises(ValueError, match=r"to merge bits behind a mosaic|white balance 1"):
            film(bits, window=16)
        with pytest.raises(ValueError, match=r"to merge bits behind a mosaic|white balance 1"):
            LiveFilm(sensor, window=16, step=4)
    bayer = jl.Bits.from_array(zeros, sensor=jl.Sensor(frames=32, mosaic="RGGB"))
    with pytest.raises(ValueError, match="upsample: expected 1 for a sensor with a mosaic, got 2"):
        film(bayer, window=16, upsample=2)


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["mosaic", "threshold"])
def test_no_short_window_replaces_the_bits_along_a_motion(monkeypatch, pattern):
    random = np.random.default_rng(0).integers(1, 3, (48, 64))
    kinds = {"mosaic": "RGGB"} if pattern == "mosaic" else {"threshold": random}
    scene = jl.datasets.moving(
        jl.datasets.photograph("astronaut" if pattern == "mosaic" else "camera"),
        "shake",
        sensor=jl.Sensor(frames=48, **kinds),
        shape=(48, 64),
        photons=0.5,
        rng=4,
    )
    # Each window without motion would be better than any motion.
    monkeypatch.setattr("jotlight.motion.merge._MAX_FLAGGED", -1.0)
    monkeypatch.setattr("jotlight.motion.agreement.still_window._MIN_LEAD", np.inf)
    image = next(iter(film(scene.bits, window=32, step=8)))
    assert image.data is image.merged
    assert not image.is_rejected
    assert not image.merged.flags.all()


@pytest.mark.slow
def test_color_films_look_at_more_frames(monkeypatch):
    _, bits = small(motion="layers")
    lengths, found = [], Candidates.of_more_frames

    def counted(self, frames, *arguments):
        lengths.append(len(frames))
        return found(self, frames, *arguments)

    monkeypatch.setattr(Candidates, "of_more_frames", counted)
    monkeypatch.setattr("jotlight.motion.films.schedule._MAX_FLAGGED", -1.0)
    list(film(bits, window=32, step=32))
    assert lengths[0] == 32 + 48


def test_frames_with_channels_are_refused():
    live = LiveFilm(jl.Sensor(frames=64, mosaic="RGGB"), window=16, step=8)
    with pytest.raises(ValueError, match=r"expected gray frames \(T, H, W\)"):
        live.add(jl.Bits.from_array(np.zeros((16, 8, 8, 3), bool)))
