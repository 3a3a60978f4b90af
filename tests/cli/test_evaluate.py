"""`jotlight evaluate`."""

import csv
import hashlib
import json

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.sets import read_image_set
from jotlight.networks.pretrained import FOLDER

MODEL = "model.safetensors"
SENSOR = jl.Sensor(oversampling=3, frames=2)
ITERATIVE = {"admm-tv": jl.admm_tv, "mle-iterative": jl.mle_iterative}


@pytest.fixture
def model(tmp_path):
    network = jl.Network.initial(SENSOR, sigma=1.0)
    network.save(tmp_path / MODEL)
    return network


def table(output):
    """Return PSNR, SNR, and SSIM of each row of the printed table."""
    rows = {}
    for line in output.splitlines():
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


def assert_table(output, result):
    shown, correct = table(output), expected(result)
    assert shown.keys() == correct.keys()
    for title, numbers in shown.items():
        np.testing.assert_allclose(numbers[:2], correct[title][:2], atol=0.005001)
        np.testing.assert_allclose(numbers[2], correct[title][2], atol=0.0005001)


def test_the_color_network_is_not_for_gray_images(run, tmp_path):
    np.save(tmp_path / "images.npy", np.full((1, 12, 12), 0.5, np.float32))
    status, output = run("evaluate", "images.npy", "-m", "network-color")
    assert status == 1
    assert "name another method for gray images, such as network-medium" in output


def test_the_table_shows_the_mean_and_the_worst_of_each_metric(run, tmp_path):
    images = np.random.default_rng(0).random((24, 12, 12), np.float32)
    images *= np.linspace(0.2, 1, 24, dtype=np.float32)[:, None, None]
    np.save(tmp_path / "images.npy", images)
    status, output = run("evaluate", "images.npy", "-m", "mle", "-k", 2)
    assert status == 0
    result = jl.evaluate(jl.mle, images, jl.Sensor(oversampling=2))
    assert result.mean_of_worst("psnr", 0.05) != result.mean_of_worst("psnr", 0.01)
    assert_table(output, result)
    assert "maximum likelihood, 24 images, Sensor(oversampling=2)" in output
    header = next(line for line in output.splitlines() if "PSNR" in line)
    assert header.split() == ["PSNR", "SNR", "SSIM"]


def test_the_default_is_the_trained_network_for_4_x_4_jots(run, photo_folder):
    status, output = run("evaluate", photo_folder)
    assert status == 0
    sensor = jl.Sensor(oversampling=4)
    assert "network, medium, 3 images, Sensor(oversampling=4)" in output
    assert_table(
        output, jl.evaluate(jl.pretrained(sensor), read_image_set(photo_folder)[1], sensor)
    )


def test_seed_and_method_reach_the_evaluation(run, photo_folder):
    status, output = run("evaluate", photo_folder, "-m", "mle", "--seed", 7, "--threads", 1)
    assert status == 0
    sensor = jl.Sensor(oversampling=4)
    assert_table(output, jl.evaluate(jl.mle, read_image_set(photo_folder)[1], sensor, rng=7))


