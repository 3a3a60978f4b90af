"""Runs of `reconstruct` and `convert` over many captures and over windows."""

import hashlib
import json
import zlib
from pathlib import Path

import numpy as np
import pytest
import zarr

import jotlight as jl
from jotlight.images.io import read_image, read_note
from jotlight.runs.capture_source import CaptureSource
from jotlight.runs.jobs import ConversionJob


def test_videos_have_both_precisions(run, captures):
    arguments = ["reconstruct", "captures/a/1.npy", "-o", "v.zarr", "--window", 16]
    code, out = run(*arguments, "--quality", "small", "--precision", "bf16")
    assert code == 0, out
    bits = jl.open(captures[0])
    array = zarr.open_array("v.zarr", mode="r")
    for found, part in zip(array[:], bits.windows(16), strict=True):
        expected = jl.reconstruct(part, quality="small", precision="bf16")
        np.testing.assert_array_equal(found, expected)
    assert "precision=bf16" in run("info", "v.zarr")[1]


def test_each_capture_becomes_a_video(run, captures):
    code, out = run(
        "reconstruct", "captures/*/*.npy", "-o", "v/{name}.zarr", "--window", 16, "-m", "mle"
    )
    assert code == 0
    assert "3 captures: 3 made" in out
    for path in captures:
        bits = jl.open(path)
        name = path.relative_to("captures").with_suffix(".zarr")
        array = zarr.open_array(str(Path("v") / name), mode="r")
        expected = [jl.reconstruct(part, method="mle") for part in bits.windows(16)]
        np.testing.assert_array_equal(array[:], expected)
        record = array.attrs["jotlight"]
        assert record["input"] == {
            "packed_bytes": bits.packed.nbytes,
            "packed_crc32": f"{zlib.crc32(np.asarray(bits.packed).tobytes()):08x}",
        }
        assert record["run"]["sensor"]["frames"] == 16
        assert record["run"]["bytes"] == path.stat().st_size


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_a_smooth_kernel_is_that_of_each_window(run, captures):
    sensor = jl.Sensor(frames=64, kernel="linear")
    jl.save(sensor.expose(np.full((16, 24), 0.5), rng=0), "linear.npy")
    arguments = ["reconstruct", "linear.npy", "-o", "v.zarr", "--window", 16]
    code, out = run(*arguments, "-m", "noniterative-tv")
    assert code == 0, out
    parts = jl.open("linear.npy").windows(16)
    expected = [jl.reconstruct(part, method="noniterative-tv") for part in parts]
    np.testing.assert_array_equal(zarr.open_array("v.zarr", mode="r")[:], expected)


@pytest.mark.filterwarnings("always::jotlight.JotlightWarning")
@pytest.mark.parametrize("output", ["{name}.tif", "{name}.zarr"])
@pytest.mark.parametrize(
    ("intensity", "dark_counts", "message"),
    [
        (3.0, 0.0, "brighter than the largest intensity"),
        (0.0, 0.2, "these would cause more ones without any light"),
    ],
)
def test_captures_that_contradict_their_sensor_cause_one_warning(
    run, captures, output, intensity, dark_counts, message
):
    for number in range(2):
        bright = jl.Sensor(frames=64, max_intensity=9.0)
        bits = bright.expose(np.full((32, 32), intensity), rng=number)
        stated = jl.Sensor(frames=64, dark_counts=dark_counts)
        jl.save(jl.Bits(bits.packed, 32, stated), f"white{number}.npy")
    window = ["--window", 16] if output.endswith(".zarr") else []
    code, out = run("reconstruct", "white*.npy", "-o", output, "-m", "mle", *window)
    assert code == 0
    assert out.count(message) == 1


def test_each_capture_becomes_an_image_with_a_record(run, captures):
    args = ("reconstruct", *captures, "-o", "i/{name}.tif", "--quality", "medium")
    assert run(*args)[0] == 0
    image = read_image("i/a/1.tif")
    np.testing.assert_array_equal(image, jl.reconstruct(jl.open(captures[0])))
    record = json.loads(Path("i/a/1.tif.json").read_text())
    weights = Path(jl.__file__).parent / "networks/weights/medium.safetensors"
    assert record["run"]["weights_sha256"] == hashlib.sha256(weights.read_bytes()).hexdigest()
    assert record["run"]["method"] == "network-medium"
    assert "3 complete before" in run(*args)[1]


