"""Each format at a URL: the content is that of the file, and a few frames need few bytes."""

import functools

import h5py
import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.io import savemat

import jotlight as jl
from jotlight.formats.reading import open_capture
from servers import http_server

pytest.importorskip("fsspec")

# aiohttp issues warnings of its own.
pytestmark = pytest.mark.filterwarnings("ignore")

RNG = np.random.default_rng(0)
CUBE = RNG.integers(0, 256, (2000, 256, 32), np.uint8)
COUNTS = RNG.integers(0, 60_000, (40, 400, 300)).astype(np.uint16)


@functools.cache
def dark(frames=300):
    """Return frames in which few bits are ones."""
    return np.random.default_rng(1).random((frames, 512, 512), np.float32) < 1e-3


def write_npy(folder):
    np.save(folder / "cube.npy", CUBE)


def write_described_counts(folder):
    sensor = jl.Sensor(frames=40, bit_depth=12)
    jl.save(jl.Readings(COUNTS % 4096, sensor), folder / "readings.npy")


def write_npz(folder):
    np.savez(folder / "stored.npz", first=COUNTS[::-1], second=COUNTS)


def write_compressed_npz(folder):
    np.savez_compressed(folder / "compressed.npz", first=COUNTS, second=COUNTS[:5])


def write_hdf5(folder):
    jl.save(jl.Bits(CUBE, 256), folder / "cube.h5")


def write_contiguous_hdf5(folder):
    with h5py.File(folder / "plain.h5", "w") as file:
        file["counts"] = COUNTS


def write_matlab_7_3(folder):
    with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
        file["OUTPUT"] = np.unpackbits(CUBE[:100], axis=2)
    with (folder / "new.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


def write_matlab(folder):
    content = {"OUTPUT": np.moveaxis(COUNTS[:4], 0, 2), "other": COUNTS}
    savemat(folder / "old.mat", content, do_compression=True)


def write_matlab_parts(folder):
    jl.save(jl.Bits(CUBE[:1280, :64], 256), folder / "parts", format="matlab")


def write_tiff(folder):
    tifffile.imwrite(folder / "stack.tif", COUNTS, photometric="minisblack")


def write_compressed_tiff(folder):
    tifffile.imwrite(folder / "zip.tif", COUNTS, photometric="minisblack", compression="zlib")


def write_tiff_readings(folder):
    sensor = jl.Sensor(frames=40, bit_depth=12)
    jl.save(jl.Readings(COUNTS % 4096, sensor), folder / "readings.tif")


def write_pngs(folder):
    (folder / "png").mkdir()
    for index, image in enumerate(COUNTS[:12]):
        Image.fromarray(image).save(folder / "png" / f"{index}.png")


def write_bit_pngs(folder):
    (folder / "bits").mkdir()
    for index in range(60):
        frame = RNG.random((700, 1000)) < 0.5
        Image.fromarray(frame).save(folder / "bits" / f"{index}.png")


def write_zarr(folder):
    jl.save(jl.Bits(CUBE, 256), folder / "cube.zarr")


def write_visionsim(folder):
    jl.save(jl.Bits(CUBE, 256), folder / "visionsim", format="visionsim")


def write_raw(folder):
    jl.save(jl.Bits.from_array(dark()[:, :256]), folder / "raw.bin", format="swissspad2")
    (folder / "raw.bin").rename(folder / "raw.dat")


def write_raw_folder(folder):
    jl.save(jl.Bits.from_array(np.tile(dark()[:, :256], (6, 1, 1))), folder / "raw",
            format="swissspad2")  # fmt: skip


def write_full_folder(folder):
    jl.save(
        jl.Bits.from_array(np.tile(dark(), (3, 1, 1))), folder / "full", format="swissspad2-full"
    )


def write_spad512s(folder):
    jl.save(jl.Bits.from_array(dark()), folder / "dense.bin", format="spad512s")


def write_sparse(folder):
    jl.save(jl.Bits.from_array(dark(60)), folder / "sparse.bin", format="spad512s-sparse")


BITS = {"counts": False}
# The name, the maker, the options, the frames to read, and the largest fraction of the bytes that
# may be served for opening and for these frames.
CASES = [
    ("cube.npy", write_npy, BITS, 10, 0.1),
    ("readings.npy", write_described_counts, {}, 2, 0.1),
    ("stored.npz", write_npz, {"key": "second"}, 2, 0.1),
    ("compressed.npz", write_compressed_npz, {"key": "second"}, 2, 0.15),
    ("cube.h5", write_hdf5, {}, 10, 0.15),
    ("cube.h5", write_hdf5, {"isolate": True}, 10, 0.15),
    ("plain.h5", write_contiguous_hdf5, {}, 2, 0.1),
    ("plain.h5", write_contiguous_hdf5, {"isolate": True}, 2, 0.1),
    ("new.mat", write_matlab_7_3, {}, 5, 0.1),
    ("old.mat", write_matlab, {"counts": True}, 4, 0.15),
    ("parts/", write_matlab_parts, {}, 10, 0.5),
    ("stack.tif", write_tiff, {}, 2, 0.15),
    ("zip.tif", write_compressed_tiff, {}, 2, 0.2),
    ("readings.tif", write_tiff_readings, {}, 2, 0.15),
    ("bits/", write_bit_pngs, {}, 3, 0.9),
    ("cube.zarr", write_zarr, {}, 10, 0.6),
    ("visionsim/", write_visionsim, {}, 10, 0.1),
    ("raw.dat", write_raw, {"format": "swissspad2"}, 10, 0.1),
    ("raw/", write_raw_folder, {"format": "swissspad2"}, 10, 0.1),
    ("full/", write_full_folder, {"format": "swissspad2-full"}, 10, 0.1),
    ("dense.bin", write_spad512s, {}, 3, 0.2),
]


def frames_of(capture):
    return capture.packed if isinstance(capture, jl.Bits) else capture.images


def served_bytes(server, folder):
    """Return the bytes that a server has sent, without lists of folders."""
    total = 0
    for path, size in server.requests:
        file = folder / path.lstrip("/")
        total += size if size is not None else file.stat().st_size if file.is_file() else 0
    return total


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "write", "options", "number", "fraction"),
    CASES,
    ids=[f"{name} {options}" for name, _, options, _, _ in CASES],
)
def test_a_few_frames_at_a_url_need_few_bytes(tmp_path, name, write, options, number, fraction):
    write(tmp_path)
    expected = np.asarray(frames_of(open_capture(tmp_path / name, **options)))
    files = [each for each in tmp_path.rglob("*") if each.is_file()]
    with http_server(tmp_path) as server:
        capture = open_capture(f"{server.url}/{name}", **options)
        middle = len(expected) // 2
        first = middle if number <= middle else 0
        part = frames_of(capture)[first : first + number, ...]
        np.testing.assert_array_equal(part, expected[first : first + number])
        share = served_bytes(server, tmp_path) / sum(each.stat().st_size for each in files)
        assert share <= fraction
        np.testing.assert_array_equal(np.asarray(frames_of(capture)), expected)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "write", "options"),
    [
        ("png/", write_pngs, {}),
        ("compressed.npz", write_compressed_npz, {"key": "first"}),
        ("sparse.bin", write_sparse, {"format": "spad512s-sparse"}),
    ],
)
def test_other_files_are_served_at_most_twice(tmp_path, name, write, options):
    write(tmp_path)
    expected = np.asarray(frames_of(open_capture(tmp_path / name, **options)))
    size = sum(each.stat().st_size for each in tmp_path.rglob("*") if each.is_file())
    with http_server(tmp_path) as server:
        capture = open_capture(f"{server.url}/{name}", **options)
        np.testing.assert_array_equal(np.asarray(frames_of(capture)), expected)
        assert served_bytes(server, tmp_path) < 2.5 * size


