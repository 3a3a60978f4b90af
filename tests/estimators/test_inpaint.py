import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.inpaint import inpaint_dead_pixels


def solve_dense(image, dead):
    """Return the image with each dead pixel the mean of its neighbors, by a dense linear solver."""
    height, width = image.shape
    positions = [tuple(position) for position in np.argwhere(dead)]
    matrix, known = np.zeros((len(positions), len(positions))), np.zeros(len(positions))
    for row, (y, x) in enumerate(positions):
        neighbors = [
            (y + dy, x + dx)
            for dy in (-1, 0, 1)
            for dx in (-1, 0, 1)
            if (dy, dx) != (0, 0) and 0 <= y + dy < height and 0 <= x + dx < width
        ]
        matrix[row, row] = 1
        for position in neighbors:
            if dead[position]:
                matrix[row, positions.index(position)] -= 1 / len(neighbors)
            else:
                known[row] += image[position] / len(neighbors)
    filled = image.astype(float)
    filled[dead] = np.linalg.solve(matrix, known)
    return filled


def fill_ring_by_ring(image, dead):
    """Return the image filled from the border of each hole inward, with means of known pixels."""
    filled = np.where(dead, np.nan, image).astype(float)
    while np.isnan(filled).any():
        padded = np.pad(filled, 1, constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
        ring = filled.copy()
        for position in np.argwhere(np.isnan(filled)):
            window = windows[tuple(position)]
            if not np.isnan(window).all():
                ring[tuple(position)] = np.nanmean(window)
        filled = ring
    return filled


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.995])
def test_each_dead_pixel_is_the_mean_of_its_neighbors(share):
    rng = np.random.default_rng(0)
    image = rng.random((19, 23), np.float32)
    dead = rng.random(image.shape) < share
    assert dead.any()
    with pytest.warns(jl.JotlightWarning, match=f"{dead.sum()} of 437 pixels"):
        filled = inpaint_dead_pixels(np.where(dead, np.float32("nan"), image), dead)
    assert filled.dtype == np.float32
    np.testing.assert_allclose(filled, solve_dense(image, dead), rtol=1e-4)


@pytest.mark.parametrize("noise", [0, 0.1])
@pytest.mark.parametrize("side", [3, 9])
def test_holes_have_a_smaller_error_than_when_filled_ring_by_ring(side, noise):
    rng = np.random.default_rng(3)
    photo = jl.datasets.photograph("camera")[:256, :256]
    dead = np.zeros(photo.shape, bool)
    for _ in range(540 // side**2):
        y, x = rng.integers(0, 256 - side, 2)
        dead[y : y + side, x : x + side] = True
    noisy = photo + np.float32(noise) * rng.standard_normal(photo.shape, np.float32)
    errors = [np.sqrt(np.mean((fill_ring_by_ring(noisy, dead) - photo)[dead] ** 2))]
    with pytest.warns(jl.JotlightWarning):
        errors.append(np.sqrt(np.mean((inpaint_dead_pixels(noisy, dead) - photo)[dead] ** 2)))
    assert errors[1] < 0.97 * errors[0]


def test_known_pixels_are_unchanged():
    image = np.random.default_rng(1).random((9, 9), np.float32)
    dead = np.eye(9, dtype=bool)
    with pytest.warns(jl.JotlightWarning):
        filled = inpaint_dead_pixels(image, dead)
    np.testing.assert_array_equal(filled[~dead], image[~dead])


def test_filled_pixels_stay_between_the_extremes_of_the_known_ones():
    rng = np.random.default_rng(2)
    for _ in range(20):
        image = np.zeros((20, 20), np.float32)
        image[:, :8] = rng.random((20, 8))
        dead = np.zeros(image.shape, bool)
        dead[8:12, 12:15] = True
        with pytest.warns(jl.JotlightWarning):
            assert (inpaint_dead_pixels(image, dead)[dead] == 0).all()
        with pytest.warns(jl.JotlightWarning):
            assert (inpaint_dead_pixels(1 - image, dead)[dead] == 1).all()


def test_without_dead_pixels_the_image_itself_is_returned():
    image = np.ones((2, 2), np.float32)
    assert inpaint_dead_pixels(image, None) is image


def test_an_image_of_dead_pixels_only_is_refused():
    with pytest.raises(ValueError, match="at least one pixel with a valid bit, got none"):
        inpaint_dead_pixels(np.ones((2, 2), np.float32), np.ones((2, 2), bool))


@pytest.mark.parametrize(
    "method",
    [
        jl.mle,
        jl.noniterative,
        lambda data, sensor: jl.Network.initial(sensor).reconstruct(data, sensor),
    ],
)
@pytest.mark.parametrize("channels", [(), (3,)])
def test_the_warning_points_at_the_line_that_called_jotlight(method, channels):
    sensor = jl.Sensor(frames=2, mask=np.eye(3, dtype=bool))
    with pytest.warns(jl.JotlightWarning) as caught:
        method(np.ones((3, 3, *channels), int), sensor)
    assert {warning.filename for warning in caught} == {__file__}
