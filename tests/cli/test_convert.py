"""`jotlight convert`, and what `info` and `reconstruct` do with captures."""

import itertools
import json
from importlib.util import find_spec

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.registry import WRITERS
from jotlight.formats.writing import choose_output_format, write_capture
from reference import formats as twin

BITS = [name for name, target in WRITERS.items() if target.bits]
COUNTS = [name for name, target in WRITERS.items() if target.counts]
NEEDS = {"hdf5": "h5py", "zarr": "zarr"}


def path_of(folder, name, stem="out"):
    endings = WRITERS[name].extensions
    return folder / (stem + (endings[0] if endings else ""))


def random(frames, height, width):
    return np.random.default_rng(0).random((frames, height, width)) < 0.3


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    """Five frames in every format that is written."""
    folder = tmp_path_factory.mktemp("captures")
    for name in BITS:
        if name in NEEDS and find_spec(NEEDS[name]) is None:
            continue
        bits = jl.Bits.from_array(random(5, 256 if name == "swissspad2" else 512, 512))
        write_capture(bits, path_of(folder, name, name), name)
    return folder


@pytest.mark.parametrize(("first", "second"), [*itertools.product(BITS, BITS)])
def test_bits_come_through_every_pair_of_formats(captures, tmp_path, first, second):
    for name in (first, second):
        pytest.importorskip(NEEDS.get(name, "numpy"))
    bits = jl.open(path_of(captures, first, first), format=first)
    cut = "swissspad2" in (first, second) and first != second
    if cut and WRITERS[second].extensions == (".bin",):
        with pytest.raises(ValueError, match="expected frames of"):
            write_capture(bits, path_of(tmp_path, second), second)
        assert files(tmp_path) == []
        return
    write_capture(bits, path_of(tmp_path, second), second)
    again = jl.open(path_of(tmp_path, second), format=second)
    expected = random(5, 256 if first == "swissspad2" else 512, 512)
    np.testing.assert_array_equal(again.to_array(), expected)


@pytest.mark.parametrize("name", [name for name in BITS if WRITERS[name].extensions != (".bin",)])
def test_the_true_width_is_kept(tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    array = random(3, 5, 13)
    write_capture(jl.Bits.from_array(array), path_of(tmp_path, name), name)
    np.testing.assert_array_equal(jl.open(path_of(tmp_path, name)).to_array(), array)


@pytest.mark.parametrize("name", [name for name in BITS if WRITERS[name].keeps_sensor])
def test_sensor_and_source_are_kept(tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    np.save(tmp_path / "cube.npy", twin.packed(random(3, 5, 16)))
    bits = jl.open(tmp_path / "cube.npy", frames=slice(1, 3))
    bits.sensor = jl.Sensor(frames=2, gain=4.0)
    write_capture(bits, path_of(tmp_path, name), name)
    again = jl.open(path_of(tmp_path, name))
    assert (again.sensor, again.provenance.origin) == (bits.sensor, bits.provenance)
    assert (again.provenance.format, again.provenance.name) == (name, path_of(tmp_path, name).name)


@pytest.mark.parametrize(("first", "second"), [*itertools.product(COUNTS, COUNTS)])
@pytest.mark.parametrize("most", [200, 60000])
def test_counts_come_through_every_pair_of_formats(tmp_path, first, second, most):
    for name in (first, second):
        pytest.importorskip(NEEDS.get(name, "numpy"))
    image = np.random.default_rng(0).integers(0, most, (6, 9), np.int32)
    write_capture(image, path_of(tmp_path, first, "a"), first)
    write_capture(jl.open(path_of(tmp_path, first, "a")), path_of(tmp_path, second, "b"), second)
    np.testing.assert_array_equal(jl.open(path_of(tmp_path, second, "b")), image)


@pytest.mark.parametrize("name", ["swissspad2", "swissspad2-full", "spad512s", "spad512s-sparse"])
def test_folders_have_files_as_the_camera_has_them(tmp_path, monkeypatch, name):
    from jotlight.formats import spad512s

    monkeypatch.setattr(spad512s, "FRAMES_PER_FILE", 10)
    height = 256 if name == "swissspad2" else 512
    frames = {"swissspad2": 512, "swissspad2-full": 256}.get(name, 10) + 2
    array = np.zeros((frames, height, 512), bool)
    array[np.arange(frames), np.arange(frames) % height, 7] = True
    write_capture(jl.Bits.from_array(array), tmp_path / "out", name)
    found = [file for file in files(tmp_path / "out") if file.endswith(".bin")]
    if name.startswith("swissspad2"):
        assert found == ["0/0/filename0.bin", "0/0/filename1.bin"]
        assert (tmp_path / "out" / found[0]).stat().st_size == 1 << 23
    else:
        assert found == ["RAW00000.bin", "RAW00001.bin"]
    bits = jl.open(tmp_path / "out", format=name)
    np.testing.assert_array_equal(bits.counts(), array.sum(0))
    np.testing.assert_array_equal(bits[-3:].to_array(), array[-3:])


def test_convert_prints_and_records_what_was_assumed(run, tmp_path):
    array = random(4, 256, 512)
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(array))
    words = ["--format", "swissspad2", "--frame-range", "1:3", "--rotate", 90, "--flip"]
    status, said = run("convert", "a.bin", "-o", "a.npy", *words, "horizontal")
    assert status == 0
    for expected in ("2 frames of 512 x 256", "least significant bit first", "rotated by 90"):
        assert expected in said
    told = json.loads((tmp_path / "a.json").read_text())
    assert (told["provenance"]["format"], told["provenance"]["name"]) == ("swissspad2", "a.bin")
    assert "frames 1:3 of 4" in told["provenance"]["notes"]
    bits = jl.open(tmp_path / "a.npy")
    np.testing.assert_array_equal(bits.to_array(), twin.oriented(array[1:3], 90, "horizontal"))
    status, said = run("info", "a.npy")
    assert status == 0
    assert "least significant bit first" in said


def test_convert_sums_bits_where_the_format_holds_counts(run, tmp_path):
    array = random(4, 6, 8)
    jl.save(jl.Bits.from_array(array), tmp_path / "a.npy")
    assert run("convert", "a.npy", "-o", "a.tif")[0] == 0
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), array.sum(0))


