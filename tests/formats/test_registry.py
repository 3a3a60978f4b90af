"""The list of formats: every entry is complete, detected, and has examples."""

import re

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from examples import READERS
from jotlight.formats.opening.detect import detect_format
from jotlight.formats.registry import FORMATS, WRITERS
from jotlight.formats.writing import choose_output_format, write_capture


def test_every_format_has_examples_that_are_damaged_and_fuzzed():
    assert FORMATS.keys() <= READERS.keys()


@pytest.mark.parametrize("name", [name for name in FORMATS if FORMATS[name].matches])
def test_every_format_that_content_can_identify_is_detected(name, tmp_path):
    reader = READERS[name]
    pytest.importorskip(reader.needs)
    path, _, content = reader.example(tmp_path)
    if FORMATS[name].is_raw and not content.endswith(b"DONE"):
        path.write_bytes(content + b"DONE")
    assert detect_format(path) == name


def test_the_format_of_raw_frames_without_a_trailer_is_not_guessed(tmp_path):
    path, _, _ = READERS["swissspad2"].example(tmp_path)
    with pytest.raises(ValueError, match=r"pass format= \(--format\).*swissspad2"):
        detect_format(path)


@pytest.mark.parametrize("name", WRITERS)
def test_every_writer_writes_bits_or_counts_to_a_file_or_folder(name):
    writer = WRITERS[name]
    assert writer.bits or writer.counts
    assert writer.extensions or writer.folder
    assert writer.bits or not writer.keeps_sensor
    assert writer.counts or not writer.keeps_label


def test_an_extension_without_the_expected_content_is_refused(tmp_path):
    for name, extension in (("a.npy", r"\.npy"), ("a.h5", r"\.h5"), ("a.mat", r"\.mat")):
        (tmp_path / name).write_bytes(b"text")
        with pytest.raises(ValueError, match=f"expected a {extension} file by its name"):
            jl.open(tmp_path / name)


def test_the_output_format_follows_from_the_extension_or_is_required(tmp_path):
    assert choose_output_format(tmp_path / "a.npy.gz") == "npy.gz"
    with pytest.raises(ValueError, match="implies no single format"):
        choose_output_format(tmp_path / "a.bin")


@pytest.mark.parametrize("name", ["a.safetensors", "a.json", "a.mp4", "a.csv"])
def test_files_beside_captures_are_named(tmp_path, name):
    (tmp_path / name).write_text("{}")
    message = {
        "a.safetensors": r"a network, a calibration, or a motion; jotlight\.Network\.load,",
        "a.json": r"describes a capture; open the capture itself",
        "a.mp4": r"a video; .*jotlight\.Bits\.from_array takes frames of 0 and 1",
        "a.csv": r"text; numpy\.loadtxt reads an image of counts",
    }[name]
    with pytest.raises(ValueError, match=message) as error:
        jl.open(tmp_path / name)
    assert all(hasattr(getattr(jl, kind), "load") for kind in ("Network", "Calibration", "Motion"))
    assert "format=" not in str(error.value)


def test_a_folder_of_photographs_is_named(tmp_path):
    for index in range(3):
        Image.new("L", (20, 20)).save(tmp_path / f"{index}.jpg")
    (tmp_path / "notes.txt").write_text("text")
    with pytest.raises(ValueError, match=r"holds 3 \.jpg photographs, .*`jotlight simulate`"):
        jl.open(tmp_path)


@pytest.mark.parametrize("folder", ["a", "[a]"])
def test_a_folder_of_captures_gets_a_pattern_that_opens_them(tmp_path, folder):
    (tmp_path / folder / "c.npy").mkdir(parents=True)
    for name in "ab":
        bits = jl.Sensor(frames=4).expose(np.full((8, 8), 0.5), rng=0)
        jl.save(bits, tmp_path / folder / f"{name}.npy")
    with pytest.raises(ValueError, match=r"holds 2 \.npy files; name one") as error:
        jl.open(tmp_path / folder)
    (tmp_path / folder / "c.npy").rmdir()
    [pattern] = re.findall("'(.*)'", str(error.value))
    assert [len(bits) for bits in jl.open(pattern)] == [4, 4]


@pytest.mark.parametrize("name", ["png", "tiff"])
@pytest.mark.parametrize("other", ["a.npy", "b.h5", "c.zarr", "d.npy.gz"])
def test_a_folder_of_images_and_other_captures_is_refused(tmp_path, name, other):
    image = np.arange(20, dtype=np.int32).reshape(4, 5)
    write_capture(image, tmp_path / f"1.{name}", name)
    write_capture(image, tmp_path / f"2.{name}", name)
    (tmp_path / ".hidden.npy").touch()
    (tmp_path / "settings.json").touch()
    assert detect_format(tmp_path) == name
    (tmp_path / other).touch()
    message = rf"got files of several formats, such as {other} and 1\.{name}; name one of them"
    with pytest.raises(ValueError, match=message):
        jl.open(tmp_path)
    opened = jl.open(tmp_path, format=name, frames=slice(0, 2))
    np.testing.assert_array_equal(opened, 2 * image)


def test_a_folder_of_both_kinds_of_images_is_refused(tmp_path):
    for name in ("a.png", "b.tif"):
        jl.save(np.ones((4, 5), np.int32), tmp_path / name)
    with pytest.raises(ValueError, match=r"several formats, such as b\.tif and a\.png"):
        jl.open(tmp_path)


def test_a_folder_of_raw_files_may_be_one_capture(tmp_path):
    for name in ("a.bin", "b.bin", "settings.mat", "preview.jpg"):
        (tmp_path / name).write_bytes(bytes(100))
    with pytest.raises(ValueError, match=r"pass format= \(--format\).*swissspad2"):
        jl.open(tmp_path)


def test_an_empty_text_opens_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    np.save("a.npy", np.ones((4, 4), int))
    with pytest.raises(ValueError, match=r"path: expected the name of a file, .*got an empty text"):
        jl.open("")
