"""npy.gz, npz, HDF5, zarr, MATLAB, visionsim."""

import gzip
import io
import json
import sys
import warnings

import numpy as np
import pytest
import tifffile

import jotlight as jl
from reference import formats as twin


def random(shape, seed=0):
    return np.random.default_rng(seed).random(shape) < 0.4


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


CUBE = npy(np.zeros((4, 8, 2), np.uint8))
COUNTS = np.random.default_rng(0).integers(0, 300, (5, 6, 7), np.uint16)


@pytest.mark.parametrize("shape", [(9, 5, 13), (4, 5, 16, 3)])
def test_a_compressed_cube_is_read_from_front_to_back_and_back_again(tmp_path, shape):
    array = random(shape)
    (tmp_path / "cube.npy.gz").write_bytes(gzip.compress(npy(twin.packed(array))))
    bits = jl.open(tmp_path / "cube.npy.gz", width=shape[2])
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits[2:4].to_array(), array[2:4])
    np.testing.assert_array_equal(bits[1:].counts(1), array[1:].sum(0))
    assert bits.provenance.format == "npy.gz"


def test_a_compressed_cube_has_a_description_too(tmp_path):
    array = random((3, 4, 10))
    jl.save(jl.Bits.from_array(array, jl.Sensor(frames=3)), tmp_path / "cube.npy")
    content = (tmp_path / "cube.npy").read_bytes()
    (tmp_path / "cube.npy").unlink()
    (tmp_path / "cube.npy.gz").write_bytes(gzip.compress(content))
    bits = jl.open(tmp_path / "cube.npy.gz")
    assert (bits.shape, bits.sensor) == ((3, 4, 10), jl.Sensor(frames=3))


def zipped(content):
    """Always the same bytes: gzip writes the time otherwise."""
    return gzip.compress(content, mtime=0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (zipped(CUBE)[:-20], "damaged or truncated|ends before"),
        (zipped(CUBE[:-1]), "ends before the 4 frames"),
        (zipped(b"text"), "does not begin like one"),
        (zipped(npy(np.zeros((4, 8, 2), np.uint8, order="F"))), "Fortran"),
        (b"\x1f\x8b\x08\x00rubbish", "damaged"),
        (b"\x1f\x8b", "damaged"),
        (
            zipped(CUBE.replace(b"(4, 8, 2), }            ", b"(4000000000000, 8, 2), }")),
            "more than a file of",
        ),
    ],
    ids=["cut", "short", "text", "fortran", "rubbish", "header", "huge"],
)  # fmt: skip
def test_damaged_compressed_cubes_are_refused(tmp_path, content, message):
    (tmp_path / "cube.npy.gz").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "cube.npy.gz").to_array()


@pytest.mark.parametrize("white", [1, 255])
@pytest.mark.parametrize("shape", [(9, 5, 13), (4, 5, 16, 3)])
@pytest.mark.parametrize("ending", ["npy", "npy.gz", "npz", "h5", "zarr", "tif"])
def test_unpacked_frames_are_bits_when_told(tmp_path, white, shape, ending):
    array = random(shape)
    path, levels = tmp_path / f"a.{ending}", array.astype(np.uint8) * white
    if ending == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["a"] = levels
    elif ending == "zarr":
        zarr = pytest.importorskip("zarr")
        zarr.open_array(str(path), mode="w", shape=shape, dtype=np.uint8)[...] = levels
    elif ending == "tif":
        tifffile.imwrite(path, levels, photometric="rgb" if len(shape) == 4 else "minisblack")
    elif ending == "npz":
        np.savez(path, a=levels)
    else:
        path.write_bytes(gzip.compress(npy(levels)) if ending == "npy.gz" else npy(levels))
    bits = jl.open(path, unpacked=True)
    assert isinstance(bits, jl.Bits)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(jl.open(path, unpacked=True, rotate=180)[1:].counts(1),
                                  array[1:, ::-1, ::-1].sum(0))  # fmt: skip
    if ending in ("npy", "npy.gz", "h5", "zarr"):
        with pytest.raises(ValueError, match=f"nothing but 0 and {white}, .*--unpacked"):
            jl.open(path, counts=False)
        assert jl.open(path, counts=False, unpacked=False).shape[2] == 8 * shape[2]


def test_what_looks_packed_is_not_asked_about(tmp_path):
    dark = np.zeros((50, 6, 4), np.uint8)
    dark[:, 2, 1] = 1  # a hot jot, the last of its byte
    for cube in (dark, dark * 0, dark * 0 + 255, np.packbits(random((5, 6, 32)), axis=2)):
        np.save(tmp_path / "a.npy", cube)
        np.testing.assert_array_equal(jl.open(tmp_path / "a.npy").packed, cube)
    jl.save(jl.Bits(np.tile(np.uint8([0, 1]), (2, 9, 9))), tmp_path / "a.npy")
    assert jl.open(tmp_path / "a.npy").shape == (2, 9, 144)


