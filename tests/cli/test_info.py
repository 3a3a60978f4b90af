"""`jotlight info`: files of bits, counts, images, networks, and archives."""

import numpy as np
import png
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.formats.writing import write_capture
from jotlight.sensing.parameters.provenance import Provenance
from servers import http_server

COUNTS = np.random.default_rng(0).integers(0, 5, (6, 9), np.uint8)
COUNTS[0, :2] = 0, 4


def lines_of(run, *arguments):
    status, output = run("info", *arguments)
    assert status == 0
    return [" ".join(line.split()) for line in output.splitlines()]


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_gray_levels_may_be_counts_or_an_image(run, tmp_path, name):
    if name == "a.png":
        Image.fromarray(COUNTS).save(tmp_path / name)
    else:
        tifffile.imwrite(tmp_path / name, COUNTS)
    lines = lines_of(run, name)
    assert "kind counts, or an image" in lines
    assert "counts 0 to 4" in lines
    assert "image float32, 0 to 0.01569" in lines
    assert "values int32, 0 to 4" in lines_of(run, name, "--counts")


def test_an_estimate_is_an_image_and_no_capture(run, photo):
    assert run("simulate", photo, "-o", "bits.npy", "-k", "1", "-t", "4")[0] == 0
    assert run("reconstruct", "bits.npy", "-o", "e.png", "-m", "mle")[0] == 0
    lines = lines_of(run, "e.png")
    assert "kind image" in lines
    assert "method mle" in lines
    assert not any("counts" in line.split()[0] for line in lines)
    status, output = run("reconstruct", "e.png", "-o", "f.png", "-t", "255", "-m", "mle")
    assert status == 1
    assert "made of bits.npy by mle; name the capture itself, or pass --counts" in output
    assert run("convert", "e.png", "-o", "f.npy", "--counts")[0] == 0
    assert np.load("f.npy").max() == 255


def test_a_stack_of_gray_levels_is_counts(run, tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.stack([COUNTS] * 7), photometric="minisblack")
    lines = lines_of(run, "a.tif")
    assert "images 7" in lines
    assert "values int32, 0 to 28" in lines


def test_a_color_file_is_an_image(run, tmp_path):
    Image.fromarray(np.stack([COUNTS] * 3, axis=2)).save(tmp_path / "a.png")
    assert "kind image" in lines_of(run, "a.png")


@pytest.mark.parametrize("name", ["tiff", "npz"])
def test_counts_written_by_jotlight_are_shown_as_counts(run, tmp_path, name):
    path = "a.tif" if name == "tiff" else "a.npz"
    provenance = Provenance("npy", "cube.npy")
    write_capture(COUNTS.astype(np.int32), tmp_path / path, name, trials=64, provenance=provenance)
    lines = lines_of(run, path)
    assert f"format {name}" in lines
    assert f"provenance {name}: counts out of 64, as the file states" in lines
    assert f"{name}: converted from cube.npy" in lines
    assert "values int32, 0 to 4" in lines


@pytest.mark.parametrize(("depth", "palette"), [(1, False), (2, False), (4, False), (2, True)])
def test_the_levels_of_a_png_of_few_bits_are_shown_without_scaling(run, tmp_path, depth, palette):
    levels = np.arange(24).reshape(4, 6) % 2**depth
    if palette:
        colors = [(80 * level, 0, 255) for level in range(4)]
        with (tmp_path / "a.png").open("wb") as file:
            png.Writer(6, 4, bitdepth=depth, palette=colors).write(file, levels.tolist())
    else:
        png.from_array(levels.tolist(), f"L;{depth}").save(tmp_path / "a.png")
    lines = lines_of(run, "a.png")
    kind = "bits" if depth == 1 else "counts"
    assert f"kind {kind}, or an image" in lines
    assert f"{kind} 0 to {2**depth - 1}" in lines
    assert f"--{kind} shows it as a capture" in lines
    assert f"kind {kind}" in lines_of(run, "a.png", f"--{kind}")


def test_info_describes_every_kind_of_file(run, photo, tmp_path):
    assert run("simulate", photo, "-o", "bits.npy")[0] == 0
    np.save(tmp_path / "counts.npy", np.arange(6).reshape(2, 3))
    jl.Network.initial(jl.Sensor()).save(tmp_path / "model.safetensors")
    for name, expected in {
        "bits.npy": ["160 x 196", "oversampling=4", "ones", "40 x 49"],
        "counts.npy": ["counts", "2 x 3", "0 to 5"],
        "model.safetensors": ["kFLOP per pixel", "15 x 15", "150"],
        "photo.png": ["image", "40 x 49"],
    }.items():
        status, output = run("info", name)
        assert status == 0
        for text in expected:
            assert text in output, (name, text)


