"""Examples of photographs, of sets of images, and of the archive of CIFAR-10."""

import functools
import io
import pickle
import tarfile
from unittest import mock

import numpy as np
from PIL import Image

from examples.captures import COUNTS, palette, tiff, written
from examples.encodings import INSIDE_GZIP, INSIDE_NPZ, PNG_CHECKSUMS, array_makers
from examples.reader import Reader
from jotlight.datasets import cifar10_files
from jotlight.datasets.moving_scenes.tables import read_poses
from jotlight.images.io import image_writer, read_image
from jotlight.images.sets import read_image_set

RNG = np.random.default_rng(0)


def _with_pillow(*formats):
    image = Image.fromarray(COUNTS.astype(np.uint8))
    return tuple(functools.partial(image.save, format=format_) for format_ in formats)


def _png_of_depth_16(path):
    image_writer(path, depth=16)(path, RNG.random((6, 9, 3)))


def _cifar_archive(path):
    with tarfile.open(path, "w:gz") as archive:
        member = tarfile.TarInfo("cifar-10-batches-bin/test_batch.bin")
        member.size = 3073
        archive.addfile(member, io.BytesIO(bytes(3073)))


def _cifar_pickle(path):
    path.mkdir()
    levels = np.arange(3072).astype(np.uint8).reshape(1, 3072)
    batch = {"data": levels.tobytes(), "labels": [3], "filenames": ["a.png" * 8]}
    (path / "test_batch").write_bytes(pickle.dumps(batch))


def _cifar_binary(path):
    path.mkdir()
    (path / "test_batch.bin").write_bytes(bytes(3073))


def _cifar_gray(path):
    path.mkdir()
    images = np.ones((2, 32, 32), np.uint8)
    np.savez(path / "cifar10_gray.npz", x_test=images, test_lossless=np.array([True, False]))


def _read_cifar(path):
    # The original files have 10,000 images, which would take a second to read.
    with mock.patch.object(cifar10_files, "RECORDS", 1):
        return list(cifar10_files.read_folder(path, "test", ["test_batch"]))


def _poses(path):
    path.write_text("# rows, columns, degrees, zoom\n0, 0, 0, 1\n1.5, -2e-3, 0.1, 1.01\n")


IMAGES = {
    "poses": Reader("a.csv", read_poses, (_poses,)),
    "image": Reader("a.jpg", read_image, _with_pillow("JPEG", "PPM", "BMP", "WEBP", "GIF")),
    "image-png": Reader(
        "a.png",
        functools.partial(read_image, gray=True),
        (_png_of_depth_16, palette, *written("png", COUNTS)),
        **PNG_CHECKSUMS,
    ),
    "image-tiff": Reader(
        "a.tif",
        functools.partial(read_image, gray=True),
        (
            tiff(np.ones((5, 9, 3), np.float32), photometric="rgb"),
            tiff(np.ones((5, 9), np.uint8), compression="zlib"),
        ),
    ),
    "image-set": Reader("a.npy", read_image_set, array_makers(RNG.random((2, 5, 9), np.float32))),
    "image-set-npz": Reader(
        "a.npz",
        read_image_set,
        (functools.partial(np.savez, a=np.full((2, 5, 9), 200, np.uint8)),),
        **INSIDE_NPZ,
    ),
    "cifar-pickle": Reader("a", _read_cifar, (_cifar_pickle,), file="a/test_batch"),
    "cifar-binary": Reader("a", _read_cifar, (_cifar_binary,), file="a/test_batch.bin"),
    "cifar-gray": Reader("a", _read_cifar, (_cifar_gray,), file="a/cifar10_gray.npz"),
    "cifar-archive": Reader(
        "a.tar.gz",
        lambda path: list(cifar10_files.read_archive(path, ["test_batch"])),
        (_cifar_archive,),
        **INSIDE_GZIP,
    ),
}
"""Readers of images, by a name of their own."""