def test_frames_that_begin_dark_are_looked_at_further_on(tmp_path):
    light = np.zeros((3 << 8, 64, 64), np.uint8)
    light[384, :2, :8] = 1
    np.save(tmp_path / "a.npy", light)
    with pytest.raises(ValueError, match=r"nothing but 0 and 1, .*--unpacked"):
        jl.open(tmp_path / "a.npy")
    light[-1, 5, 5] = 2
    light[384, :2, 2:] = 0
    light[-1, :2, :8] = 1
    np.save(tmp_path / "a.npy", light)
    assert jl.open(tmp_path / "a.npy").shape == (768, 64, 512)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"counts": True}, r"counts: with unpacked each .*\(--counts, --unpacked\)"),
        ({"format": "spad512s"}, "unpacked: is for bits in arrays"),
    ],
)
def test_unpacked_is_for_bits_in_arrays(tmp_path, options, message):
    np.save(tmp_path / "a.npy", np.ones((2, 3, 4), np.uint8))
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path / "a.npy", unpacked=True, **options)
    np.save(tmp_path / "a.npy", np.full((2, 3, 4), 7, np.uint8))
    with pytest.raises(ValueError, match="expected bits, 0 and 1 only, got 7 to 7"):
        jl.open(tmp_path / "a.npy", unpacked=True).counts(1)


def test_bool_is_bits_and_other_numbers_are_counts(tmp_path):
    array = random((3, 5, 11))
    np.save(tmp_path / "a.npy", array)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy").to_array(), array)
    np.savez(tmp_path / "a.npz", array)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npz").to_array(), array)
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npz", counts=True, frames=slice(0, 3)),
                                  array.sum(0))  # fmt: skip
    np.save(tmp_path / "a.npy", COUNTS[0])
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npy"), COUNTS[0])
    np.save(tmp_path / "a.npy", COUNTS.astype(np.uint8))
    counts = jl.open(tmp_path / "a.npy", counts=True, frames=slice(0, 2))
    np.testing.assert_array_equal(counts, COUNTS.astype(np.uint8)[:2].sum(0, dtype=int))
    assert jl.open(tmp_path / "a.npy").shape == (5, 6, 56)


def test_a_stack_of_counts_is_summed_and_that_is_said(tmp_path):
    np.savez(tmp_path / "a.npz", a=COUNTS, b=COUNTS[0])
    with pytest.warns(jl.JotlightWarning, match="the sum of its 5 images"):
        counts = jl.open(tmp_path / "a.npz", key="a")
    assert counts.dtype == np.int32
    np.testing.assert_array_equal(counts, COUNTS.sum(0))
    part = jl.open(tmp_path / "a.npz", key="a", frames=slice(1, 3), rotate=90)
    np.testing.assert_array_equal(part, np.rot90(COUNTS[1:3].sum(0)))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.npz", key="b"), COUNTS[0])
    with pytest.raises(ValueError, match=r"--key.*a, b"):
        jl.open(tmp_path / "a.npz")


def test_counts_that_cannot_be_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[-1, 2]]))
    with pytest.raises(ValueError, match="counts from 0"):
        jl.open(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.array([[[2**31 - 1] * 5]] * 2))
    with pytest.raises(ValueError, match="the sum of its counts"):
        jl.open(tmp_path / "a.npy", frames=slice(None))
    np.save(tmp_path / "a.npy", np.array([[0, 255], [510, 0]]))
    with pytest.warns(jl.JotlightWarning, match="multiples of 255"):
        jl.open(tmp_path / "a.npy")


def transforms(folder, frames, **told):
    folder.mkdir(exist_ok=True)
    (folder / "transforms.json").write_text(json.dumps({"frames": frames, **told}))
    return folder


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dim", [1, 2])
def test_visionsim_keeps_the_true_sizes(tmp_path, dim, channels):
    array = random((4, 13, 21, channels))
    folder = transforms(
        tmp_path / "set", [{}] * 4, w=21, h=13, c=channels, bitpack=True, bitpack_dim=dim,
        file_path="frames.npy",
    )  # fmt: skip
    np.save(folder / "frames.npy", np.packbits(array, axis=dim))
    expected = array if channels == 3 else array[..., 0]
    for path in (folder, folder / "transforms.json"):
        np.testing.assert_array_equal(jl.open(path).to_array(), expected)