def test_info_lists_the_arrays_of_an_archive(run):
    np.savez("counts.npz", k1=np.zeros((3, 4), np.uint16), k4=np.zeros((5, 6), np.uint8))
    output = run("info", "counts.npz")[1]
    assert "uint16, 3 x 4" in output
    assert "uint8, 5 x 6" in output


@pytest.mark.slow
def test_an_archive_of_one_capture_is_described_as_it_is_opened(run):
    dark = np.zeros((300, 512, 512), bool)  # more bytes than one compressed image may have
    dark[::100, 7, 7] = True
    np.savez_compressed("dark.npz", a=dark)
    lines = lines_of(run, "dark.npz")
    assert {"kind bits", "format npz", "frames 300", "jots 512 x 512"} <= set(lines)
    np.savez("float.npz", a=np.ones((3, 4, 5), np.float32))
    assert lines_of(run, "float.npz") == ["kind archive of arrays", "a float32, 3 x 4 x 5"]


@pytest.mark.slow
def test_arrays_of_an_archive_are_listed_from_their_headers(run):
    np.savez_compressed("a.npz", dark=np.zeros((300, 512, 512), bool), flat=np.ones((2, 3)))
    lines = lines_of(run, "a.npz")
    assert lines == ["kind archive of arrays", "dark bool, 300 x 512 x 512", "flat float64, 2 x 3"]


def test_verify_prints_its_result_after_the_facts(run, tmp_path):
    np.save(tmp_path / "a.npy", np.full((4, 3, 2), 7, np.uint8))
    lines = lines_of(run, "a.npy", "--verify", "--frame-range", "0:2")
    assert "frames 2" in lines
    assert "all 4 frames are readable" in lines[-1]
    assert "verified" not in lines_of(run, "a.npy")[-1]


def test_a_damaged_capture_and_a_file_of_another_kind_are_not_verified(run, tmp_path):
    jl.save(jl.Sensor(frames=2).expose(np.ones((4, 9)), rng=0), tmp_path / "a.npy")
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-1])
    jl.Network.initial(jl.Sensor()).save(tmp_path / "b.safetensors")
    for name in ("a.npy", "b.safetensors"):
        status, output = run("info", name, "--verify")
        assert status == 1
        assert output.startswith(f"error: {name}: ")
        assert output.count("\n") == 1


def test_a_capture_at_a_url_is_described(run, tmp_path):
    pytest.importorskip("fsspec", reason="no URLs: pip install 'jotlight[dask]'")
    jl.save(jl.Sensor(frames=40).expose(np.full((16, 24), 0.4), rng=0), tmp_path / "a.npy")
    with http_server(tmp_path) as server:
        local, remote = run("info", tmp_path / "a.npy"), run("info", f"{server.url}/a.npy")
        assert local[0] == remote[0] == 0
        assert "16 x 24" in remote[1]
        assert run("info", f"{server.url}/a.npy", "--verify")[0] == 1
        status, output = run("info", f"{server.url}/no.npy")
    assert status == 1
    assert "no.npy" in output
    assert "16 x 24" in local[1]


def test_results_name_the_mosaic_by_its_letters(run, tmp_path):
    sensor = jl.Sensor(frames=4, mosaic="GRBG")
    jl.save(sensor.expose(np.full((8, 8, 3), 0.5), rng=0), tmp_path / "a.npy")
    options = "-m", "mle", "--demosaicing", "differences"
    assert run("reconstruct", "a.npy", "-o", "a.tif", *options)[0] == 0
    status, output = run("info", "a.tif")
    assert status == 0
    assert "mosaic=Mosaic('GRBG')" in " ".join(output.split())


def test_a_motion_is_described_and_drawn(run, tmp_path):
    nodes, parts = np.zeros((1, 2, 2, 1, 1), np.float32), np.ones((1, 2, 3, 1, 1), np.float32)
    times, labels = np.array([0.0, 6.0]), np.zeros((16, 16), np.uint8)
    jl.Motion(nodes, labels, times, 3.0, "affine", parts).save(tmp_path / "m.safetensors")
    status, output = run("info", "m.safetensors", "--plot", "m.png")
    assert status == 0
    lines = [" ".join(line.split()) for line in output.splitlines()]
    assert lines[:3] == ["kind motion", "model affine", "size 16 x 16 jots"]
    assert (tmp_path / "m.png").exists()


