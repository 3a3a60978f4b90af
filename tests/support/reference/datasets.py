"""Small copies of the data sets' layouts, made of photographs that come with scikit-image."""

from pathlib import Path

import numpy as np
from PIL import Image

import jotlight as jl

TEST = ("101085", "101087", "126007")


def make_data(folder: Path) -> Path:
    """BSDS300 with 8 training and 3 test images, CIFAR-10 with 96 and 40."""
    color = {name: jl.datasets.photograph(name) for name in ("astronaut", "coffee", "chelsea")}
    levels = {name: (255 * image).astype(np.uint8) for name, image in color.items()}
    for split, names in (("train", [str(n) for n in range(1, 9)]), ("test", TEST)):
        where = folder / "bsds300" / split
        where.mkdir(parents=True)
        for number, name in enumerate(names):
            image = levels[("astronaut", "coffee", "chelsea")[number % 3]]
            top = 10 * number + (60 if split == "test" else 0)
            Image.fromarray(image[top : top + 140, 100:300]).save(where / f"{name}.jpg", quality=95)
    camera = (255 * jl.datasets.photograph("camera")).astype(np.uint8)
    tiles = camera.reshape(16, 32, 16, 32).swapaxes(1, 2).reshape(-1, 32, 32)
    np.savez(
        folder / "cifar10_gray.npz",
        x_train=tiles[:96],
        x_test=tiles[96:136],
        train_lossless=np.ones(96, bool),
        test_lossless=np.ones(40, bool),
    )
    return folder