def test_visionsim_with_many_files_and_offsets(tmp_path):
    array = random((6, 5, 12))
    frames = [
        {"file_path": f"{index // 4:04}.npy", "bitpack_dim": 2, "offset": index % 4}
        for index in range(6)
    ]
    folder = transforms(tmp_path / "set", frames, w=12, h=5, c=1)
    np.save(folder / "0000.npy", np.packbits(array[:4, ..., None], axis=2))
    np.save(folder / "0001.npy", np.packbits(array[4:, ..., None], axis=2))
    np.testing.assert_array_equal(jl.open(folder).to_array(), array)
    transforms(folder, frames[::-1], w=12, h=5, c=1)
    np.testing.assert_array_equal(jl.open(folder).to_array(), array[::-1])


def test_visionsim_may_have_its_frames_in_a_folder_below(tmp_path):
    array = random((6, 5, 12))
    frames = [
        {"file_path": f"frames/{index // 4:04}.npy", "bitpack_dim": 2, "offset": index % 4}
        for index in range(6)
    ]
    folder = transforms(tmp_path / "set", frames, w=12, h=5, c=1)
    (folder / "frames").mkdir()
    np.save(folder / "frames" / "0000.npy", np.packbits(array[:4, ..., None], axis=2))
    np.save(folder / "frames" / "0001.npy", np.packbits(array[4:, ..., None], axis=2))
    np.testing.assert_array_equal(jl.open(folder).to_array(), array)
    # Neither a link to a file elsewhere is followed, nor one to a folder, nor one in a circle.
    (folder / "frames").rename(tmp_path / "frames")
    for target in (tmp_path / "frames", folder / "frames"):
        (folder / "frames").symlink_to(target)
        with pytest.raises(ValueError, match="file in the same folder or below"):
            jl.open(folder)
        (folder / "frames").unlink()
    (folder / "frames").mkdir()
    (folder / "frames" / "0000.npy").symlink_to(tmp_path / "frames" / "0000.npy")
    with pytest.raises(ValueError, match="file in the same folder or below"):
        jl.open(folder)


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ({"file_path": "../out.npy"}, "a file in the same folder"),
        ({"file_path": "/etc/passwd"}, "a file in the same folder"),
        ({"file_path": 7}, "a file in the same folder"),
        ({"file_path": "b/../../out.npy"}, "a file in the same folder"),
        ({"w": 99}, "w, c: tell of frames"),
        ({"w": "12"}, "expected whole numbers"),
        ({"h": -5}, "expected whole numbers"),
        ({"h": 10**30}, "tell of frames"),
        ({"c": 3}, "tell of frames"),
        ({"bitpack_dim": 3}, "bitpack_dim: expected 1 or 2"),
        ({"frames": []}, "none of it 0"),
        ({"frames": 7}, "list of frames"),
    ],
)
def test_hostile_descriptions_are_refused(tmp_path, told, message):
    np.save(tmp_path / "out.npy", np.zeros((2, 5, 2), np.uint8))
    good = {"w": 12, "h": 5, "c": 1, "bitpack": True, "bitpack_dim": 2, "file_path": "a.npy"}
    folder = transforms(tmp_path / "set", **{"frames": [{}, {}], **good, **told})
    np.save(folder / "a.npy", np.zeros((2, 5, 2), np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        with pytest.raises(ValueError, match=message):
            jl.open(folder)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, '{"frames": [3]}', "\xff"])
def test_what_is_no_description_is_refused(tmp_path, text):
    (tmp_path / "transforms.json").write_bytes(text.encode("latin1"))
    with pytest.raises(ValueError, match=r"transforms\.json"):
        jl.open(tmp_path)


def test_parts_of_matlab_are_read_in_natural_order(tmp_path):
    from scipy.io import savemat

    array = random((23, 5, 7))
    for number, part in enumerate(np.array_split(array, 11)):
        name = tmp_path / f"part_{number + 1}.mat"
        savemat(name, {"OUTPUT": np.moveaxis(part, 0, 2).astype([np.uint8, float][number % 2])})
    bits = jl.open(tmp_path)
    np.testing.assert_array_equal(bits.to_array(), array)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    (tmp_path / "info.json").write_text('{"no_parts": 11, "no_frames": 20}')
    assert len(jl.open(tmp_path)) == 20
    (tmp_path / "info.json").write_text('{"no_parts": 12, "no_frames": 23}')
    with pytest.warns(jl.JotlightWarning, match="states 12 parts, but there are 11"):
        assert len(jl.open(tmp_path)) == 23


