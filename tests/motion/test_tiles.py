import numpy as np
import pytest

from jotlight.motion.tiles import (
    affine_basis,
    interpolate,
    interpolate_at,
    mean_tiles,
    sum_tiles,
    tile_counts,
)
from reference.motion import interpolate_tiles


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 40), (250, 33)])
def test_sums_over_tiles_are_those_of_a_loop(size):
    image = np.random.default_rng(0).normal(size=size)
    sums = sum_tiles(image)
    assert sums.shape == tile_counts(size)
    for row in range(sums.shape[0]):
        for column in range(sums.shape[1]):
            tile = image[16 * row : 16 * row + 16, 16 * column : 16 * column + 16]
            assert sums[row, column] == pytest.approx(tile.sum())


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 40), (250, 33)])
def test_interpolation_is_that_of_the_engine(size):
    nodes = np.random.default_rng(0).normal(0, 9, (2, *tile_counts(size))).astype(np.float32)
    np.testing.assert_allclose(
        interpolate(nodes, size), interpolate_tiles(nodes, 16, size), atol=2e-4
    )


def test_affine_fields_are_interpolated_exactly():
    size = 100, 150
    rows, columns = np.indices(size)
    centers = np.indices(tile_counts(size)) * 16 + 7.5
    nodes = np.stack([0.1 * centers[0] - 0.2 * centers[1] + 3, 0.3 * centers[1] - 2])
    expected = np.stack([0.1 * rows - 0.2 * columns + 3, 0.3 * columns - 2])
    np.testing.assert_allclose(interpolate(nodes, size), expected, atol=1e-4)


def test_constant_fields_remain_constant():
    nodes = np.full((2, 3, 4), 0.3, np.float32)
    np.testing.assert_allclose(interpolate(nodes, (40, 60)), 0.3, rtol=1e-6)


def test_the_affine_basis_is_orthogonal():
    basis = affine_basis((7, 12))
    product = basis.T @ basis
    np.testing.assert_allclose(product, np.diag(np.diag(product)), atol=1e-12)


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 40), (250, 33)])
def test_displacements_at_places_are_those_of_pixels(size):
    nodes = np.random.default_rng(1).normal(0, 9, (2, *tile_counts(size))).astype(np.float32)
    places = np.indices(size, np.float32)
    np.testing.assert_allclose(
        interpolate_at(nodes, places), interpolate(nodes, size), atol=2e-4, rtol=1e-4
    )


def test_displacements_between_pixels_are_bilinear():
    rng = np.random.default_rng(2)
    nodes = rng.normal(0, 9, (2, 4, 5)).astype(np.float32)
    places = rng.uniform([[-20], [-20]], [[84], [100]], (2, 50)).astype(np.float32)
    for place, found in zip(places.T, interpolate_at(nodes, places).T, strict=True):
        row, column = (place - 7.5) / 16
        top, left = int(np.clip(row // 1, 0, 2)), int(np.clip(column // 1, 0, 3))
        down, right = row - top, column - left
        corners = nodes[:, top : top + 2, left : left + 2].astype(float)
        weights = np.outer([1 - down, down], [1 - right, right])
        np.testing.assert_allclose(found, (corners * weights).sum(axis=(1, 2)), atol=1e-3)


def test_means_over_tiles_are_those_of_a_loop():
    image = np.random.default_rng(3).normal(size=(2, 40, 50))
    means = mean_tiles(image)
    assert means[1, 2, 3] == pytest.approx(image[1, 32:, 48:].mean())
    assert means[0, 1, 1] == pytest.approx(image[0, 16:32, 16:32].mean())
