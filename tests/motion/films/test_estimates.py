"""Images of films by the film network: what it reads, its last image, and bad input."""

import dataclasses
import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import hide_warnings
from jotlight.formats.capture import CountStack
from jotlight.metrics import psnr
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.sensor_blocks import as_blocks
from jotlight.motion.films.estimates import FilmEstimates, displaced, estimate_film
from jotlight.motion.films.film import film
from jotlight.motion.films.image import count_nearest
from jotlight.motion.films.live_film import LiveFilm
from jotlight.motion.merge import as_paths
from jotlight.networks.planes_network import FilmNetwork
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.provenance import Provenance

INITIAL = FilmNetwork.initial("small", rng=0)


def random_network():
    """Return a network whose output depends on all planes."""
    *layers, last = INITIAL.layers
    filters = np.random.default_rng(0).normal(0, 0.02, last.filters.shape).astype(np.float32)
    layers.append(dataclasses.replace(last, filters=filters))
    return FilmNetwork(layers, trials_range=INITIAL.trials_range)


RANDOM = random_network()


def burst(motion="static", frames=96, photons=0.3, shape=(48, 64), **options):
    scene = jl.datasets.moving(
        motion=motion,
        sensor=jl.Sensor(frames=frames, **options),
        shape=shape,
        photons=photons,
        rng=0,
    )
    return scene, jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)


@pytest.fixture(scope="module")
def shaken():
    """Return bits of a shaking camera, and the images of their film."""
    _, bits = burst("shake")
    return bits, list(film(bits, window=64, step=16, causal=True))


@pytest.mark.parametrize("side", [1, 2])
def test_displaced_images_are_those_of_a_loop(side):
    rng = np.random.default_rng(side)
    image = rng.random((6, 7)).astype(np.float32)
    displacement = side * rng.uniform(-2, 2, (2, 6, 7)).repeat(side, 1).repeat(side, 2)
    found = displaced(image, displacement, side)
    for row, column in np.ndindex(6, 7):
        step = displacement[:, row * side, column * side] / side
        y, x = np.float32(row) + np.float32(step[0]), np.float32(column) + np.float32(step[1])
        if not (0 <= y <= 5 and 0 <= x <= 6):
            assert np.isnan(found[row, column])
            continue
        top, left = min(int(y), 4), min(int(x), 5)
        square = image[top : top + 2, left : left + 2]
        weights = np.outer([1 - (y - top), y - top], [1 - (x - left), x - left])
        assert found[row, column] == pytest.approx(float((weights * square).sum()), abs=1e-5)


# The blocks have four frames. The images show frame 63, and frame 32.
@pytest.mark.parametrize(
    ("causal", "quarter", "sixteenths"),
    [(True, 48, (60, 56, 52, 48, 44)), (False, 24, (32, 28, 36, 24, 40))],
)
def test_the_nearest_counts_are_those_of_the_nearest_frames(causal, quarter, sixteenths):
    _, bits = burst()
    images = list(film(bits, window=64, step=16, model="none", causal=causal))
    assert len(images) == 3
    for number, image in enumerate(images):
        assert image.start == 16 * number
        window = bits[image.start : image.start + 64]
        starts = [(quarter, 16), *((first, 4) for first in sixteenths)]
        assert len(image.nearest) == 6
        for part, (first, length) in zip(image.nearest, starts, strict=True):
            np.testing.assert_array_equal(part.ones, window[first : first + length].counts())
            np.testing.assert_array_equal(part.trials, np.full(part.shape, float(length)))


@pytest.mark.slow
def test_where_the_motion_is_rejected_counts_and_last_image_stand_still(shaken):
    bits, images = shaken
    window, motion = bits[16:80], images[1].motion
    data, sensor = prepare_burst(window, None)
    paths = as_paths(motion, as_blocks(data, np.arange(0, 65, 4), sensor, None))
    near, nearest, *_ = count_nearest(paths, sensor, is_still=True)
    np.testing.assert_array_equal(near.ones, window[48:].counts())
    np.testing.assert_array_equal(nearest.ones, window[60:].counts())
    moved = count_nearest(paths, sensor, is_still=False)[0]
    assert (moved.ones != near.ones).mean() > 0.1
    estimates = FilmEstimates(INITIAL)
    first = estimates.add(images[0])
    planes, _ = estimates.planes_of(dataclasses.replace(images[1], still=range(60, 64)))
    z = np.arcsin(np.sqrt(1 - np.exp(-first * bits.sensor.light_per_intensity)))
    assert planes[7].all()
    np.testing.assert_allclose(planes[6] + planes[8] + np.pi / 4, z, atol=1e-4)