def test_variables_of_matlab_are_chosen_by_name(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"x": COUNTS[0], "text": "words", "y": np.ones((2, 3), bool)})
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat", key="x", counts=True), COUNTS[0])
    assert jl.open(tmp_path / "a.mat", key="y").shape == (1, 2, 3)
    with pytest.raises(ValueError, match=r"--key\): x, y"):
        jl.open(tmp_path / "a.mat")
    with pytest.raises(ValueError, match="0 and 1 only"):
        jl.open(tmp_path / "a.mat", key="x").counts()
    (tmp_path / "a.mat").write_bytes((tmp_path / "a.mat").read_bytes()[:150])
    with pytest.raises(ValueError, match=r"a\.mat"):
        jl.open(tmp_path / "a.mat", key="x").counts()


def test_matlab_7_3_is_hdf5_with_the_sizes_in_reverse(tmp_path):
    h5py = pytest.importorskip("h5py")
    array = random((4, 5, 7))
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        file["OUTPUT"] = array.swapaxes(1, 2).astype(np.uint8)
    with (tmp_path / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    np.testing.assert_array_equal(jl.open(tmp_path / "a.mat").to_array(), array)


def test_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    array = random((4, 5, 16))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/counts"] = COUNTS
        file["bool"] = array
        file["cube"] = twin.packed(array)
        file["out"] = h5py.ExternalLink("other.h5", "x")
    counts = jl.open(tmp_path / "a.h5", key="a/counts", frames=slice(0, 3))
    np.testing.assert_array_equal(counts, COUNTS[:3].sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.h5", key="bool").to_array(), array)
    bits = jl.open(tmp_path / "a.h5", key="cube", counts=False, width=15)
    np.testing.assert_array_equal(bits.to_array(), array[..., :15])
    for key in (None, "out", "none"):
        with pytest.raises(ValueError, match=r"--key.*a/counts, bool, cube"):
            jl.open(tmp_path / "a.h5", key=key)


@pytest.mark.parametrize("told", ["{}", 3])
def test_an_attribute_of_hdf5_that_is_not_read_is_said(tmp_path, told):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = COUNTS[0]
        file["a"].attrs["jotlight"] = told  # a str is of variable length
    with pytest.warns(jl.JotlightWarning, match="jotlight of /a is no text of fixed length"):
        counts = jl.open(tmp_path / "a.h5")
    np.testing.assert_array_equal(counts, COUNTS[0])


def test_an_hdf5_file_cannot_point_to_other_files_or_to_more_than_it_holds(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret").write_bytes(bytes(64))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (2, 4, 8), "u1", external=[(str(tmp_path / "secret"), 0, 64)])
    with pytest.raises(ValueError, match="in other files"):
        jl.open(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (10**9, 512, 64), "u1", chunks=(1, 512, 64))
    with pytest.raises(ValueError, match="more than a file of"):
        jl.open(tmp_path / "a.h5")


def test_zarr(tmp_path):
    zarr = pytest.importorskip("zarr")
    array = random((4, 5, 16))
    group = zarr.open_group(str(tmp_path / "a.zarr"), mode="w")
    for name, values in {"counts": COUNTS, "bool": array}.items():
        group.create_array(name, shape=values.shape, dtype=values.dtype)[...] = values
    counts = jl.open(tmp_path / "a.zarr", key="counts", frames=slice(0, 3))
    np.testing.assert_array_equal(counts, COUNTS[:3].sum(0))
    np.testing.assert_array_equal(jl.open(tmp_path / "a.zarr", key="bool").to_array(), array)
    with pytest.raises(ValueError, match=r"--key.*bool, counts"):
        jl.open(tmp_path / "a.zarr")


@pytest.mark.parametrize("zarr_format", [2, 3])
def test_no_codec_of_zarr_runs_code(tmp_path, zarr_format):
    zarr = pytest.importorskip("zarr")
    path = tmp_path / "a.zarr"
    zarr.open_array(str(path), mode="w", shape=(2, 3), dtype="i4", zarr_format=zarr_format)
    described = path / ("zarr.json" if zarr_format == 3 else ".zarray")
    told = json.loads(described.read_text())
    if zarr_format == 3:
        told["codecs"].append({"name": "numcodecs.pickle", "configuration": {}})
    else:
        told["filters"] = [{"id": "pickle", "protocol": 5}]
    described.write_text(json.dumps(told))
    with pytest.raises(ValueError, match="well-known"):
        jl.open(path)


def test_missing_packages_are_named_with_the_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setitem(sys.modules, "zarr", None)
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / ".zarray").write_text("{}")
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[hdf5\]'"):
        jl.open(tmp_path / "a.h5")
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[zarr\]'"):
        jl.open(tmp_path / "a")
