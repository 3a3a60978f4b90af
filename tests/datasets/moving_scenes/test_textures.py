import numpy as np

from jotlight.datasets.moving_scenes.textures import Texture


def test_a_texture_is_a_blurred_photograph():
    # A cosine keeps its shape, and the blur reduces its amplitude by a known factor.
    columns = np.indices((96, 64))[1]
    frequency = 2 * np.pi * 4 / 63
    texture = Texture(0.5 + 0.4 * np.cos(frequency * columns))
    place = np.linspace(5, 55, 400)
    expected = 0.5 + 0.4 * np.exp(-((0.6 * frequency) ** 2) / 2) * np.cos(frequency * place)
    np.testing.assert_allclose(texture(np.full(400, 40.3), place), expected, atol=1e-3)


def test_a_texture_is_mirrored_and_stays_in_range():
    image = (np.indices((20, 30)).sum(axis=0) % 7 < 3).astype(float)
    texture = Texture(image)
    rows, columns = np.meshgrid(np.linspace(0, 19, 50), np.linspace(0, 29, 60))
    values = texture(rows, columns)
    np.testing.assert_allclose(texture(-rows, columns), values, atol=1e-6)
    np.testing.assert_allclose(texture(rows, 58 - columns), values, atol=1e-6)
    assert values.min() >= 0
    assert values.max() <= 1


def test_a_bright_photograph_keeps_its_intensities():
    image = 3 * (np.indices((20, 30)).sum(axis=0) % 7 < 3)
    rows, columns = np.indices((20, 30), float)
    values = Texture(image.astype(float))(rows, columns)
    assert 2 < values.max() <= 3
