import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.inpaint import inpaint_dead_pixels


def twin(image, blind):
    """Each blind pixel is the mean of its neighbours: one equation for each, solved as they are."""
    height, width = image.shape
    places = [tuple(place) for place in np.argwhere(blind)]
    matrix, known = np.zeros((len(places), len(places))), np.zeros(len(places))
    for row, (y, x) in enumerate(places):
        around = [
            (y + dy, x + dx)
            for dy in (-1, 0, 1)
            for dx in (-1, 0, 1)
            if (dy, dx) != (0, 0) and 0 <= y + dy < height and 0 <= x + dx < width
        ]
        matrix[row, row] = 1
        for place in around:
            if blind[place]:
                matrix[row, places.index(place)] -= 1 / len(around)
            else:
                known[row] += image[place] / len(around)
    filled = image.astype(float)
    filled[blind] = np.linalg.solve(matrix, known)
    return filled


def grown(image, blind):
    """Filled ring by ring, with the mean of what is known around: what was done before."""
    filled = np.where(blind, np.nan, image).astype(float)
    while np.isnan(filled).any():
        around = np.pad(filled, 1, constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(around, (3, 3))
        ring = filled.copy()
        for place in np.argwhere(np.isnan(filled)):
            window = windows[tuple(place)]
            if not np.isnan(window).all():
                ring[tuple(place)] = np.nanmean(window)
        filled = ring
    return filled


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.995])
def test_each_blind_pixel_is_the_mean_of_its_neighbours(share):
    rng = np.random.default_rng(0)
    image = rng.random((19, 23), np.float32)
    blind = rng.random(image.shape) < share
    assert blind.any()
    with pytest.warns(jl.JotlightWarning, match=f"{blind.sum()} of 437 pixels"):
        filled = inpaint_dead_pixels(np.where(blind, np.float32("nan"), image), blind)
    assert filled.dtype == np.float32
    np.testing.assert_allclose(filled, twin(image, blind), rtol=1e-4)


@pytest.mark.parametrize("noise", [0, 0.1])
@pytest.mark.parametrize("side", [3, 9])
def test_clusters_are_filled_better_than_from_their_rim_inwards(side, noise):
    rng = np.random.default_rng(3)
    photo = jl.datasets.photograph("camera")[:256, :256]
    blind = np.zeros(photo.shape, bool)
    for _ in range(540 // side**2):
        y, x = rng.integers(0, 256 - side, 2)
        blind[y : y + side, x : x + side] = True
    seen = photo + np.float32(noise) * rng.standard_normal(photo.shape, np.float32)
    errors = [np.sqrt(np.mean((grown(seen, blind) - photo)[blind] ** 2))]
    with pytest.warns(jl.JotlightWarning):
        errors.append(np.sqrt(np.mean((inpaint_dead_pixels(seen, blind) - photo)[blind] ** 2)))
    assert errors[1] < 0.97 * errors[0]


def test_known_pixels_stay_to_the_bit():
    image = np.random.default_rng(1).random((9, 9), np.float32)
    blind = np.eye(9, dtype=bool)
    with pytest.warns(jl.JotlightWarning):
        filled = inpaint_dead_pixels(image, blind)
    np.testing.assert_array_equal(filled[~blind], image[~blind])


def test_filled_pixels_are_never_below_or_above_the_known_ones():
    rng = np.random.default_rng(2)
    for _ in range(20):
        image = np.zeros((20, 20), np.float32)
        image[:, :8] = rng.random((20, 8))
        blind = np.zeros(image.shape, bool)
        blind[8:12, 12:15] = True
        with pytest.warns(jl.JotlightWarning):
            assert (inpaint_dead_pixels(image, blind)[blind] == 0).all()
        with pytest.warns(jl.JotlightWarning):
            assert (inpaint_dead_pixels(1 - image, blind)[blind] == 1).all()


def test_nothing_is_done_and_said_without_blind_pixels():
    image = np.ones((2, 2), np.float32)
    assert inpaint_dead_pixels(image, None) is image


def test_a_picture_of_blind_pixels_alone_is_refused():
    with pytest.raises(ValueError, match="at least one jot that is alive, got none"):
        inpaint_dead_pixels(np.ones((2, 2), np.float32), np.ones((2, 2), bool))


@pytest.mark.parametrize(
    "method",
    [jl.mle, jl.noniterative, lambda *given: jl.Network.initial(given[1]).reconstruct(*given)],
)
@pytest.mark.parametrize("colours", [(), (3,)])
def test_the_warning_points_at_the_line_that_called_jotlight(method, colours):
    sensor = jl.Sensor(frames=2, mask=np.eye(3, dtype=bool))
    with pytest.warns(jl.JotlightWarning) as caught:
        method(np.ones((3, 3, *colours), int), sensor)
    assert {warning.filename for warning in caught} == {__file__}
