import io

import numpy as np
import pytest
import tifffile
from PIL import Image

from jotlight.images.sets import read_image_set
from jotlight.training.photographs import PhotographPatches
from jotlight.training.url_photographs import UrlPhotographs

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def folder():
    """Return the URL of a folder of three photographs, and the photographs."""
    rng, fs, photographs = np.random.default_rng(0), fsspec.filesystem("memory"), []
    for number in range(3):
        values = rng.integers(0, 256, (40 + number, 50, 3), np.uint8)
        file = io.BytesIO()
        Image.fromarray(values).save(file, "PNG")
        fs.pipe(f"/patches/{number % 2}/{number}.png", file.getvalue())
        photographs.append(values)
    fs.pipe("/patches/readme.txt", b"text")
    yield "memory://patches", [photographs[0], photographs[2], photographs[1]]
    fs.rm("/patches", recursive=True)


@pytest.mark.parametrize("max_bytes", [1, 20_000, 1 << 30])
def test_patches_are_those_of_photographs_in_memory(folder, max_bytes):
    url, photographs = folder
    source = UrlPhotographs(url, max_side=32, max_bytes=max_bytes)
    expected = PhotographPatches(photographs)
    for seed in range(20):
        found = source.draw(np.random.default_rng(seed), 16)
        other = expected.draw(np.random.default_rng(seed), 16)
        np.testing.assert_array_equal(found.values, other.values)
        assert found.image_mean == other.image_mean


def test_a_changed_folder_has_another_fingerprint(folder):
    url, _ = folder
    before = UrlPhotographs(url).fingerprint()
    assert before == UrlPhotographs(url).fingerprint()
    assert before != UrlPhotographs(url, color=0.5).fingerprint()
    fsspec.filesystem("memory").pipe("/patches/0/0.png", b"shorter")
    assert before != UrlPhotographs(url).fingerprint()


def test_bad_folders_and_photographs(folder):
    url, _ = folder
    with pytest.raises(ValueError, match="got none"):
        UrlPhotographs("memory://empty")
    with pytest.raises(ValueError, match="color: expected a fraction"):
        UrlPhotographs(url, color=2)
    with pytest.raises(ValueError, match="pass a smaller max_side"):
        UrlPhotographs(url, max_side=64).draw(np.random.default_rng(0), 8)


def test_photographs_that_are_not_finite_are_refused():
    file = io.BytesIO()
    tifffile.imwrite(file, np.full((48, 48), np.nan, np.float32))
    fs = fsspec.filesystem("memory")
    fs.pipe("/nan/a.tif", file.getvalue())
    source = UrlPhotographs("memory://nan", max_side=32)
    with pytest.raises(ValueError, match=r"/nan/a\.tif: expected finite intensities, got"):
        source.draw(np.random.default_rng(0), 16)
    fs.rm("/nan", recursive=True)


def test_image_sets_are_read_from_urls(folder):
    url, photographs = folder
    names, images = read_image_set(url)
    assert len(names) == 3
    assert [image.shape for image in images] == [each.shape[:2] for each in photographs]