@pytest.mark.slow
def test_each_image_reads_the_one_before(shaken):
    bits, images = shaken
    estimates = FilmEstimates(INITIAL)
    first = estimates.add(images[0])
    planes, trials = estimates.planes_of(images[1])
    seen = displaced(
        np.arcsin(np.sqrt(1 - np.exp(-first * bits.sensor.light_per_intensity))),
        images[1].motion.at(images[0].start + 63 - images[1].start),
    )
    shown = np.isfinite(seen)
    np.testing.assert_array_equal(planes[7], shown)
    assert 0.5 < shown.mean() < 1
    estimate = planes[8] + np.pi / 4
    np.testing.assert_allclose(planes[6][shown], (seen - estimate)[shown], atol=1e-4)
    gray = jl.reconstruct(images[1].merged, quality="large")
    expected = np.arcsin(np.sqrt(1 - np.exp(-gray * bits.sensor.light_per_intensity)))
    np.testing.assert_allclose(estimate, expected, atol=1e-5)
    assert trials == pytest.approx(np.median(images[1].merged.trials), rel=1e-6)


@pytest.mark.slow
def test_films_and_live_films_have_the_same_images():
    scene, bits = burst("shake")
    images = list(film(bits, window=64, step=16, causal=True))
    of_film = list(estimate_film(images, RANDOM))
    live, estimates = LiveFilm(scene.sensor, window=64, step=16), FilmEstimates(RANDOM)
    of_live = [estimates.add(image) for image in live.add(bits)]
    assert len(of_film) == len(of_live) == 3
    for one, other in zip(of_film, of_live, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == np.float32
        assert one.min() >= 0
        assert one.max() <= scene.sensor.max_intensity
    # The network reads the last image and the nearest counts.
    assert abs(FilmEstimates(RANDOM).add(images[1]) - of_film[1]).max() > 1e-3
    others = dataclasses.replace(images[0], count_nearest=images[1].count_nearest)
    assert abs(FilmEstimates(RANDOM).add(others) - of_film[0]).max() > 1e-3


@pytest.mark.slow
def test_jots_that_differ_and_larger_pixels_are_read():
    rng = np.random.default_rng(1)
    efficiency = rng.uniform(0.5, 1, (96, 128))
    scene, bits = burst("shake", efficiency=efficiency, oversampling=2)
    images = list(film(bits, scene.sensor, window=64, step=16, causal=True))
    found = list(estimate_film(images, INITIAL))
    assert [each.shape for each in found] == [(48, 64)] * 3
    # An untrained network returns what the gray network makes of the same counts.
    np.testing.assert_allclose(found[0], jl.reconstruct(images[0].data, quality="large"), atol=1e-5)
    planes, trials = FilmEstimates(INITIAL).planes_of(images[0])
    for index, part in enumerate((images[0].merged, *images[0].nearest)):
        with hide_warnings("no valid bit"):  # at the borders of short parts
            light = jl.mle(part)
        efficient, _ = reference_jot(scene.sensor)
        z = np.arcsin(np.sqrt(1 - np.exp(-light * efficient * scene.sensor.light_per_intensity)))
        own = (part.trials > 0) & (part.ones < part.trials) & (light < 0.99)
        deviation = z - planes[8] - np.pi / 4
        plane = 2 * index if index < 3 else 6 + index
        # Counts of alike jots differ a little from those of each pixel if these have few trials.
        assert np.median(abs(planes[plane][own] - deviation[own])) < 5e-3
        assert np.corrcoef(planes[plane][own], deviation[own])[0, 1] > 0.97
        if index < 3:
            share = np.minimum(np.sqrt(part.trials / trials), 1.5)
            np.testing.assert_allclose(planes[2 * index + 1], share, rtol=1e-5)


@pytest.mark.slow
def test_another_film_does_not_read_the_last_image_of_the_first(shaken):
    _, images = shaken
    estimates = FilmEstimates(RANDOM)
    for image in images:
        estimates.add(image)
    again = estimates.add(images[0])
    np.testing.assert_array_equal(again, FilmEstimates(RANDOM).add(images[0]))


def test_the_estimate_of_a_scene_that_stands_still_is_that_of_the_gray_network():
    _, bits = burst("static")
    for image in film(bits, window=64, step=16, model="none", causal=True):
        found = FilmEstimates(RANDOM).add(image)
        np.testing.assert_allclose(found, jl.reconstruct(image.data, quality="large"), atol=1e-4)


@pytest.mark.slow
def test_stacks_of_counts_have_films():
    _, bits = burst("shake")
    counts = np.stack([bits[k : k + 4].counts() for k in range(0, 96, 4)]).astype(np.uint8)
    stack = CountStack(counts, Provenance("npy", "a.npy"), trials=4)
    images = film(stack, bits.sensor, window=16, step=4, causal=True)
    assert [each.shape for each in estimate_film(images, RANDOM)] == [(48, 64)] * 3


@pytest.mark.slow
def test_images_of_a_single_channel_are_those_of_gray_films_with_its_axis(shaken):
    bits, images = shaken
    channel = jl.Bits.from_array(bits.to_array()[..., None], bits.sensor)
    found = list(estimate_film(film(channel, window=64, step=16, causal=True), RANDOM))
    expected = list(estimate_film(images, RANDOM))
    np.testing.assert_array_equal(np.stack(found), np.stack(expected)[..., None])


@pytest.mark.slow
def test_the_pretrained_network_is_better_where_motion_is_unknown():
    scene, bits = burst("layers", frames=160, photons=0.2, shape=(96, 128))
    images = list(film(bits, window=64, step=16, model="affine", causal=True))
    network, rows = jl.pretrained(scene.sensor), []
    for image, found in zip(images, estimate_film(images), strict=True):
        truth = scene.image(image.start + 63)
        merged = network.reconstruct(image.merged)
        rows.append([psnr(each, truth, data_range=1.0) for each in (merged, found)])
    merged, found = np.mean(rows, axis=0)
    assert found > merged + 0.2


def test_what_is_no_image_of_a_film_is_refused():
    bits = jl.Bits.from_array(np.zeros((4, 16, 16), bool))
    with pytest.raises(TypeError, match=r"image: expected an image of .*film\(.* got Bits"):
        FilmEstimates(INITIAL).add(bits)
    with pytest.raises(TypeError, match=r"image: expected an image of .*film\(.* got int"):
        next(estimate_film([1], INITIAL))


@pytest.mark.parametrize(("frames", "number"), [(48, 1), (64, 0)])
def test_windows_that_are_shorter_than_those_of_the_training_are_reported_once(frames, number):
    _, bits = burst("static", frames=frames + 8, shape=(32, 32))
    estimates = FilmEstimates(INITIAL)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        for image in film(bits, window=frames, step=8, model="none"):
            estimates.add(image)
    texts = [str(each.message) for each in warned if "film network" in str(each.message)]
    assert len(texts) == number
    for text in texts:
        assert "is for windows of 64 to 256 frames, got 48; jotlight.reconstruct(image" in text


def test_colors_finer_grids_and_smooth_kernels_are_refused(shaken):
    bits, _ = shaken
    estimates = FilmEstimates(INITIAL)
    mosaic = jl.Sensor(frames=64, mosaic="RGGB")
    colored = mosaic.expose(np.full((32, 32, 3), 0.5), rng=0, channel_axis=-1)
    with pytest.raises(ValueError, match="expected gray counts on the grid of the sensor"):
        estimates.add(next(iter(film(colored, window=32, step=8))))
    finer = next(iter(film(bits, window=64, step=16, upsample=2)))
    with pytest.raises(ValueError, match="expected gray counts on the grid of the sensor"):
        estimates.add(finer)
    smooth = bits.sensor.replace(kernel="cubic")
    image = next(iter(film(bits, smooth, window=64, step=16)))
    with pytest.raises(ValueError, match="expected the box kernel, got cubic"):
        estimates.add(image)
