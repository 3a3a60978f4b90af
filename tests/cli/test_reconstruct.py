"""`jotlight reconstruct`: captures, methods, and messages."""

import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.io import read_image


@pytest.mark.parametrize(
    "method",
    ["mle", "noniterative-tv", "noniterative-gaussian", "network-initial", "network-two-layer"],
)
def test_every_method_reconstructs_color(run, color, tmp_path, method):
    assert run("simulate", color, "-o", "bits.npy", "-k", 4)[0] == 0
    assert run("reconstruct", "bits.npy", "-o", "out.tif", "-m", method)[0] == 0
    assert read_image(tmp_path / "out.tif").shape == (40, 49, 3)


def test_counts_need_the_number_of_frames(run, tmp_path):
    counts = np.arange(48, dtype=np.uint16).reshape(6, 8) % 17
    np.save(tmp_path / "counts.npy", counts)
    np.savez(tmp_path / "counts.npz", k16=counts, other=counts)
    status, output = run("reconstruct", "counts.npy", "-o", "out.npy", "-m", "mle")
    assert status == 1
    assert "--frames" in output
    for arguments in (["counts.npy"], ["counts.npz", "--key", "k16"]):
        arguments += ["-o", "out.npy", "-m", "mle", "--frames", 16, "--max-intensity", 1]
        status, output = run("reconstruct", *arguments)
        assert status == 0
        assert "assumed" in output
        assert (np.load(tmp_path / "out.npy") == jl.mle(counts, jl.Sensor(frames=16))).all()
    status, output = run("reconstruct", "counts.npz", "-o", "out.npy", "--frames", 16)
    assert status == 1
    assert "k16, other" in output


@pytest.mark.parametrize("motion", [[], ["--motion"]])
def test_the_frames_of_images_of_counts_are_those_of_all_together(run, tmp_path, motion):
    np.save("counts.npy", np.full((12, 6, 8), 5, np.uint16))
    arguments = ["reconstruct", "counts.npy", "-o", "out.npy", *motion]
    for frames in (16, 200):
        status, output = run(*arguments, "--frames", frames)
        assert status == 1
        assert "multiple of the 12 images of counts, because the sensor states the fr" in output
        assert f"if each image has {frames} frames, pass --frames {12 * frames}\n" in output
    status, output = run(*arguments, "--frames", 48)
    assert status == 1
    assert "counts.npy: expected counts from 0 to 4, the trials of each image, got 5 to 5" in output
    assert "--frames states the frames of all images together" in output
    assert not (tmp_path / "out.npy").exists()
    assert run("reconstruct", "counts.npy", "-o", "out.npy", "--frames", 192)[0] == 0


def test_the_frames_are_those_of_the_selected_images_of_counts(run, tmp_path):
    bits = jl.Sensor(frames=64).expose(np.full((8, 9), 0.5), rng=0)
    sums = bits.to_array().reshape(16, 4, 8, 9).sum(axis=1).astype(np.uint16)
    np.save(tmp_path / "sums.npy", sums)
    base = ("reconstruct", "sums.npy", "-o", "a.npy", "-m", "mle", "--frame-range", "0:8")
    code, output = run(*base, "--frames", 32)
    assert code == 0
    assert "assumed, with 4 frames in each of the 8 images of counts: Sensor(frames=32" in output
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), jl.mle(bits[:32]))
    assert "with 8 frames in each of the 8 images" in run(*base, "--frames", 64)[1]
    code, output = run(*base, "--frames", 30)
    assert code == 1
    assert "expected a multiple of the 8 images of counts" in output


def test_the_assumed_sensor_of_a_cube_without_a_description_is_printed(run, tmp_path):
    np.save(tmp_path / "cube.npy", np.full((4, 6, 2), 0b01010101, np.uint8))
    status, output = run("reconstruct", "cube.npy", "-o", "out.npy", "-m", "mle")
    assert status == 0
    assert "assumed: Sensor(frames=4, max_intensity=2.07" in output  # log(2 * 4)


def test_a_network_file_reconstructs_a_capture(run, photo, tmp_path):
    network = jl.Network.initial(jl.Sensor(oversampling=2), sigma=1.0)
    network.save(tmp_path / "model.safetensors")
    assert run("simulate", photo, "-o", "bits.npy", "-k", 2)[0] == 0
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy"]
    assert run(*arguments, "--model", "model.safetensors")[0] == 0
    bits = jl.open(tmp_path / "bits.npy")
    assert (np.load(tmp_path / "out.npy") == network.reconstruct(bits)).all()


def test_a_missing_bm3d_is_an_error_that_names_the_extra_and_its_terms(run, photo, monkeypatch):
    monkeypatch.setitem(sys.modules, "bm3d", None)
    assert run("simulate", photo, "-o", "bits.npy")[0] == 0
    status, output = run("reconstruct", "bits.npy", "-o", "a.png", "-m", "noniterative-bm3d")
    assert status == 1
    assert "jotlight[bm3d]" in output
    assert "non-commercial" in output


@pytest.mark.filterwarnings("always")
def test_the_number_of_inpainted_pixels_is_reported(run, photo, tmp_path):
    dead = np.zeros((40, 49), bool)
    dead[3, 4] = True
    np.save(tmp_path / "dead.npy", dead)
    assert run("simulate", photo, "-o", "bits.npy", "-k", 1, "-t", 4, "--mask", "dead.npy")[0] == 0
    status, output = run("reconstruct", "bits.npy", "-o", "a.png", "-m", "mle")
    assert status == 0
    assert "warning: 1 of 1960 pixels" in output


def test_invalid_archives_are_refused_by_name(run, tmp_path):
    np.savez("objects.npz", a=np.array([{}], dtype=object))
    np.save("array.npy", np.arange(4))
    (tmp_path / "array.npy").rename(tmp_path / "array.npz")
    (tmp_path / "text.npz").write_text("not an archive")
    np.savez("cut.npz", a=np.arange(10_000).reshape(100, 100))
    whole = (tmp_path / "cut.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[:100] + b"x" * 900 + whole[1000:])
    for name, expected in {
        "objects.npz": "Python objects",
        "array.npz": "expected counts",
        "text.npz": "expected a .npz file",
        "cut.npz": "damaged",
    }.items():
        status, output = run("reconstruct", name, "-o", "a.png", "--frames", 9, "-m", "mle")
        assert status == 1
        assert output.startswith(f"error: {name}")
        assert expected in output
        assert "allow_pickle" not in output


def test_archive_members_that_are_not_arrays_are_refused(run):
    with zipfile.ZipFile("odd.npz", "w") as archive:
        archive.writestr("a.npy", "not an array")
        archive.writestr("b.npy", "")
        archive.writestr("c.txt", "text")
    for name in "ab":
        for arguments in (
            ["reconstruct", "odd.npz", "--key", name, "-o", "a.png", "-t", 9],
            ["info"],
        ):
            status, output = run(*arguments, *(["odd.npz"] if arguments == ["info"] else []))
            assert status == 1
            assert output.startswith("error: odd.npz: ")
            assert "damaged" in output
    odd = Path("odd.npz")
    content = bytearray(odd.read_bytes())
    for position in [i for i in range(len(content)) if content[i : i + 4] == b"PK\x01\x02"]:
        content[position + 10] = 97  # an unknown compression method
    odd.write_bytes(content)
    status, output = run("info", "odd.npz")
    assert status == 1
    assert output.startswith("error: odd.npz: expected a .npz archive")
    assert "numpy.savez_compressed" in output
