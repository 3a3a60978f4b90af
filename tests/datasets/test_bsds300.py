import hashlib
import importlib

import numpy as np
import pytest
from PIL import Image

from jotlight import datasets

# The name in the package is that of the function.
bsds300 = importlib.import_module("jotlight.datasets.bsds300")


def photographs_in(folder, number=3, level=100):
    folder.mkdir(parents=True)
    for name in range(number):
        color = (level + name, 0, 255)
        Image.new("RGB", (6, 4), color).save(folder / f"{10 * name}.png")
    (folder / "Thumbs.db").write_bytes(b"of Windows")


OURS = ("bsds300", "test", "train")
BSDS300 = ("BSDS300/images", "test", "train")
BSDS500 = ("BSR/BSDS500/data/images", "val", "train")
MIRROR = ("BSDS500/data/images", "val", "train")


@pytest.mark.parametrize("layout", [OURS, BSDS300, BSDS500, MIRROR])
def test_bsds300_is_found_in_every_layout_and_from_every_folder_of_it(layout, tmp_path):
    inner, test, train = layout
    photographs_in(tmp_path / inner / test, 3, level=100)
    photographs_in(tmp_path / inner / train, 2, level=200)
    if test == "val":  # other photographs, in BSDS500 only
        photographs_in(tmp_path / inner / "test", 5, level=0)
    folders = [tmp_path]
    for part in inner.split("/"):
        folders.append(folders[-1] / part)
    for folder in folders:
        names, images = datasets.bsds300("test", folder)
        assert names == ["0.png", "10.png", "20.png"]
        for number, image in enumerate(images):
            luma = np.rint(0.299 * (100 + number) + 0.114 * 255)
            np.testing.assert_array_equal(image, np.full((4, 6), luma / 255, np.float32))
        assert len(datasets.bsds300("train", folder)[0]) == 2


def test_bsds300_reads_the_first_images_and_reports_progress(tmp_path):
    photographs_in(tmp_path / "bsds300/test")
    shares = []
    names, _ = datasets.bsds300("test", tmp_path, first=2, progress=shares.append)
    assert (names, shares) == (["0.png", "10.png"], [0.5, 1.0])


def test_folders_of_another_name_are_not_bsds300(tmp_path):
    photographs_in(tmp_path / "images/test")
    for folder in (tmp_path, tmp_path / "images"):
        with pytest.raises(FileNotFoundError, match=r"expected the test photographs of BSDS300 in"):
            datasets.bsds300("test", folder)


def test_the_error_without_bsds300_names_the_layouts(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        datasets.bsds300("test", tmp_path)
    for layout in ("bsds300/test", "BSDS300/images/test", "BSR/BSDS500/data/images/val", "pass"):
        assert layout in str(error.value)


def test_an_empty_folder_of_bsds300_is_an_error(tmp_path):
    (tmp_path / "bsds300/test").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"bsds300.test: expected images .* found none"):
        datasets.bsds300("test", tmp_path)


@pytest.mark.slow
def test_the_registry_matches_the_originals(data):
    lines = bsds300.REGISTRY.read_text().splitlines()
    registered = dict(line.split() for line in lines)
    assert len(registered) == len(lines) == 300
    found = {
        f"{split}/{path.name}": hashlib.sha256(path.read_bytes()).hexdigest()
        for split in ("train", "test")
        for path in (data / "bsds300" / split).glob("*.jpg")
    }
    assert registered == found


def test_the_real_bsds300_is_gray_and_in_order(data):
    names, images = datasets.bsds300("test", data, first=3)
    assert names == ["101085.jpg", "101087.jpg", "102061.jpg"]
    assert {image.shape for image in images} <= {(321, 481), (481, 321)}
    assert {image.dtype for image in images} == {np.dtype(np.float32)}
    assert all(0 <= image.min() < image.max() <= 1 for image in images)


# CIFAR-10