def test_the_csv_has_a_row_for_each_image(run, photo_folder, tmp_path):
    status, output = run("evaluate", photo_folder, "-m", "mle", "-o", "scores.csv")
    assert status == 0
    assert "scores.csv" in output
    with (tmp_path / "scores.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["image"] for row in rows] == ["0.png", "1.png", "2.png"]
    result = jl.evaluate(jl.mle, read_image_set(photo_folder)[1], jl.Sensor(oversampling=4))
    values = [float(row["psnr_db"]) for row in rows]
    np.testing.assert_allclose(values, result.values("psnr"), atol=1e-6)


def test_a_model_sets_the_sensor_and_options_change_it(run, photo_folder, model):
    images = read_image_set(photo_folder)[1]
    for arguments, sensor in (
        ([], SENSOR),
        (["-k", 1, "-t", 18], jl.Sensor(frames=18)),
        (["--dark-counts", 0.2], SENSOR.replace(dark_counts=0.2)),
    ):
        status, output = run("evaluate", photo_folder, "--model", MODEL, *arguments)
        assert status == 0
        assert f"{MODEL}, 3 images, {sensor!r}" in output
        assert_table(output, jl.evaluate(model, images, sensor))


@pytest.mark.parametrize("number", [1, 2, 50])
def test_first_selects_the_first_images_by_name(run, photo_folder, number):
    status, output = run("evaluate", photo_folder, "-m", "mle", "--first", number)
    assert status == 0
    names, images = read_image_set(photo_folder, first=number)
    assert len(names) == min(number, 3)
    assert f"{len(names)} image" in output
    assert_table(output, jl.evaluate(jl.mle, images, jl.Sensor(oversampling=4)))


def test_an_array_of_an_archive_is_selected_by_its_key(run, tmp_path):
    images = np.random.default_rng(0).integers(0, 1024, (2, 3, 12, 12), np.uint16)
    np.savez(tmp_path / "sets.npz", one=images[0], two=images[1])
    arguments = ["evaluate", "sets.npz", "-m", "mle", "--white", 1023]
    status, output = run(*arguments, "--key", "two")
    assert status == 0
    scaled = images[1] / np.float32(1023)
    assert_table(output, jl.evaluate(jl.mle, scaled, jl.Sensor(oversampling=4)))
    status, output = run(*arguments)
    assert status == 1
    assert "one, two" in output


def test_images_too_small_for_ssim_are_evaluated(run, tmp_path):
    np.save(tmp_path / "tiny.npy", np.full((2, 6, 6), 0.5, np.float32))
    status, output = run("evaluate", "tiny.npy", "-m", "mle", "-o", "scores.csv")
    assert status == 0
    assert "Warning" not in output
    assert (tmp_path / "scores.csv").read_text().splitlines()[1].endswith(",")


def test_color_images_are_converted_to_gray(run, tmp_path):
    (tmp_path / "color").mkdir()
    levels = np.random.default_rng(0).integers(0, 256, (12, 13, 3), np.uint8)
    Image.fromarray(levels).save(tmp_path / "color" / "a.png")
    status, output = run("evaluate", "color", "-m", "mle")
    assert status == 0
    images = read_image_set(tmp_path / "color")[1]
    assert images[0].ndim == 2
    assert_table(output, jl.evaluate(jl.mle, images, jl.Sensor(oversampling=4)))


def test_an_unsupported_sensor_gets_the_reason(run, photo_folder):
    options = ["-k", 2, "--kernel", "cubic", "-m", "held-out"]
    status, output = run("evaluate", photo_folder, *options)
    assert status == 1
    assert output.startswith("error: expected the box kernel for a blend on held-out bits, got")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nothing"], "there is no folder or file nothing"),
        (["empty"], "empty: expected images"),
        (["photos", "-m", "magic"], "expected one of mle"),
        (["photos", "--model", "none.safetensors"], "none.safetensors"),
        (["photos", "--model", "cut.safetensors"], "cut.safetensors: expected"),
        (["photos", "--model", "cube.npy"], "cube.npy: expected"),
        (
            ["photos", "--model", MODEL, "-m", "mle"],
            "expected one of --method, --quality, --model, got --method mle and --model model",
        ),
        (["photos", "--model", MODEL, "-k", 5], "it is for Sensor(oversampling=3, frames=2)"),
        (["photos", "--model", MODEL, "-q", 2], "threshold=2); for this sensor, use --quality"),
        (["photos", "-m", "mle", "--first", 0], "first: expected at least 1"),
        (["photos", "-m", "mle", "--key", "a"], "key: names an array in a .npz"),
        (["photos", "-m", "mle", "-o", "scores.txt"], "ends in .csv"),
        (["photos", "-m", "mle", "-o", "nowhere/scores.csv"], "there is no folder nowhere"),
        (["photos", "-m", "mle", "-k", 0], "oversampling: expected"),
        (
            ["cube.npy", "-m", "mle"],
            "cube.npy: expected gray images (N, H, W), got shape (2, 3, 4, 5)",
        ),
        (["nan.npy", "-m", "mle"], "finite"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_no_files(
    run, photo_folder, model, tmp_path, arguments, expected
):
    whole = (tmp_path / MODEL).read_bytes()
    (tmp_path / "cut.safetensors").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty").mkdir()
    np.save(tmp_path / "cube.npy", np.zeros((2, 3, 4, 5), np.uint8))
    np.save(tmp_path / "nan.npy", np.full((2, 12, 12), np.nan))
    before = sorted(tmp_path.rglob("*"))
    status, output = run("evaluate", *arguments)
    assert status == 1
    assert expected in output
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_missing_folder_for_the_csv_is_found_before_the_work(run, photo_folder, monkeypatch):
    def worked(*_, **__):
        pytest.fail("an image was exposed")

    monkeypatch.setattr(jl.Sensor, "expose", worked)
    status, output = run("evaluate", photo_folder, "-m", "mle", "-o", "nowhere/scores.csv")
    assert status == 1
    assert "there is no folder nowhere" in output


@pytest.mark.parametrize("method", ITERATIVE)
def test_evaluate_writes_the_scores_of_the_iterative_methods(run, photo_folder, tmp_path, method):
    status, output = run("evaluate", photo_folder, "-m", method, "-o", "scores.csv")
    assert status == 0
    assert f"{METHODS[method].title}, 3 images, Sensor(oversampling=4)" in output
    with (tmp_path / "scores.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["image"] for row in rows] == ["0.png", "1.png", "2.png"]
    images = read_image_set(photo_folder)[1]
    result = jl.evaluate(ITERATIVE[method], images, jl.Sensor(oversampling=4))
    scores = [float(row["psnr_db"]) for row in rows]
    np.testing.assert_allclose(scores, result.values("psnr"), atol=1e-3)


def test_a_function_in_the_current_folder_is_evaluated(run, photo_folder, tmp_path, own_module):
    status, output = run("evaluate", photo_folder, "-m", f"{own_module}:mean", "-k", 2)
    assert status == 0, output
    assert f"{own_module}:mean, 3 images, Sensor(oversampling=2)" in output
    images = read_image_set(photo_folder)[1]
    own = jl.evaluate(lambda bits: bits.counts() / 4, images, jl.Sensor(oversampling=2))
    assert_table(output, own)
    status, output = run("evaluate", photo_folder, "-m", f"{own_module}:fails")
    assert status == 1
    assert f"{own_module}:fails raised ZeroDivisionError" in output


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (("-m", "own_cli_module"), 1, "MODULE:FUNCTION to the commands compare"),
        (("-m", "own_cli_module.py:mean"), 1, "did you mean own_cli_module:mean?"),
        (("-m", "mle", "-m", "admm-tv"), 2, "specified multiple times"),
    ],
)
def test_a_method_that_is_no_single_function_is_refused(
    run, photo_folder, own_module, options, status, message
):
    code, output = run("evaluate", photo_folder, *options)
    assert code == status
    assert message in " ".join(output.split())


def test_a_quality_selects_the_trained_network(run, photo_folder):
    status, output = run("evaluate", photo_folder, "--quality", "small")
    assert status == 0
    assert output == run("evaluate", photo_folder, "-m", "network-small")[1]
    status, output = run("evaluate", photo_folder, "--quality", "small", "-m", "mle")
    assert status == 1
    assert "expected one of --method, --quality, --model" in output


@pytest.mark.parametrize("arguments", [["-k", 1, "-t", 300], ["-k", 40]])
def test_more_than_256_bits_per_pixel_are_evaluated(run, photo_folder, arguments):
    status, output = run("evaluate", photo_folder, *arguments, "--quality", "medium")
    assert status == 0, output
    few = table(run("evaluate", photo_folder, "--quality", "medium", "-k", 8)[1])
    assert table(output)["mean"][0] > few["mean"][0]


@pytest.mark.filterwarnings("always")
def test_a_file_of_gray_levels_is_reported_once_by_its_name(run, photo_folder):
    np.save(photo_folder / "levels.npy", np.full((24, 24), 200.0))
    arguments = ["evaluate", photo_folder, "-m", "mle"]
    status, output = run(*arguments)
    assert status == 0
    expected = f"{photo_folder / 'levels.npy'}: most intensities should be at most max_intensity=1,"
    assert expected in output
    assert output.count("most intensities") == 1
    assert "; for an integer image, pass --white 255\n" in output
    assert "most intensities" not in run(*arguments, "--max-intensity", 255)[1]
    assert "most intensities" not in run(*arguments, "--white", 255)[1]


def test_the_precision_of_the_products_is_an_option(run, tmp_path):
    image = np.random.default_rng(1).random((1, 32, 32), np.float32)
    np.save(tmp_path / "images.npy", image)
    arguments = ["evaluate", "images.npy", "--quality", "small", "-k", 2, "--precision"]
    for precision in ("f32", "bf16"):
        assert run(*arguments, precision, "-o", f"{precision}.csv")[0] == 0
        jl.evaluate(
            "network-small", image, jl.Sensor(oversampling=2), names=["0"], precision=precision
        ).write_csv(tmp_path / "expected.csv")
        names = f"{precision}.csv", "expected.csv"
        found, expected = ((tmp_path / name).read_text(encoding="utf-8") for name in names)
        assert found == expected
    assert (tmp_path / "f32.csv").read_bytes() != (tmp_path / "bf16.csv").read_bytes()


def test_a_record_beside_the_scores_states_their_origin(run, photo_folder, model, tmp_path):
    options = ["-o", "s.csv", "--seed", 7, "--first", 2, "--model", MODEL, "--threads", 1]
    assert run("evaluate", photo_folder, *options)[0] == 0
    record = json.loads((tmp_path / "s.csv.json").read_text())
    assert record["sha256"] == file_checksum(tmp_path / "s.csv")
    origin = record["origin"]
    assert origin["photographs"].endswith(", 2 images")
    assert origin["options"] == {"seed": 7, "first": 2}
    assert (origin["method"], origin["model"]) == ("network", MODEL)
    assert origin["weights_sha256"] == file_checksum(tmp_path / MODEL)
    assert origin["sensor"] == SENSOR.scalars()
    assert origin["software"] == f"jotlight {jl.__version__}"
    shown = run("info", "s.csv")[1]
    assert "scores" in shown
    assert "seed=7, first=2" in shown
    files = sorted(photo_folder.iterdir())[:2]
    joint = hashlib.sha256("".join(map(file_checksum, files)).encode()).hexdigest()
    assert origin["photographs_sha256"] == joint


def test_the_record_states_the_weights_of_a_pretrained_network(run, tmp_path):
    np.save("images.npy", np.full((1, 20, 20), 0.5))
    assert run("evaluate", "images.npy", "-o", "s.csv", "--quality", "small")[0] == 0
    origin = json.loads((tmp_path / "s.csv.json").read_text())["origin"]
    assert origin["weights_sha256"] == file_checksum(FOLDER / "small-k16.safetensors")
    assert origin["photographs_sha256"] == file_checksum(tmp_path / "images.npy")


def test_a_file_that_is_no_record_is_kept(run, photo_folder, tmp_path):
    (tmp_path / "s.csv.json").write_text("{}")
    status, output = run("evaluate", photo_folder, "-o", "s.csv", "-m", "mle")
    assert status == 1
    assert "s.csv.json: the record of the result belongs here" in output