def test_each_capture_is_converted(run, captures):
    args = ("convert", "captures/*/*.npy", "-o", "c/{name}.zarr")
    assert run(*args)[0] == 0
    for path in captures:
        copy = jl.open(Path("c") / path.relative_to("captures").with_suffix(".zarr"))
        np.testing.assert_array_equal(np.asarray(copy), np.asarray(jl.open(path)))
    assert "3 complete before" in run(*args)[1]


def test_windows_are_converted_to_counts(run, captures):
    args = ("convert", captures[0], "-o", "c.zarr", "--window", 20, "--step", 10)
    assert run(*args)[0] == 0
    array = zarr.open_array("c.zarr", mode="r")
    assert array.dtype == np.int32
    expected = [part.counts() for part in jl.open(captures[0]).windows(20, 10)]
    np.testing.assert_array_equal(array[:], expected)


def test_a_result_is_not_a_capture(run, captures):
    assert run("reconstruct", captures[0], "-o", "v.zarr", "-m", "mle", "--window", 16)[0] == 0
    with pytest.raises(ValueError, match="holds images of a run, not a capture"):
        jl.open("v.zarr")


def test_preparing_a_copy_keeps_what_another_part_writes(tmp_path):
    output = tmp_path / "copy.zarr"
    output.mkdir()
    job = ConversionJob("copy", CaptureSource("a.npy"), output, "zarr", {}, 0)
    assert job.prepare() == [0]
    assert output.exists()
    assert not job.record.exists()


def test_info_shows_the_origin_of_a_video(run, captures):
    run("reconstruct", captures[0], "-o", "v.zarr", "--window", 16, "--quality", "small")
    code, out = run("info", "v.zarr")
    assert code == 0
    facts = dict(line.strip().split(maxsplit=1) for line in out.splitlines() if " " in line)
    assert facts["kind"] == "video"
    assert "4 images of 16 x 24" in out
    assert "network-small" in out
    assert "crc32" in out
    assert "weights" in out


@pytest.mark.parametrize(
    ("frames", "text"), [(16, "4 images match their"), (64, "1 image matches its")]
)
def test_the_images_of_a_video_are_verified(run, captures, frames, text):
    assert run("convert", captures[0], "-o", "v.zarr", "--window", frames)[0] == 0
    code, out = run("info", "v.zarr", "--verify")
    assert (code, "counts of windows" in out) == (0, True)
    assert f"verified  {text}" in " ".join(out.split("\n")).replace("   ", "")
    image = Path("v.zarr/c.0.0.0")
    content = image.read_bytes()
    image.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert run("info", "v.zarr")[0] == 0
    code, err = run("info", "v.zarr", "--verify")
    assert (code, "images do not match their checksums, such as c.0.0.0" in err) == (1, True)
    image.unlink()
    code, err = run("info", "v.zarr")
    assert (code, "images are missing or incomplete, such as c.0.0.0" in err) == (1, True)


def test_only_finished_videos_are_verified(run, captures):
    base = ("convert", captures[0], "-o", "v.zarr", "--window", 16, "--chunks", "1KiB")
    assert run(*base, "--part", "1/2")[0] == 0
    code, err = run("info", "v.zarr.part", "--verify")
    assert (code, "v.zarr.part: --verify is for finished videos" in err) == (1, True)


def test_info_shows_the_origin_of_an_image(run, captures):
    run("reconstruct", *captures, "-o", "i/{name}.npy", "-m", "mle")
    code, out = run("info", "i/a/1.npy")
    assert code == 0
    assert "crc32" in out


