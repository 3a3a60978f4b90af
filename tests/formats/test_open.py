import io
import json
import pickle
import zipfile

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.arrays import read_npy, read_npz
from jotlight.formats.cube import create_bits
from jotlight.formats.writing import write_capture


def random_bits(shape, sensor=None, seed=0):
    return jl.Bits.from_array(np.random.default_rng(seed).random(shape) < 0.5, sensor)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def edit(path, **changes):
    description = json.loads(path.read_text())
    path.write_text(json.dumps(description | changes))


@pytest.mark.parametrize("shape", [(3, 5, 16), (1, 1, 1), (2, 4, 13), (4, 3, 9, 3)])
def test_plain_numpy_reads_our_files(tmp_path, shape):
    bits = random_bits(shape)
    jl.save(bits, tmp_path / "cube.npy")
    packed = np.load(tmp_path / "cube.npy", allow_pickle=False)
    unpacked = np.unpackbits(packed, axis=2, count=shape[2])
    np.testing.assert_array_equal(unpacked, bits.to_array())


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("shape", [(3, 5, 16), (2, 6, 24, 3)])
def test_photon_cubes_of_others_are_read(tmp_path, shape, order):
    values = np.random.default_rng(1).random(shape) < 0.5
    np.save(tmp_path / "cube.npy", np.asarray(np.packbits(values, axis=2), order=order))
    bits = jl.open(tmp_path / "cube.npy")
    assert (bits.shape, bits.sensor) == (shape, None)
    np.testing.assert_array_equal(bits.to_array(), values)
    np.testing.assert_array_equal(bits.counts(1), values.sum(0))


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_every_version_of_npy_is_read(tmp_path, version):
    packed = np.arange(12, dtype=np.uint8).reshape(2, 3, 2)
    with (tmp_path / "cube.npy").open("wb") as file:
        np.lib.format.write_array(file, packed, version=version)
    np.testing.assert_array_equal(jl.open(tmp_path / "cube.npy").packed, packed)


def test_a_file_is_mapped_into_memory_and_not_read(tmp_path):
    jl.save(random_bits((2, 3, 16)), tmp_path / "cube.npy")
    bits = jl.open(tmp_path / "cube.npy")
    assert isinstance(bits.packed, np.memmap)
    assert not bits.packed.flags.writeable


@pytest.mark.parametrize("width", range(9, 17))
def test_the_true_width_is_kept(tmp_path, width):
    bits = random_bits((2, 3, width))
    jl.save(bits, tmp_path / "cube.npy")
    loaded = jl.open(tmp_path / "cube.npy")
    assert loaded.shape == (2, 3, width)
    np.testing.assert_array_equal(loaded.to_array(), bits.to_array())


def test_the_true_width_of_others_files_can_be_told(tmp_path):
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 2), np.uint8))
    assert jl.open(tmp_path / "cube.npy", width=11).shape == (2, 3, 11)
    with pytest.raises(ValueError, match=r"cube\.npy: width: expected 9 to 16"):
        jl.open(tmp_path / "cube.npy", width=17)


def test_a_width_against_the_description_is_refused(tmp_path):
    jl.save(random_bits((2, 3, 13)), tmp_path / "cube.npy")
    assert jl.open(tmp_path / "cube.npy", width=13).width == 13
    with pytest.raises(ValueError, match="states a width of 13, not 12"):
        jl.open(tmp_path / "cube.npy", width=12)


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(oversampling=2, frames=3, gain=7.5, threshold=2, kernel="cubic", efficiency=0.3),
        jl.Sensor(frames=3, dark_counts=0.25, max_intensity=4.0),
        jl.Sensor(frames=3, mask=np.eye(4, 10, dtype=bool)),
        jl.Sensor(oversampling=2, frames=3, dark_counts=np.linspace(0, 1, 40).reshape(4, 10)),
        jl.Sensor(
            frames=3, dark_counts=np.linspace(0, 1, 40).reshape(4, 10), mask=np.eye(4, 10) > 0
        ),
    ],
    ids=repr,
)
def test_the_sensor_and_its_maps_are_kept(tmp_path, sensor):
    jl.save(random_bits((3, 4, 10), sensor), tmp_path / "cube.npy")
    assert jl.open(tmp_path / "cube.npy").sensor == sensor
    assert set(names(tmp_path)) == {
        "cube.npy",
        "cube.json",
        *(f"cube.{name}.npy" for name in sensor.maps()),
    }


def test_files_may_be_moved_together(tmp_path):
    sensor = jl.Sensor(mask=np.eye(4, dtype=bool))
    (tmp_path / "a").mkdir()
    jl.save(random_bits((1, 4, 4), sensor), tmp_path / "a" / "cube.npy")
    (tmp_path / "a").rename(tmp_path / "b")
    assert jl.open(tmp_path / "b" / "cube.npy").sensor == sensor


