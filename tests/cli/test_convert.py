"""`jotlight convert`, and what `info` and `reconstruct` do with captures."""

import json
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from conversions import COUNTS, NEEDS, files, path_for, random_frames
from jotlight.formats.writing import write_capture
from reference import formats
from servers import http_server


def test_convert_prints_and_records_its_assumptions(run, tmp_path):
    array = random_frames(4, 256, 512)
    (tmp_path / "a.bin").write_bytes(formats.encode_half_array(array))
    arguments = ["--format", "swissspad2", "--frame-range", "1:3", "--rotate", 90, "--flip"]
    status, output = run("convert", "a.bin", "-o", "a.npy", *arguments, "horizontal")
    assert status == 0
    for expected in ("2 frames of 512 x 256", "least significant bit first", "rotated by 90"):
        assert expected in output
    record = json.loads((tmp_path / "a.json").read_text())
    assert (record["provenance"]["format"], record["provenance"]["name"]) == ("swissspad2", "a.bin")
    assert "frames 1:3 of 4" in record["provenance"]["notes"]
    bits = jl.open(tmp_path / "a.npy")
    np.testing.assert_array_equal(bits.to_array(), formats.oriented(array[1:3], 90, "horizontal"))
    status, output = run("info", "a.npy")
    assert status == 0
    assert "least significant bit first" in output


def test_convert_sums_bits_where_the_format_holds_counts(run, tmp_path):
    array = random_frames(4, 6, 8)
    jl.save(jl.Bits.from_array(array), tmp_path / "a.npy")
    assert run("convert", "a.npy", "-o", "a.tif")[0] == 0
    np.testing.assert_array_equal(jl.open(tmp_path / "a.tif"), array.sum(0))


@pytest.mark.parametrize("name", ["b.npy", "b.tif", "b.h5", "b.zarr"])
def test_images_of_counts_are_summed_only_on_request(run, tmp_path, name):
    stack = np.arange(60).reshape(3, 4, 5)
    np.save("a.npy", stack)
    status, output = run("convert", "a.npy", "-o", name)
    assert status == 1
    assert "a.npy: holds 3 images of counts, and no format to write has place" in output
    assert not Path(name).exists()
    status, output = run("convert", "a.npy", "-o", name, "--sum")
    assert status == 0
    assert "the sum of a stack of 3 images of counts" in output
    np.testing.assert_array_equal(jl.open(name), stack.sum(0))
    assert "the sum of a stack of 3 images" in str(jl.formats.open_capture(name).provenance.origin)
    assert run("convert", "a.npy", "-o", "c.npy", "--frame-range", "1:2")[0] == 0
    np.testing.assert_array_equal(jl.open("c.npy"), stack[1])


def test_the_sum_of_other_captures_is_refused(run, tmp_path):
    jl.save(jl.Bits.from_array(random_frames(4, 6, 8)), tmp_path / "a.npy")
    np.save("counts.npy", np.ones((4, 5), int))
    for data in ("a.npy", "counts.npy"):
        status, output = run("convert", data, "-o", "b.tif", "--sum")
        assert status == 1
        assert f"sum: {data} is no stack of images of counts; leave it out" in output
    status, output = run("convert", "*.npy", "-o", "{name}.tif", "--sum")
    assert status == 1
    assert "sum: is for one stack of images of counts; name one capture" in output


def test_a_capture_at_a_url_is_converted(run, tmp_path):
    array = random_frames(4, 6, 8)
    jl.save(jl.Bits.from_array(array), tmp_path / "a.npy")
    with http_server(tmp_path) as server:
        assert run("convert", f"{server.url}/a.npy", "-o", "b.npy")[0] == 0
    np.testing.assert_array_equal(jl.open(tmp_path / "b.npy").to_array(), array)
    assert json.loads((tmp_path / "b.npy.run.json").read_text())["run"]["capture"] == "a.npy"


def test_unpacked_frames_need_the_option_unpacked(run, tmp_path):
    array = random_frames(4, 6, 11)
    np.save(tmp_path / "a.npy", array.astype(np.uint8))
    for arguments in (["info", "a.npy"], ["reconstruct", "a.npy", "-o", "b.tif", "-m", "mle"]):
        status, output = run(*arguments)
        assert status == 1
        assert "--unpacked" in output
        assert run(*arguments, "--unpacked")[0] == 0
    assert run("convert", "a.npy", "-o", "c.npy", "--unpacked")[0] == 0
    np.testing.assert_array_equal(jl.open(tmp_path / "c.npy").to_array(), array)


