"""Demosaicing: exact cases, a slow twin of the local mean, and the package for Bayer mosaics."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators import demosaicing
from jotlight.estimators.demosaicing import demosaic, local_mean
from jotlight.sensing.parameters.mosaic import Mosaic

RANDOM = Mosaic(np.random.default_rng(0).integers(4, size=(24, 30)), "RGBW")
MIXED = [[0.8, 0.1, 0.0], [0.1, 0.7, 0.1], [0.0, 0.2, 0.9]]
MOSAICS = [
    Mosaic("RGGB"),
    Mosaic("GBRG", transmission=MIXED),
    Mosaic("RGBW"),
    Mosaic("RGB"),
    Mosaic("CYYM"),
    RANDOM,
]


def seen(mosaic, image):
    """The values behind the filters, divided by their sensitivity."""
    return mosaic.light(image) / mosaic.sensitivity[mosaic.full(*image.shape[:2])]


@pytest.mark.parametrize("mosaic", MOSAICS, ids=repr)
def test_a_uniform_color_is_exact(mosaic):
    image = np.broadcast_to([0.4, 0.3, 0.1], (24, 30, 3))
    np.testing.assert_allclose(
        demosaic(seen(mosaic, image), mosaic, "differences"), image, atol=1e-9
    )


@pytest.mark.parametrize("mosaic", [Mosaic("RGBW"), RANDOM], ids=repr)
def test_values_without_weight_do_not_count(mosaic):
    image = np.broadcast_to([0.4, 0.3, 0.1], (24, 30, 3))
    clear = mosaic.full(24, 30) == 3
    values = np.where(clear, 0.15, seen(mosaic, image))
    found = demosaic(values, mosaic, "differences", np.where(clear, 0.0, 5.0))
    np.testing.assert_allclose(found, image, atol=1e-5)
    assert np.abs(demosaic(values, mosaic, "differences") - image).mean() > 0.02


def test_equal_light_is_the_usual_weight():
    image = np.random.default_rng(0).random((24, 30, 3))
    mosaic = Mosaic("RGBW")
    values, places = seen(mosaic, image), mosaic.full(24, 30)
    usual = demosaic(values, mosaic, "differences")
    found = demosaic(values, mosaic, "differences", 0.2 * mosaic.sensitivity[places])
    np.testing.assert_allclose(found, usual, atol=1e-9)
    # Where nothing counts, the usual weights do.
    unknown = demosaic(values, mosaic, "differences", np.zeros((24, 30)))
    np.testing.assert_allclose(unknown, usual, atol=1e-9)


def test_the_local_mean_is_that_of_gaussian_weights():
    rng = np.random.default_rng(0)
    values, known = rng.random((9, 11)), rng.random((9, 11)) < 0.4
    sigma = 0.7 / np.sqrt(known.mean())
    y, x = np.indices(values.shape)
    radius = int(4 * sigma + 0.5)  # that of SciPy
    expected = np.zeros(values.shape)
    for row, column in np.ndindex(values.shape):
        weights = np.exp(-((y - row) ** 2 + (x - column) ** 2) / (2 * sigma**2)) * known
        weights[(abs(y - row) > radius) | (abs(x - column) > radius)] = 0
        expected[row, column] = (weights * values).sum() / weights.sum()
    np.testing.assert_allclose(local_mean(values, known, 0.7), expected, rtol=1e-9)


def test_pixels_far_from_known_ones_have_a_wider_mean():
    known = np.zeros((200, 200), bool)
    known[:100, :100] = True
    assert local_mean(np.full((200, 200), 3.0), known, 0.1)[-1, -1] == pytest.approx(3)


@pytest.mark.slow
def test_pixels_too_far_from_the_only_known_one_have_its_value():
    known = np.zeros((1, 6000), bool)
    known[0, 0] = True
    np.testing.assert_allclose(local_mean(np.full(known.shape, 3.0), known, 1.0), 3, rtol=1e-6)


def test_gray_details_have_no_color_at_the_pixels_of_the_densest_filter():
    gray = np.random.default_rng(0).random((24, 30))
    mosaic = Mosaic(np.where(np.arange(24 * 30).reshape(24, 30) % 8, 3, RANDOM.pattern), "RGBW")
    image = np.repeat(gray[..., None], 3, axis=2)
    found = demosaic(seen(mosaic, image), mosaic)
    clear = mosaic.pattern == 3
    error = np.abs(found.mean(axis=2) - gray)[clear]
    assert error.mean() < 0.1 * gray.std()


def test_the_import_of_a_package_does_not_change_how_numpy_prints(monkeypatch):
    def import_package(*_):
        np.set_printoptions(legacy="1.13")  # as the package does
        return SimpleNamespace(
            demosaicing_CFA_Bayer_Menon2007=lambda values, _: np.stack([values] * 3, axis=2)
        )

    monkeypatch.setattr(demosaicing, "import_extra", import_package)
    with np.printoptions():
        before = np.get_printoptions()
        assert demosaic(np.ones((8, 8)), Mosaic("RGGB")).shape == (8, 8, 3)
        assert np.get_printoptions() == before


@pytest.mark.slow  # the import of the package takes seconds
def test_menon_returns_what_its_package_returns():
    with np.printoptions():  # the package changes those of NumPy
        package = pytest.importorskip("colour_demosaicing")
    values = np.random.default_rng(0).random((20, 22))
    for order in ("RGGB", "BGGR", "GRBG", "GBRG"):
        expected = package.demosaicing_CFA_Bayer_Menon2007(values, order)
        np.testing.assert_allclose(demosaic(values, Mosaic(order)), expected)
        mixed = Mosaic(order, transmission=MIXED, white_balance=[2, 1, 3])
        matrix = np.array(MIXED) / np.sum(MIXED, axis=1, keepdims=True)
        colors = np.linalg.solve(matrix, expected[..., None])[..., 0] * [2, 1, 3]
        np.testing.assert_allclose(demosaic(values, mixed), colors, atol=1e-12)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "colour_demosaicing", None)
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[color\]'"):
        demosaic(np.zeros((8, 8)), Mosaic("RGGB"))


@pytest.mark.parametrize(
    ("mosaic", "method", "message"),
    [
        ("RGBW", "menon", "menon is for RGGB, BGGR, GRBG, and GBRG, got Mosaic\\('RGBW'\\)"),
        ("RGGB", "bilinear", "expected one of menon, differences, got 'bilinear'"),
    ],
)
def test_bad_methods_are_refused(mosaic, method, message):
    with pytest.raises(ValueError, match=message):
        demosaic(np.zeros((8, 8)), Mosaic(mosaic), method)


@pytest.mark.parametrize("method", ["differences", "menon"])
@pytest.mark.parametrize(("shape", "seen"), [((1, 1), "R"), ((1, 16), "RG"), ((5, 1), "RG")])
def test_a_part_without_all_colors_is_refused(method, shape, seen):
    with pytest.raises(ValueError, match=f"got {seen}; reconstruct a larger image"):
        demosaic(np.zeros(shape), Mosaic("RGGB"), method)