def test_bits_can_be_saved_over_the_file_they_are_mapped_from(tmp_path):
    bits = random_bits((3, 4, 10))
    jl.save(bits, tmp_path / "cube.npy")
    jl.save(jl.open(tmp_path / "cube.npy")[:2], tmp_path / "cube.npy")
    np.testing.assert_array_equal(jl.open(tmp_path / "cube.npy").to_array(), bits.to_array()[:2])


def test_names_with_dots_do_not_meet(tmp_path):
    first, second = random_bits((1, 2, 9), seed=1), random_bits((1, 2, 10), seed=2)
    jl.save(first, tmp_path / "run.1.npy")
    jl.save(second, tmp_path / "run.2.npy")
    assert jl.open(tmp_path / "run.1.npy").width == 9
    assert jl.open(tmp_path / "run.2.npy").width == 10


def npy(array, **options):
    file = io.BytesIO()
    np.save(file, array, **options)
    return file.getvalue()


CUBE = npy(np.zeros((4, 8, 2), np.uint8))
OBJECTS = npy(np.array([[[{}]]], object), allow_pickle=True)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (CUBE[:-1], "size does not fit its header"),
        (CUBE[:100], "damaged"),
        (CUBE[:8], "damaged"),
        (CUBE[:6], "damaged"),
        (b"", "does not begin like one"),
        (b"PK" + CUBE, "does not begin like one"),
        (pickle.dumps(np.zeros(3)), "does not begin like one"),
        (OBJECTS, "Python objects, which can run code and are never read"),
        (b"\x93NUMPY\x09\x00" + CUBE[8:], "damaged"),
        (CUBE.replace(b"'|u1'", b"'|zz'"), "damaged"),
        (CUBE.replace(b"(4, 8, 2)", b"(4, 8,-2)"), "damaged"),
        (CUBE.replace(b"(4, 8, 2), ", b"(9**9**9), "), "damaged"),
        (CUBE.replace(b"(4, 8, 2), }", b"(1" + b"0" * 20 + b",),}")[:128], "damaged"),
        (npy(np.zeros((4, 8, 2))), "got float64"),
        (npy(np.zeros((8, 0), np.uint8)), r"shape \(8, 0\)"),
        (npy(np.zeros((4, 0, 2), np.uint8)), r"cube\.npy: "),
    ],
)
def test_damaged_and_foreign_files_are_refused_by_name(tmp_path, content, message):
    path = tmp_path / "cube.npy"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        jl.open(path)
    assert str(path) in str(caught.value)


def test_nothing_in_a_pickle_is_run(tmp_path):
    class Mine:
        def __reduce__(self):
            return (tmp_path.joinpath("ran").write_text, ("x",))

    objects = np.empty((1, 1, 1), object)
    objects[0, 0, 0] = Mine()
    (tmp_path / "cube.npy").write_bytes(npy(objects, allow_pickle=True))
    with pytest.raises(ValueError, match="Python objects"):
        jl.open(tmp_path / "cube.npy")
    assert names(tmp_path) == ["cube.npy"]


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("missing.npy", FileNotFoundError, "there is no file"),
        ("folder.npy", IsADirectoryError, "got a folder"),
        ("cube.bin", FileNotFoundError, "there is no file"),
    ],
)
def test_paths_that_are_no_cube_are_refused(tmp_path, name, error, message):
    (tmp_path / "folder.npy").mkdir()
    with pytest.raises(error, match=message):
        jl.open(tmp_path / name)


def test_read_npy_takes_any_numbers(tmp_path):
    values = np.linspace(0, 1, 5)
    np.save(tmp_path / "map.npy", values)
    np.testing.assert_array_equal(read_npy(tmp_path / "map.npy"), values)


OVERLONG = '{"format": "jotlight bits", "version": 1, "width": 16}' + " " * 2**20
FOREIGN = ["{}", "[]", "nonsense", '{"format": "visionsim", "w": 8}', "[" * 100_000, OVERLONG]


@pytest.mark.parametrize("text", FOREIGN, ids=lambda text: text[:12])
def test_a_foreign_description_is_not_used_and_that_is_said(tmp_path, text):
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 2), np.uint8))
    (tmp_path / "cube.json").write_text(text)
    with pytest.warns(jl.JotlightWarning, match=r"cube\.json does not describe bits") as caught:
        bits = jl.open(tmp_path / "cube.npy")
    assert (bits.shape, bits.sensor) == ((2, 3, 16), None)
    assert caught[0].filename == __file__