@pytest.mark.parametrize("name", ["film.mp4", "film.gif", "film"])
def test_a_film_for_display_is_described_by_the_record_beside_it(run, tmp_path, name):
    if name == "film.mp4":
        pytest.importorskip("imageio_ffmpeg")
    jl.save(jl.Sensor(frames=8).expose(np.full((6, 16), 0.5), rng=0), tmp_path / "b.npy")
    assert run("film", "b.npy", "-o", name, "--window", 4, "--method", "mle")[0] == 0
    lines = lines_of(run, name)
    assert lines[0] == "kind film"
    assert {"capture b.npy", "window 4", "method mle", "curve gamma"} <= set(lines)
    shape = ["shape 2 images of 6 x 16"] * (name != "film.mp4")
    assert lines[1:][: len(shape)] == shape
    if name == "film":
        assert "kind counts" in lines_of(run, name, "--counts")
        (tmp_path / "film.film.json").unlink()
        assert {"kind film", *shape, "capture b.npy", "window 4"} <= set(lines_of(run, name))
        with pytest.raises(ValueError, match=r"estimate for display, which .* made of b\.npy by"):
            jl.open(name)
        return
    record = tmp_path / f"{name}.json"
    with (tmp_path / name).open("ab") as file:
        file.write(b"changed")
    assert f"origin unknown: {record.name} is the record of another file" in lines_of(run, name)
    record.unlink()
    missing = f"origin unknown: there is no {record.name} beside it"
    assert lines_of(run, name) == ["kind film", *shape, missing]


def test_an_image_in_gif_is_no_film(run, tmp_path):
    jl.save_film(tmp_path / "a.gif", np.full((1, 6, 16), 0.5))
    assert lines_of(run, "a.gif")[0] == "kind image"


@pytest.mark.parametrize("name", ["a.npy", "a.tif", "a.gif"])
def test_the_checksum_of_a_film_is_verified(run, tmp_path, name):
    jl.save(jl.Sensor(frames=8).expose(np.full((6, 16), 0.5), rng=0), tmp_path / "b.npy")
    assert run("film", "b.npy", "-o", name, "--window", 4, "--method", "mle")[0] == 0
    lines = lines_of(run, name, "--verify")
    assert lines[0] == "kind film"
    assert lines[-1] == f"verified the file matches its SHA-256 in {name}.json"
    content = bytearray((tmp_path / name).read_bytes())
    content[-3] ^= 1
    (tmp_path / name).write_bytes(content)
    status, output = run("info", name, "--verify")
    assert status == 1
    assert f"error: {name}: the file does not match its SHA-256 in {name}.json" in output


def test_a_folder_of_images_has_no_checksums_to_verify(run, tmp_path):
    jl.save(jl.Sensor(frames=8).expose(np.full((6, 16), 0.5), rng=0), tmp_path / "b.npy")
    assert run("film", "b.npy", "-o", "film", "--window", 4, "--method", "mle")[0] == 0
    status, output = run("info", "film", "--verify")
    assert status == 1
    assert "film.film.json has no checksums of the images of a folder" in output


@pytest.mark.parametrize("ending", [".npy", ".npz", ".tif", ".png", ".h5", ".exr"])
def test_an_empty_file_of_any_format_is_called_empty(run, tmp_path, ending):
    (tmp_path / f"a{ending}").touch()
    status, output = run("info", f"a{ending}")
    assert (status, output) == (1, f"error: a{ending}: expected a capture, got an empty file\n")


@pytest.mark.parametrize("options", [[], ["--plot", "a.png"], ["--verify"]], ids=str)
def test_an_onnx_model_is_refused(run, tmp_path, options):
    (tmp_path / "own.onnx").write_bytes(b"\x08\x08\x12\x08jotlight")
    status, output = run("info", "own.onnx", *options)
    assert status == 1
    assert output.startswith("error: own.onnx: this is an ONNX model, which runs in ONNX Runtime: ")


def test_an_onnx_model_is_refused_in_place_of_a_network(run, tmp_path):
    jl.save(jl.Sensor(frames=4).expose(np.full((8, 8), 0.4), rng=0), tmp_path / "bits.npy")
    (tmp_path / "own.onnx").write_bytes(b"\x08\x08\x12\x08jotlight")
    status, output = run("reconstruct", "bits.npy", "--model", "own.onnx", "-o", "a.png")
    assert status == 1
    assert "own.onnx: this is an ONNX model" in output