@pytest.mark.parametrize(
    ("ending", "depth"), [(".tif", 8), (".png", 8), (".png", 16), (".jpg", 8), (".exr", 8)]
)
def test_a_single_image_states_its_origin(run, captures, ending, depth):
    if ending == ".exr":
        pytest.importorskip("OpenEXR")
    options = ("--quality", "medium", "--depth", depth)
    run("reconstruct", captures[0], "-o", f"one{ending}", *options)
    code, out = run("info", f"one{ending}")
    assert code == 0
    packed = np.asarray(jl.open(captures[0]).packed).tobytes()
    assert f"{len(packed)} bytes, crc32 {zlib.crc32(packed):08x}" in out
    weights = Path(jl.__file__).parent / "networks/weights/medium.safetensors"
    assert hashlib.sha256(weights.read_bytes()).hexdigest() in out
    assert "1.npy" in out


def read_crc(path):
    """Return the line of `jotlight info` about the frames that were read for a result."""
    packed = np.asarray(jl.open(path).packed).tobytes()
    return f"{len(packed)} bytes, crc32 {zlib.crc32(packed):08x}"


def test_a_single_npy_and_the_files_beside_it_state_their_origin(run, captures):
    options = ("--preview", "p.png", "--uncertainty", "u.npz")
    assert run("reconstruct", captures[0], "-o", "one.npy", "-m", "mle", *options)[0] == 0
    for name in ("one.npy", "p.png"):
        code, out = run("info", name)
        assert code == 0
        assert read_crc(captures[0]) in out, name
        assert "1.npy" in out
    assert "crc32" in Path("u.npz.json").read_text()


@pytest.mark.parametrize("name", ["f.npy", "f.tif", "f.gif", "f"])
def test_a_film_states_its_origin(run, captures, name):
    options = ("--window", 16, "--step", 8, "-m", "mle")
    assert run("film", captures[0], "-o", name, *options)[0] == 0
    record = json.loads(Path("f.film.json" if name == "f" else f"{name}.json").read_text())
    packed = np.asarray(jl.open(captures[0]).packed).tobytes()
    assert record["origin"]["packed_crc32"] == f"{zlib.crc32(packed):08x}"
    assert record["origin"]["step"] == 8
    if name != "f":
        assert read_crc(captures[0]) in run("info", name)[1]


def test_a_record_of_another_file_is_not_shown(run, captures):
    run("reconstruct", captures[0], "-o", "one.npy", "-m", "mle")
    np.save("one.npy", np.zeros((16, 24), np.float32))
    out = run("info", "one.npy")[1]
    assert "unknown: one.npy.json is the record of another file" in out
    assert "crc32" not in out


def test_a_file_that_is_not_a_record_is_not_replaced(run, captures):
    for name in ("one.npy.json", "c.npy.run.json"):
        Path(name).write_text('{"mine": 1}')
    code, err = run("reconstruct", captures[0], "-o", "one.npy", "-m", "mle")
    assert code == 1
    assert "one.npy.json: the record of the result belongs here" in " ".join(err.split())
    code, err = run("convert", captures[0], "-o", "c.npy")
    assert code == 1
    assert "the record of the copy belongs here" in " ".join(err.split())
    assert not Path("one.npy").exists()
    assert not Path("c.npy").exists()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*has no place for the sensor")
@pytest.mark.parametrize("output", ["c.npy", "c.h5", "c.zarr", "c.tif", "folder"])
@pytest.mark.parametrize("many", [False, True])
def test_a_copy_states_its_origin(run, captures, output, many):
    to = ("--to", "matlab") if output == "folder" else ()
    files = captures if many else captures[:1]
    name = f"{{name}}/{output}" if many else output
    assert run("convert", *files, "-o", name, *to)[0] == 0
    copy = f"a/1/{output}" if many else output
    code, out = run("info", copy)
    assert code == 0
    size, checksum = read_crc(captures[0]).split(" bytes, ")
    assert f"{size} bytes of packed frames, {checksum}" in out
    assert "1.npy" in out


def test_a_conversion_that_was_killed_before_its_record_is_made_again(run, captures):
    args = ("convert", captures[0], captures[1], "-o", "c/{name}.zarr")
    assert run(*args)[0] == 0
    record = next(Path("c").rglob("*.run.json"))
    record.write_text(json.dumps({"run": json.loads(record.read_text())["run"]}))
    code, out = run(*args)
    assert code == 0
    assert "1 made, 1 complete before" in out
    assert "input" in json.loads(record.read_text())


