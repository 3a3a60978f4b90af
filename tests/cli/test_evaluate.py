import csv

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.networks.pretrained import BITS_PER_PIXEL

MODEL = "model.safetensors"
SENSOR = jl.Sensor(oversampling=3, frames=2)


@pytest.fixture
def model(tmp_path):
    network = jl.Network.initial(SENSOR, sigma=1.0)
    network.save(tmp_path / MODEL)
    return network


def table(said):
    """The numbers of the table, by row: PSNR, SNR and SSIM."""
    rows = {}
    for line in said.splitlines():
        for title in ("mean", "worst 5 %", "worst 1 %"):
            if line.startswith(title):
                rows[title] = [float(word) for word in line[len(title) :].split() if word != "dB"]
    return rows


def expected(result):
    return {
        title: [measure(name) for name in ("psnr", "snr", "ssim")]
        for title, measure in {
            "mean": result.mean,
            "worst 5 %": lambda name: result.mean_of_worst(name, 0.05),
            "worst 1 %": lambda name: result.mean_of_worst(name, 0.01),
        }.items()
    }


def assert_table(said, result):
    shown, right = table(said), expected(result)
    assert shown.keys() == right.keys()
    for title, numbers in shown.items():
        np.testing.assert_allclose(numbers[:2], right[title][:2], atol=0.005001)
        np.testing.assert_allclose(numbers[2], right[title][2], atol=0.0005001)


def test_the_table_has_the_mean_and_the_worst_and_names_the_measures(run, tmp_path):
    images = np.random.default_rng(0).random((24, 12, 12), np.float32)
    images *= np.linspace(0.2, 1, 24, dtype=np.float32)[:, None, None]
    np.save(tmp_path / "images.npy", images)
    status, said = run("evaluate", "images.npy", "-m", "mle", "-k", 2)
    assert status == 0
    result = jl.evaluate(jl.mle, images, jl.Sensor(oversampling=2))
    assert result.mean_of_worst("psnr", 0.05) != result.mean_of_worst("psnr", 0.01)
    assert_table(said, result)
    assert "maximum likelihood, 24 images, Sensor(oversampling=2)" in said
    header = next(line for line in said.splitlines() if "PSNR" in line)
    assert header.split() == ["PSNR", "SNR", "SSIM"]


def test_the_default_is_the_trained_network_for_4_x_4_jots(run, pictures):
    status, said = run("evaluate", pictures)
    assert status == 0
    sensor = jl.Sensor(oversampling=4)
    assert "network, medium, 3 images, Sensor(oversampling=4)" in said
    assert_table(said, jl.evaluate(jl.pretrained(sensor), read_image_set(pictures)[1], sensor))


def test_seed_and_method_are_taken(run, pictures):
    status, said = run("evaluate", pictures, "-m", "mle", "--seed", 7, "--threads", 1)
    assert status == 0
    sensor = jl.Sensor(oversampling=4)
    assert_table(said, jl.evaluate(jl.mle, read_image_set(pictures)[1], sensor, rng=7))