@pytest.mark.parametrize("text", FOREIGN, ids=lambda text: text[:12])
def test_a_foreign_description_is_never_overwritten(tmp_path, text):
    (tmp_path / "cube.json").write_text(text)
    with pytest.raises(FileExistsError, match="jotlight did not write it"):
        jl.save(random_bits((1, 2, 8)), tmp_path / "cube.npy")
    assert names(tmp_path) == ["cube.json"]
    assert (tmp_path / "cube.json").read_text() == text


def test_our_own_files_are_overwritten(tmp_path):
    jl.save(random_bits((1, 2, 9)), tmp_path / "cube.npy")
    bits = random_bits((2, 3, 17), jl.Sensor(frames=2))
    jl.save(bits, tmp_path / "cube.npy")
    loaded = jl.open(tmp_path / "cube.npy")
    np.testing.assert_array_equal(loaded.to_array(), bits.to_array())
    assert loaded.sensor == bits.sensor


def test_a_cube_and_its_compressed_twin_have_a_description_each(tmp_path):
    first = random_bits((3, 4, 13), jl.Sensor(frames=3, mask=np.eye(4, 13, dtype=bool)), seed=1)
    second = random_bits((2, 5, 10), jl.Sensor(frames=2, dark_counts=np.ones((5, 10))), seed=2)
    jl.save(first, tmp_path / "cube.npy")
    write_capture(second, tmp_path / "cube.npy.gz", "npy.gz")
    jl.save(first, tmp_path / "cube.npy")
    for name, bits in (("cube.npy", first), ("cube.npy.gz", second)):
        again = jl.open(tmp_path / name)
        np.testing.assert_array_equal(again.to_array(), bits.to_array())
        assert again.sensor == bits.sensor
    assert {"cube.json", "cube.npy.gz.json", "cube.npy.gz.dark_counts.npy"} < set(names(tmp_path))
    (tmp_path / "cube.npy.gz.json").unlink()
    assert jl.open(tmp_path / "cube.npy.gz").sensor is None  # the other description is the .npy's


def test_a_description_of_another_cube_is_refused(tmp_path):
    jl.save(random_bits((2, 3, 13)), tmp_path / "cube.npy")
    np.save(tmp_path / "cube.npy", np.zeros((4, 3, 2), np.uint8))
    with pytest.raises(ValueError, match=r"cube\.json: describes a cube of shape \[2, 3, 2\]"):
        jl.open(tmp_path / "cube.npy")
    (tmp_path / "cube.json").unlink()
    assert jl.open(tmp_path / "cube.npy").shape == (4, 3, 16)


def test_what_a_file_was_converted_from_is_remembered_for_some_steps(tmp_path):
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 2), np.uint8))
    for _ in range(40):
        jl.save(jl.open(tmp_path / "cube.npy"), tmp_path / "cube.npy")
    provenance = jl.open(tmp_path / "cube.npy").provenance
    assert provenance.describe()[0] == "npy: converted from cube.npy"
    assert 10 < len(provenance.describe()) < 20


@pytest.fixture
def saved(tmp_path):
    """Bits whose sensor has a map, in a folder beside a map that they must not reach."""
    np.save(tmp_path / "mask.npy", np.zeros((4, 4), bool))
    folder = tmp_path / "folder"
    folder.mkdir()
    sensor = jl.Sensor(mask=np.eye(4, dtype=bool))
    jl.save(random_bits((1, 4, 4), sensor), folder / "cube.npy")
    return folder / "cube.npy"


@pytest.mark.parametrize(
    "name", ["../mask.npy", "{parent}/mask.npy", "", ".", "..", "./cube.mask.npy", 3, None, ["a"]]
)
def test_a_description_cannot_point_out_of_its_folder(saved, name):
    if isinstance(name, str):
        name = name.format(parent=saved.parent.parent)
    edit(saved.with_suffix(".json"), maps={"mask": name})
    with pytest.raises(ValueError, match="the name of a file in the same folder"):
        jl.open(saved)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 2}, "expected version 1 and a width, got version 2"),
        ({"version": None}, "expected version 1"),
        ({"width": "4"}, "width '4'"),
        ({"width": 0}, "width 0"),
        ({"width": 9}, "width: expected 1 to 8"),
        ({"width": None}, "width None"),
        ({"shape": [1, 4, 2]}, r"cube of shape \[1, 4, 2\]"),
        ({"shape": "1, 4, 1"}, "cube of shape 1, 4, 1"),
        ({"sensor": []}, "sensor: expected an object"),
        ({"sensor": {"colour": 1}}, "unknown parameters colour"),
        ({"sensor": {"frames": 2}}, "expected the sensor's 2 frames"),
        ({"sensor": {"gain": -1}}, "gain: expected"),
        ({"sensor": {"oversampling": 3}, "maps": {}}, "multiples of the oversampling"),
        ({"maps": {"gain": "cube.mask.npy"}}, "sensor|gain"),
        ({"maps": {"mask": "cube.npy"}}, "mask: expected"),
        ({"maps": [1]}, r"cube\.json: "),
        ({"maps": 5}, r"cube\.json: "),
    ],
)
def test_a_damaged_description_is_refused_by_name(saved, changes, message):
    edit(saved.with_suffix(".json"), **changes)
    with pytest.raises(ValueError, match=message) as caught:
        jl.open(saved)
    assert str(saved.with_suffix("")) in str(caught.value)