@pytest.mark.parametrize(
    "command", [("reconstruct", "-m", "mle", "-o", "{name}.tif"), ("convert", "-o", "{name}.tif")]
)
def test_the_name_of_a_single_capture_replaces_its_place(run, captures, command):
    code, out = run(command[0], captures[0], *command[1:])
    assert code == 0, out
    assert Path("1.tif").is_file()
    assert not Path("{name}.tif").exists()


def test_another_capture_does_not_change_the_names_of_results(run, captures):
    other = captures[2].parent.rename("other")
    args = ("reconstruct", "captures/*/*.npy", "-o", "v/{name}.zarr", "--window", 16, "-m", "mle")
    assert "2 captures: 2 made" in run(*args)[1]
    other.rename(captures[2].parent)
    code, out = run(*args)
    assert code == 0
    assert "3 captures: 1 made, 2 complete before" in out
    found = sorted(path.relative_to("v").as_posix() for path in Path("v").glob("*/*"))
    assert found == ["a/1.zarr", "a/2.zarr", "b/1.zarr"]


@pytest.fixture
def unequal(tmp_path, monkeypatch):
    """Return captures of a dim, an ordinary, and a bright scene, which do not state the largest."""
    monkeypatch.chdir(tmp_path)
    scene = np.linspace(0.1, 1, 16 * 48, dtype=np.float32).reshape(16, 48)
    for name, light in (("dim", 0.02), ("mid", 0.5), ("bright", 3.0)):
        bits = jl.Sensor(frames=64).expose(light * scene, rng=0)
        np.save(f"{name}.npy", np.asarray(bits.packed))
    return "*.npy"


def test_one_white_for_all_images_is_requested(run, unequal):
    base = ("reconstruct", unequal, "-o", "o/{name}.png", "-m", "mle", "--depth", 16)
    code, out = run(*base, "--white", 2)
    assert code == 0, out
    assert "is shown as white" not in out
    for name in ("dim", "mid", "bright"):
        image = jl.mle(jl.open(f"{name}.npy"), jl.Sensor(frames=64, max_intensity=4.8))
        expected = np.clip(image / np.float32(2), 0, 1)
        np.testing.assert_allclose(read_image(f"o/{name}.png"), expected, atol=1e-4)
        stated = json.loads(Path(f"o/{name}.png.json").read_text())
        assert (stated["curve"], stated["white"]) == ("linear", 2.0)
        assert read_note(Path(f"o/{name}.png"))["jotlight"]["white"] == 2.0
    assert "3 complete before" in run(*base, "--white", 2)[1]
    code, err = run(*base, "--white", 3)
    assert code == 1
    assert "its white was 2.0, and is 3.0 now" in err


@pytest.mark.filterwarnings("default:.*is shown as white")
def test_a_white_that_the_image_decides_is_recorded_and_names_the_capture(run, unequal):
    code, out = run("reconstruct", unequal, "-o", "o/{name}.png", "-m", "mle")
    assert code == 0, out
    whites = {
        name: json.loads(Path(f"o/{name}.png.json").read_text())["white"]
        for name in ("dim", "mid", "bright")
    }
    assert whites["dim"] < whites["mid"] == 1 < whites["bright"]
    for name in ("dim", "bright"):
        assert f"{name}: {whites[name]:.3g}, the 99.5th percentile, is shown as white" in out
    assert "mid: " not in out
    lines = [" ".join(line.split()) for line in run("info", "o/dim.png")[1].splitlines()]
    assert {"curve linear", f"white {whites['dim']}"} <= set(lines)


def test_the_curve_and_a_stated_largest_intensity_are_those_of_a_single_image(run, unequal):
    options = ("-m", "mle", "--max-intensity", 4)
    for extra in ((), ("--curve", "log"), ("--curve", "gamma", "--white", 2)):
        assert run("reconstruct", "mid.npy", "-o", "one.png", *options, *extra)[0] == 0
        name = f"{len(extra)}"
        many = ("-o", f"{name}{{name}}.png")
        assert run("reconstruct", "mid.npy", "dim.npy", *many, *options, *extra)[0] == 0
        np.testing.assert_array_equal(read_image("one.png"), read_image(f"{name}mid.png"))