def test_the_csv_has_a_row_for_each_picture(run, pictures, tmp_path):
    status, said = run("evaluate", pictures, "-m", "mle", "-o", "scores.csv")
    assert status == 0
    assert "scores.csv" in said
    with (tmp_path / "scores.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["image"] for row in rows] == ["0.png", "1.png", "2.png"]
    result = jl.evaluate(jl.mle, read_image_set(pictures)[1], jl.Sensor(oversampling=4))
    values = [float(row["psnr_db"]) for row in rows]
    np.testing.assert_allclose(values, result.values("psnr"), atol=1e-6)


def test_a_model_brings_its_sensor_which_options_change(run, pictures, model):
    images = read_image_set(pictures)[1]
    for words, sensor in (
        ([], SENSOR),
        (["-k", 1, "-t", 18], jl.Sensor(frames=18)),
        (["--dark-counts", 0.2], SENSOR.replace(dark_counts=0.2)),
    ):
        status, said = run("evaluate", pictures, "--model", MODEL, *words)
        assert status == 0
        assert f"{MODEL}, 3 images, {sensor!r}" in said
        assert_table(said, jl.evaluate(model, images, sensor))


@pytest.mark.parametrize("number", [1, 2, 50])
def test_first_takes_the_first_by_name(run, pictures, number):
    status, said = run("evaluate", pictures, "-m", "mle", "--first", number)
    assert status == 0
    names, images = read_image_set(pictures, first=number)
    assert len(names) == min(number, 3)
    assert f"{len(names)} image" in said
    assert_table(said, jl.evaluate(jl.mle, images, jl.Sensor(oversampling=4)))


def test_an_array_of_an_archive_is_taken_by_its_key(run, tmp_path):
    images = np.random.default_rng(0).integers(0, 1024, (2, 3, 12, 12), np.uint16)
    np.savez(tmp_path / "sets.npz", one=images[0], two=images[1])
    words = ["evaluate", "sets.npz", "-m", "mle", "--white", 1023]
    status, said = run(*words, "--key", "two")
    assert status == 0
    scaled = images[1] / np.float32(1023)
    assert_table(said, jl.evaluate(jl.mle, scaled, jl.Sensor(oversampling=4)))
    status, said = run(*words)
    assert status == 1
    assert "one, two" in said


def test_images_too_small_for_ssim_are_evaluated(run, tmp_path):
    np.save(tmp_path / "tiny.npy", np.full((2, 6, 6), 0.5, np.float32))
    status, said = run("evaluate", "tiny.npy", "-m", "mle", "-o", "scores.csv")
    assert status == 0
    assert "Warning" not in said
    assert (tmp_path / "scores.csv").read_text().splitlines()[1].endswith(",")


def test_colour_pictures_are_turned_into_grey(run, tmp_path):
    (tmp_path / "colour").mkdir()
    levels = np.random.default_rng(0).integers(0, 256, (12, 13, 3), np.uint8)
    Image.fromarray(levels).save(tmp_path / "colour" / "a.png")
    status, said = run("evaluate", "colour", "-m", "mle")
    assert status == 0
    images = read_image_set(tmp_path / "colour")[1]
    assert images[0].ndim == 2
    assert_table(said, jl.evaluate(jl.mle, images, jl.Sensor(oversampling=4)))


def test_a_sensor_without_a_trained_network_says_why_and_how_to_train_one(run, pictures):
    status, said = run("evaluate", pictures, "-k", 2, "-q", 3, "-m", "network-two-layer")
    assert status == 1
    assert said.startswith("error: there is no trained network for 4 bits per pixel")
    assert all(str(bits) in said for bits in BITS_PER_PIXEL)
    assert "jotlight train " in said
    assert "--oversampling 2" in said
    assert "--threshold 3" in said


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["nothing"], "there is no folder or file nothing"),
        (["empty"], "empty: expected images"),
        (["pictures", "-m", "magic"], "method: expected one of mle"),
        (["pictures", "--model", "none.safetensors"], "none.safetensors"),
        (["pictures", "--model", "cut.safetensors"], "cut.safetensors: expected"),
        (["pictures", "--model", "cube.npy"], "cube.npy: expected"),
        (
            ["pictures", "--model", MODEL, "-m", "mle"],
            "model: replaces the method; leave out --method mle",
        ),
        (["pictures", "--model", MODEL, "-k", 5], "it is for Sensor(oversampling=3, frames=2)"),
        (["pictures", "--model", MODEL, "-q", 2], "got Sensor(oversampling=3, frames=2, threshold"),
        (["pictures", "-m", "mle", "--first", 0], "first: expected at least 1"),
        (["pictures", "-m", "mle", "--key", "a"], "key: names an array in a .npz"),
        (["pictures", "-m", "mle", "-o", "scores.txt"], "ends in .csv"),
        (["pictures", "-m", "mle", "-o", "nowhere/scores.csv"], "there is no folder nowhere"),
        (["pictures", "-m", "mle", "-k", 0], "oversampling: expected"),
        (["cube.npy", "-m", "mle"], "expected a numeric array of images (N, H, W)"),
        (["nan.npy", "-m", "mle"], "finite"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_nothing(
    run, pictures, model, tmp_path, words, expected
):
    whole = (tmp_path / MODEL).read_bytes()
    (tmp_path / "cut.safetensors").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty").mkdir()
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 4, 5), np.uint8))
    np.save(tmp_path / "nan.npy", np.full((2, 12, 12), np.nan))
    before = sorted(tmp_path.rglob("*"))
    status, said = run("evaluate", *words)
    assert status == 1
    assert expected in said
    [line] = said.splitlines()
    assert line.startswith("error: ")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_place_for_the_csv_that_is_not_there_is_found_before_the_work(run, pictures, monkeypatch):
    def worked(*_, **__):
        pytest.fail("an image was exposed")

    monkeypatch.setattr(jl.Sensor, "expose", worked)
    status, said = run("evaluate", pictures, "-m", "mle", "-o", "nowhere/scores.csv")
    assert status == 1
    assert "there is no folder nowhere" in said
