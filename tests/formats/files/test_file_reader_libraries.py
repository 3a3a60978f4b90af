"""Captures that libraries read, and that change after they were opened."""

import os
import shutil

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from jotlight.formats.files.file_reader import FileReader

pytestmark = pytest.mark.slow

FRAMES = random_frames((6, 16, 24))
OTHER_FRAMES = ~FRAMES


def write_hdf5(path, frames, **options):
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("frames", data=frames, **options)


def write_chunks(path, frames):
    write_hdf5(path, frames, chunks=(2, 16, 24))


def write_matlab_7_3(path, frames):
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        file["OUTPUT"] = frames.swapaxes(1, 2).astype(np.uint8)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")


def write_matlab_5(path, frames):
    from scipy.io import savemat

    savemat(path, {"OUTPUT": np.moveaxis(frames, 0, 2).astype(np.uint8)})


def write_tiff(path, frames):
    import tifffile

    tifffile.imwrite(path, frames.view(np.uint8), photometric="minisblack")


def write_tiff_folder(path, frames):
    path.mkdir()
    for index, frame in enumerate(frames):
        write_tiff(path / f"{index}.tif", frame)


def write_png_folder(path, frames):
    from PIL import Image

    path.mkdir()
    for index, frame in enumerate(frames):
        Image.fromarray(frame).save(path / f"{index}.png")


FORMATS = {
    "hdf5": ("a.h5", write_hdf5, {}),
    "hdf5-isolated": ("a.h5", write_hdf5, {"isolate": True}),
    "hdf5-chunks": ("a.h5", write_chunks, {}),
    "hdf5-chunks-isolated": ("a.h5", write_chunks, {"isolate": True}),
    "matlab-7.3": ("a.mat", write_matlab_7_3, {}),
    "matlab-7.3-isolated": ("a.mat", write_matlab_7_3, {"isolate": True}),
    "matlab-5": ("a.mat", write_matlab_5, {}),
    "tiff": ("a.tif", write_tiff, {"unpacked": True}),
    "tiff-folder": ("a", write_tiff_folder, {"unpacked": True}),
    "png-folder": ("a", write_png_folder, {}),
}


def truncate(path, other):
    os.truncate(path, path.stat().st_size // 2)


def overwrite(path, other):
    with path.open("r+b") as file:
        file.write(other.read_bytes())
    os.utime(path, ns=(1, 1))


def replace(path, other):
    other.replace(path)


def delete(path, other):
    path.unlink()


def open_two(folder, format_):
    """Return an opened capture, its path, and a file of it and of another capture."""
    name, write, options = FORMATS[format_]
    path, other = folder / name, folder / "other" / name
    other.parent.mkdir()
    write(path, FRAMES)
    write(other, OTHER_FRAMES)
    bits = jl.open(path, **options)
    if path.is_dir():
        file = sorted(path.iterdir())[3]
        return bits, path, file, other / file.name
    return bits, path, path, other


@pytest.mark.parametrize("change", [truncate, overwrite, replace, delete])
@pytest.mark.parametrize("format_", FORMATS)
def test_a_capture_that_changed_after_it_was_opened_is_refused_by_name(tmp_path, format_, change):
    bits, _, file, other = open_two(tmp_path, format_)
    change(file, other)
    reason = "No such file|no file" if change is delete else "has changed"
    for read in (bits.to_array, bits.counts, lambda: jl.save(bits, tmp_path / "saved.npy")):
        with pytest.raises(OSError, match=reason) as info:
            read()
        assert str(file) in str(info.value)
    assert not (tmp_path / "saved.npy").exists()


@pytest.mark.parametrize("change", [truncate, overwrite, replace, delete])
@pytest.mark.parametrize("format_", FORMATS)
def test_a_capture_that_changed_after_a_part_was_read_is_refused(tmp_path, format_, change):
    bits, _, file, other = open_two(tmp_path, format_)
    np.testing.assert_array_equal(bits[:2].to_array(), FRAMES[:2])
    change(file, other)
    with pytest.raises(OSError, match=file.name):
        bits.to_array()


@pytest.mark.parametrize("format_", FORMATS)
def test_a_capture_that_changed_is_read_when_it_is_opened_again(tmp_path, format_):
    bits, path, _, other = open_two(tmp_path, format_)
    np.testing.assert_array_equal(bits.to_array(), FRAMES)
    if path.is_dir():
        shutil.rmtree(path)
        shutil.move(other.parent, path)
    else:
        overwrite(path, other)
    again = jl.open(path, **FORMATS[format_][2])
    np.testing.assert_array_equal(again.to_array(), OTHER_FRAMES)
    with pytest.raises(OSError, match="has changed"):
        bits.to_array()


def test_a_change_while_a_library_reads_is_an_error(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"frames")
    file = FileReader(path)
    with file.expect_unchanged():
        path.read_bytes()
    with pytest.raises(OSError, match=r"a\.bin: the file has changed"), file.expect_unchanged():
        path.write_bytes(b"other frames")