def test_a_png_of_a_folder_is_read_with_its_frame(tmp_path):
    write_pngs(tmp_path)
    with http_server(tmp_path) as server:
        capture = open_capture(f"{server.url}/png/")
        server.requests.clear()
        np.testing.assert_array_equal(capture.images[3:4, ...][0], COUNTS[3])
        assert {path for path, _ in server.requests} <= {"/png/3.png"}


@pytest.mark.parametrize(
    ("name", "write", "options"),
    [
        ("plain.h5", write_contiguous_hdf5, {}),
        ("stored.npz", write_npz, {"key": "first"}),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in [
                ("plain.h5", write_contiguous_hdf5, {"isolate": True}),
                ("zip.tif", write_compressed_tiff, {}),
                ("old.mat", write_matlab, {"counts": True}),
                ("cube.zarr", write_zarr, {}),
            ]
        ),
    ],
)
def test_a_server_that_fails_later_is_not_taken_for_damage(tmp_path, name, write, options):
    write(tmp_path)
    with http_server(tmp_path) as server:
        capture = open_capture(f"{server.url}/{name}", **options)
    with pytest.raises(OSError, match=r"http://.*cannot be read"):
        np.asarray(frames_of(capture))


def test_conversions_compare_the_checksums_of_files_at_urls(tmp_path):
    write_tiff_readings(tmp_path)
    with (tmp_path / "readings.tif").open("r+b") as file:
        file.seek(100_000)
        file.write(b"damage")
    with http_server(tmp_path) as server:
        readings = jl.open(f"{server.url}/readings.tif")
        with pytest.raises(ValueError, match="is damaged or was changed"):
            jl.save(readings, tmp_path / "copy.npy")