def test_unpacked_frames_are_asked_about(run, tmp_path):
    array = random(4, 6, 11)
    np.save(tmp_path / "a.npy", array.astype(np.uint8))
    for words in (["info", "a.npy"], ["reconstruct", "a.npy", "-o", "b.tif", "-m", "mle"]):
        status, said = run(*words)
        assert status == 1
        assert "--unpacked" in said
        assert run(*words, "--unpacked")[0] == 0
    assert run("convert", "a.npy", "-o", "c.npy", "--unpacked")[0] == 0
    np.testing.assert_array_equal(jl.open(tmp_path / "c.npy").to_array(), array)


def test_raw_captures_are_reconstructed_and_described(run, tmp_path):
    array = random(4, 256, 512)
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(array))
    status, said = run("info", "a.bin")
    assert status == 1
    assert "--format" in said
    status, said = run("info", "a.bin", "--format", "swissspad2", "--rotate", 90)
    assert status == 0
    for expected in ("512 x 256", "swissspad2", "least significant bit first", "rotated by 90"):
        assert expected in said
    words = ["--format", "swissspad2", "--frame-range", "1:", "--rotate", 270]
    status, said = run("reconstruct", "a.bin", "-o", "a.npy", "-m", "mle", *words)
    assert status == 0
    assert "half a count from saturation" in said
    assert "swissspad2: rotated by 270 degrees" in said
    expected = jl.mle(np.rot90(array[1:].sum(0), 3), jl.Sensor(frames=3, max_intensity=np.log(6)))
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected)