def test_a_missing_map_is_missed_by_name(saved):
    saved.with_suffix(".mask.npy").unlink()
    with pytest.raises(FileNotFoundError, match=r"cube\.mask\.npy"):
        jl.open(saved)


def test_a_map_of_objects_is_refused(saved):
    saved.with_suffix(".mask.npy").write_bytes(OBJECTS)
    with pytest.raises(ValueError, match="Python objects"):
        jl.open(saved)


@pytest.mark.parametrize("before", [False, True])
def test_an_interrupted_save_leaves_what_was_there(tmp_path, before):
    old = random_bits((1, 2, 9))
    if before:
        jl.save(old, tmp_path / "cube.npy")
    there = names(tmp_path)

    def interrupted():
        sensor = jl.Sensor(mask=np.eye(4, 8, dtype=bool))
        with create_bits(tmp_path / "cube.npy", (1, 4, 1), 8, sensor) as packed:
            packed[...] = 255
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names(tmp_path) == there
    if before:
        np.testing.assert_array_equal(jl.open(tmp_path / "cube.npy").to_array(), old.to_array())


def test_a_place_that_cannot_be_written_to_leaves_nothing(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        jl.save(random_bits((1, 2, 8)), tmp_path / "missing" / "cube.npy")
    with pytest.raises(ValueError, match="implies no single format"):
        jl.save(random_bits((1, 2, 8)), tmp_path / "cube.bin")
    (tmp_path / "cube.mask.npy").mkdir()
    with pytest.raises(IsADirectoryError):
        jl.save(
            random_bits((1, 2, 8), jl.Sensor(mask=np.zeros((2, 8), bool))), tmp_path / "cube.npy"
        )
    assert names(tmp_path) == ["cube.mask.npy"]


def test_a_map_that_is_a_strangers_is_never_overwritten(tmp_path):
    stranger = tmp_path / "capture.mask.npy"
    np.save(stranger, np.arange(3))
    sensor = jl.Sensor(mask=np.zeros((4, 8), bool))
    bits = jl.Bits.from_array(np.ones((1, 4, 8), bool), sensor)
    with pytest.raises(FileExistsError, match=r"capture\.mask\.npy stands where"):
        jl.save(bits, tmp_path / "capture.npy")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture.mask.npy"]
    assert np.load(stranger).tolist() == [0, 1, 2]
    stranger.unlink()
    jl.save(bits, tmp_path / "capture.npy")
    jl.save(bits, tmp_path / "capture.npy")
    assert jl.open(tmp_path / "capture.npy").sensor == sensor


@pytest.mark.parametrize("maps", ['{"kernel": "x.npy"}', "[1]", '"mask"', "7"])
def test_maps_of_another_kind_are_refused(tmp_path, maps):
    jl.save(jl.Bits.from_array(np.ones((1, 2, 8), bool), jl.Sensor()), tmp_path / "cube.npy")
    beside = tmp_path / "cube.json"
    beside.write_text(beside.read_text().replace('"maps": {}', f'"maps": {maps}'))
    with pytest.raises(ValueError, match=r"cube\.json: maps: expected files for dark"):
        jl.open(tmp_path / "cube.npy")


def test_a_header_of_nothing_but_brackets_is_damaged(tmp_path):
    path = tmp_path / "deep.npy"
    header = b"(" * 5000 + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(ValueError, match=r"deep\.npy"):
        jl.open(path)


def test_a_member_that_claims_more_than_it_holds_takes_no_memory(tmp_path):
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 100000)}\n"
    member = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(80)
    with zipfile.ZipFile(tmp_path / "lie.npz", "w") as archive:
        archive.writestr("a.npy", member)
    with pytest.raises(ValueError, match="its header claims 800000000000 bytes, but there are"):
        read_npz(tmp_path / "lie.npz")
    np.savez(tmp_path / "good.npz", a=np.arange(6).reshape(2, 3))
    assert read_npz(tmp_path / "good.npz").tolist() == [[0, 1, 2], [3, 4, 5]]