def test_raw_captures_are_reconstructed_and_described(run, tmp_path):
    array = random_frames(4, 256, 512)
    (tmp_path / "a.bin").write_bytes(formats.encode_half_array(array))
    status, output = run("info", "a.bin")
    assert status == 1
    assert "--format" in output
    status, output = run("info", "a.bin", "--format", "swissspad2", "--rotate", 90)
    assert status == 0
    for expected in ("512 x 256", "swissspad2", "least significant bit first", "rotated by 90"):
        assert expected in output
    arguments = ["--format", "swissspad2", "--frame-range", "1:", "--rotate", 270]
    status, output = run("reconstruct", "a.bin", "-o", "a.npy", "-m", "mle", *arguments)
    assert status == 0
    assert "half a count from saturation" in output
    assert "swissspad2: rotated by 270 degrees" in output
    expected = jl.mle(np.rot90(array[1:].sum(0), 3), jl.Sensor(frames=3, max_intensity=np.log(6)))
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected)


def test_folders_are_reconstructed_and_described(run, tmp_path):
    folder = tmp_path / "set"
    write_capture(jl.Bits.from_array(random_frames(4, 6, 13)), folder, "visionsim")
    assert "6 x 13" in run("info", "set")[1]
    assert run("reconstruct", "set", "-o", "a.npy", "-m", "mle")[0] == 0
    before = files(folder)
    status, output = run("reconstruct", "set", "-o", "set/frames.npy", "-m", "mle")
    assert status == 1
    assert "which is read; choose another name" in output
    assert files(folder) == before


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["convert", "a.npy", "-o", "a.npy"], "another name"),
        (["convert", "a.npy", "-o", "b.bin"], "pass --to: swissspad2"),
        (["convert", "a.npy", "-o", "b"], "pass --to: visionsim, zarr"),
        (["convert", "a.npy", "-o", "b.bin"], "implies no single format; pass --to: swissspad2, "),
        (
            ["convert", "a.npy", "-o", "b.xyz"],
            "b.xyz: captures are not written with the ending",
        ),
        (["convert", "a.npy", "-o", "b.xyz", "--to", "png"], "choose one of .npy, "),
        (["convert", "a.npy", "-o", "b.npy", "--to", "png"], "ends in .png for png"),
        (
            ["convert", "a.npy", "-o", "b.bin", "--to", "matlab"],
            "expected a name without extension, of a new folder, for matlab",
        ),
        (["convert", "a.npy", "-o", "b.bin", "--to", "mp4"], "--to: expected one of npy"),
        (["convert", "a.npy", "-o", "b.bin", "--to", "swissspad2"], "256 x 512"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range", "5"], "frame-range: expected A:B"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range", "1:9:0"], "a step of 1 or more, got"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range=-5:"], "whole numbers from 0 upward"),
        (["convert", "a.npy", "-o", "b.npy", "--frame-range", "7:9"], "no frames"),
        (["convert", "a.npy", "-o", "b.npy", "--rotate", "45"], "multiple of 90"),
        (["convert", "a.npy", "-o", "c", "--to", "visionsim"], "this folder already exists"),
        (
            ["convert", "a.npy", "-o", "c"],
            "it is a folder; name a file in it, such as c/capture.npy",
        ),
        (["convert", "none.npy", "-o", "b.npy"], "there is no file"),
        (["convert", "counts.tif", "-o", "b", "--to", "visionsim"], "which counts cannot become"),
        (["convert", "a.npy", "-o", "none/b.npy"], "there is no folder"),
        (["convert", "cut.npy.gz", "-o", "b.npy"], "cut.npy.gz: is damaged"),
        (["convert", "cut.npy.gz", "-o", "b", "--to", "matlab"], "cut.npy.gz: is damaged"),
        (["convert", "cut.npy.gz", "-o", "b.npy.gz"], "cut.npy.gz: is damaged"),
    ],
)
def test_an_impossible_conversion_gets_one_line_and_leaves_no_files(
    run, tmp_path, arguments, expected
):
    jl.save(jl.Bits.from_array(random_frames(3, 5, 13)), "a.npy")
    write_capture(np.ones((4, 5), np.int32), tmp_path / "counts.tif", "tiff")
    write_capture(jl.Bits.from_array(random_frames(400, 64, 64)), tmp_path / "cut.npy.gz", "npy.gz")
    content = (tmp_path / "cut.npy.gz").read_bytes()
    (tmp_path / "cut.npy.gz").write_bytes(content[: len(content) // 2])
    (tmp_path / "c").mkdir()
    before = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    status, output = run(*arguments)
    assert status == 1
    assert expected in output
    assert output.startswith("error: ")
    after = {path: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    assert after == before


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tiff", "npz", "hdf5", "zarr"])
def test_files_of_counts_state_their_number_of_trials(run, tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    array = random_frames(40, 6, 8)
    jl.save(jl.Bits.from_array(array), tmp_path / "a.npy")
    first, second = path_for(tmp_path, name), path_for(tmp_path, "tiff", "again")
    assert run("convert", "a.npy", "-o", "t.tif")[0] == 0
    assert run("convert", "t.tif", "-o", first)[0] == 0
    assert run("convert", first, "-o", second)[0] == 0
    expected = jl.mle(array.sum(0), jl.Sensor(frames=40, max_intensity=np.log(80)))
    for path in (first, second):
        np.testing.assert_array_equal(jl.open(path), array.sum(0))
        status, output = run("reconstruct", path, "-o", "b.npy", "-m", "mle")
        assert status == 0, output
        assert "counts out of 40, as the file states" in output
        assert "npy" in output
        np.testing.assert_array_equal(np.load(tmp_path / "b.npy"), expected)
    assert "converted from a.npy" in run("info", second, "--counts")[1]
    reconstruct = ("reconstruct", first, "-o", "b.npy", "-m", "mle")
    for arguments, trials in ((["--frames", 50], 50), (["--frames", 40, "--oversampling", 2], 160)):
        status, output = run(*reconstruct, *arguments)
        assert status == 1
        option = " and ".join(
            map(" ".join, zip(arguments[::2], map(str, arguments[1::2]), strict=True))
        )
        assert f"states counts of 40 trials, but {option} means {trials}" in output
    for arguments in (
        ["--frames", 40],
        ["--oversampling", 2],
        ["--frames", 10, "--oversampling", 2],
    ):
        assert run(*reconstruct, *arguments)[0] == 0
        np.testing.assert_allclose(np.load(tmp_path / "b.npy"), expected, rtol=1e-6)


def test_info_shows_the_format_and_the_history_of_conversions(run, tmp_path):
    (tmp_path / "a.bin").write_bytes(formats.encode_half_array(random_frames(2, 256, 512)))
    assert run("convert", "a.bin", "--format", "swissspad2", "-o", "b.npy.gz")[0] == 0
    assert run("convert", "b.npy.gz", "-o", "c.npy")[0] == 0
    status, output = run("info", "c.npy")
    assert status == 0
    lines = [" ".join(line.split()) for line in output.splitlines()]
    assert "format npy" in lines
    assert "provenance npy: converted from b.npy.gz" in lines
    assert "npy.gz: converted from a.bin" in lines


@pytest.mark.filterwarnings("default:.*no place to record")
@pytest.mark.parametrize("name", COUNTS)
def test_writing_counts_warns_when_the_orientation_is_lost(run, tmp_path, name):
    pytest.importorskip(NEEDS.get(name, "numpy"))
    np.save(tmp_path / "counts.npy", np.arange(12).reshape(3, 4))
    status, output = run("convert", "counts.npy", "-o", path_for(tmp_path, name), "--rotate", 90)
    assert status == 0
    assert (f"{name} has no place to record" in output) == (name == "png")


@pytest.mark.parametrize("frames", [[], ["--frame-range", "0:1"]])
def test_a_capture_that_differs_from_its_checksum_is_not_converted(run, tmp_path, frames):
    jl.save(jl.Bits.from_array(random_frames(4, 6, 8)), tmp_path / "a.npy")
    content = bytearray((tmp_path / "a.npy").read_bytes())
    content[-1] ^= 1
    (tmp_path / "a.npy").write_bytes(content)
    for output in ("b.npy", "b.npy.gz", "b.tif"):
        status, printed = run("convert", "a.npy", "-o", output, *frames)
        assert status == 1
        assert printed.startswith("error: a.npy: is damaged or was changed")
    assert sorted(files(tmp_path)) == ["a.json", "a.npy"]