def test_folders_are_reconstructed_and_described(run, tmp_path):
    folder = tmp_path / "set"
    write_capture(jl.Bits.from_array(random(4, 6, 13)), folder, "visionsim")
    assert "6 x 13" in run("info", "set")[1]
    assert run("reconstruct", "set", "-o", "a.npy", "-m", "mle")[0] == 0
    before = files(folder)
    status, said = run("reconstruct", "set", "-o", "set/frames.npy", "-m", "mle")
    assert status == 1
    assert "which is read; choose another name" in said
    assert files(folder) == before


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["convert", "a.npy", "-o", "a.npy"], "another name"),
        (["convert", "a.npy", "-o", "b.bin"], "pass --to: swissspad2"),
        (["convert", "a.npy", "-o", "b"], "pass --to: visionsim, zarr"),
        (["convert", "a.npy", "-o", "b.xyz"], "implies no single format"),
        (["convert", "a.npy", "-o", "b.npy", "--to", "png"], "ends in .png for png"),
        (
            ["convert", "a.npy", "-o", "b.bin", "--to", "matlab"],
            "expected a name without extension, of a new folder, for matlab",
        ),
        (["convert", "a.npy", "-o", "b.bin", "--to", "mp4"], "--to: expected one of npy"),
        (["convert", "a.npy", "-o", "b.bin", "--to", "swissspad2"], "256 x 512"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range", "5"], "frame-range: expected A:B"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range", "1:9:0"], "frame-range"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range", "7:9"], "no frames"),
        (["convert", "a.npy", "-o", "b.npy", "--rotate", "45"], "multiple of 90"),
        (["convert", "a.npy", "-o", "c", "--to", "visionsim"], "it already exists"),
        (["convert", "none.npy", "-o", "b.npy"], "there is no file"),
        (["convert", "counts.tif", "-o", "b", "--to", "visionsim"], "which counts cannot become"),
        (["convert", "a.npy", "-o", "none/b.npy"], "there is no folder"),
        (["convert", "cut.npy.gz", "-o", "b.npy"], "damaged or truncated"),
        (["convert", "cut.npy.gz", "-o", "b", "--to", "matlab"], "damaged or truncated"),
        (["convert", "cut.npy.gz", "-o", "b.npy.gz"], "damaged or truncated"),
    ],
)
def test_what_cannot_be_converted_gets_one_line_and_leaves_nothing(run, tmp_path, words, expected):
    jl.save(jl.Bits.from_array(random(3, 5, 13)), "a.npy")
    write_capture(np.ones((4, 5), np.int32), tmp_path / "counts.tif", "tiff")
    write_capture(jl.Bits.from_array(random(400, 64, 64)), tmp_path / "cut.npy.gz", "npy.gz")
    content = (tmp_path / "cut.npy.gz").read_bytes()
    (tmp_path / "cut.npy.gz").write_bytes(content[: len(content) // 2])
    (tmp_path / "c").mkdir()
    before = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    status, said = run(*words)
    assert status == 1
    assert expected in said
    assert said.startswith("error: ")
    after = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    assert after == before


@pytest.mark.parametrize("name", BITS)
def test_an_interrupted_conversion_leaves_nothing(tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    from jotlight.sensing.frames import Frames

    def read(start, stop):
        if start > 0:
            raise KeyboardInterrupt
        return np.zeros((stop - start, height, 64), np.uint8)

    height = 256 if name == "swissspad2" else 512
    with pytest.raises(KeyboardInterrupt):
        write_capture(jl.Bits(Frames((2000, height, 64), read)), path_of(tmp_path, name), name)
    assert files(tmp_path) == []


def test_the_name_of_a_file_tells_its_format(tmp_path):
    told = {
        choose_output_format(path_of(tmp_path, name))
        for name, writer in WRITERS.items()
        if writer.extensions not in ((), (".bin",))
    }
    assert told == {name for name in WRITERS if WRITERS[name].extensions not in ((), (".bin",))}


@pytest.mark.parametrize("name", [name for name in BITS if WRITERS[name].keeps_sensor])
@pytest.mark.parametrize("maps", [("mask",), ("dark_counts", "efficiency", "mask")])
def test_the_maps_of_a_sensor_are_kept(tmp_path, name, maps):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    values = {
        "dark_counts": np.linspace(0, 0.1, 65).reshape(5, 13),
        "efficiency": np.linspace(0.5, 1, 65).reshape(5, 13),
        "mask": np.eye(5, 13, dtype=bool),
    }
    sensor = jl.Sensor(frames=3, **{each: values[each] for each in maps})
    bits = jl.Bits.from_array(random(3, 5, 13), sensor)
    write_capture(bits, path_of(tmp_path, name), name)
    again = jl.open(path_of(tmp_path, name))
    assert again.sensor == sensor
    np.testing.assert_array_equal(again.to_array(), bits.to_array())
    if name in ("hdf5", "zarr"):
        assert jl.open(path_of(tmp_path, name), key="bits").sensor == sensor
        map_ = jl.open(path_of(tmp_path, name), key="mask")
        np.testing.assert_array_equal(map_, values["mask"])


@pytest.mark.parametrize("name", ["tiff", "npz", "hdf5", "zarr"])
def test_counts_tell_out_of_how_many_bits_they_are(run, tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    array = random(40, 6, 8)
    jl.save(jl.Bits.from_array(array), tmp_path / "a.npy")
    first, second = path_of(tmp_path, name), path_of(tmp_path, "tiff", "again")
    assert run("convert", "a.npy", "-o", "t.tif")[0] == 0
    assert run("convert", "t.tif", "-o", first)[0] == 0
    assert run("convert", first, "-o", second)[0] == 0
    expected = jl.mle(array.sum(0), jl.Sensor(frames=40, max_intensity=np.log(80)))
    for path in (first, second):
        np.testing.assert_array_equal(jl.open(path), array.sum(0))
        status, said = run("reconstruct", path, "-o", "b.npy", "-m", "mle")
        assert status == 0, said
        assert "counts out of 40, as the file states" in said
        assert "npy" in said
        np.testing.assert_array_equal(np.load(tmp_path / "b.npy"), expected)
    assert "npy, a.npy" in run("info", second, "--counts")[1]
    reconstruct = ("reconstruct", first, "-o", "b.npy", "-m", "mle")
    for words, given in ((["--frames", 50], 50), (["--frames", 40, "--oversampling", 2], 160)):
        status, said = run(*reconstruct, *words)
        assert status == 1
        option = " and ".join(map(" ".join, zip(words[::2], map(str, words[1::2]), strict=True)))
        assert f"states counts of 40 trials, but {option} means {given}" in said
    for words in (["--frames", 40], ["--oversampling", 2], ["--frames", 10, "--oversampling", 2]):
        assert run(*reconstruct, *words)[0] == 0
        np.testing.assert_allclose(np.load(tmp_path / "b.npy"), expected, rtol=1e-6)


def test_a_label_of_counts_is_checked(tmp_path):
    counts = np.full((3, 4), 7, np.int32)
    write_capture(counts, tmp_path / "a.tif", "tiff", trials=6)
    with pytest.raises(ValueError, match="its label states counts out of 6, but one is 7"):
        jl.open(tmp_path / "a.tif")
    for wrong in (0, -1, 2**31, "6", 1.5):
        write_capture(counts, tmp_path / "a.tif", "tiff", trials=wrong)
        with pytest.raises(ValueError, match="label: expected"):
            jl.open(tmp_path / "a.tif")


def test_info_tells_the_format_of_the_file_and_what_it_was_converted_from(run, tmp_path):
    (tmp_path / "a.bin").write_bytes(twin.encode_half_array(random(2, 256, 512)))
    assert run("convert", "a.bin", "--format", "swissspad2", "-o", "b.npy.gz")[0] == 0
    assert run("convert", "b.npy.gz", "-o", "c.npy")[0] == 0
    status, said = run("info", "c.npy")
    assert status == 0
    lines = [" ".join(line.split()) for line in said.splitlines()]
    assert "format npy" in lines
    assert "from npy.gz, b.npy.gz" in lines
    assert "from swissspad2, a.bin" in lines


def test_a_sensor_that_has_no_place_is_left_out_and_said(tmp_path):
    name = "visionsim"
    sensor = jl.Sensor(frames=3, mask=np.eye(5, 13, dtype=bool))
    bits = jl.Bits.from_array(random(3, 5, 13), sensor)
    with pytest.warns(jl.JotlightWarning, match="no place for the sensor"):
        write_capture(bits, path_of(tmp_path, name), name)
    assert jl.open(path_of(tmp_path, name)).sensor is None


@pytest.mark.parametrize("name", [name for name in COUNTS if name not in BITS])
def test_counts_say_when_they_leave_out_more_of_a_sensor_than_its_frames(tmp_path, name):
    for told in ({"mask": np.eye(5, 13, dtype=bool)}, {"gain": 4.0}, {"threshold": 2}):
        bits = jl.Bits.from_array(random(3, 5, 13), jl.Sensor(frames=3, **told))
        with pytest.warns(jl.JotlightWarning, match="no place for the sensor, which is left out"):
            write_capture(bits, path_of(tmp_path, name), name)
    plain = jl.Bits.from_array(random(3, 5, 13), jl.Sensor(frames=3))
    write_capture(plain, path_of(tmp_path, name), name)


@pytest.mark.parametrize("name", ["visionsim", "matlab", "png"])
def test_bits_say_when_nothing_will_tell_how_they_were_turned(tmp_path, name):
    np.save(tmp_path / "cube.npy", twin.packed(random(3, 8, 16)))
    bits = jl.open(tmp_path / "cube.npy", rotate=90)
    with pytest.warns(jl.JotlightWarning, match="no place to record .* rotated by 90 degrees, so"):
        write_capture(bits, path_of(tmp_path, name), name)
    again = jl.open(tmp_path / "cube.npy", rotate=360)
    write_capture(again, path_of(tmp_path, name, "again"), name)


@pytest.mark.filterwarnings("default:.*no place to record")
@pytest.mark.parametrize("name", COUNTS)
def test_counts_say_when_nothing_will_tell_how_they_were_turned(run, tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    np.save(tmp_path / "counts.npy", np.arange(12).reshape(3, 4))
    status, said = run("convert", "counts.npy", "-o", path_of(tmp_path, name), "--rotate", 90)
    assert status == 0
    assert (f"{name} has no place to record" in said) == (name in ("npy", "npy.gz", "png"))
