import csv
import math

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.evaluate import METRICS, Evaluation, Score
from jotlight.sensing.parameters.mosaic import Mosaic

SENSOR = jl.Sensor(oversampling=2, frames=2)
IMAGES = [np.random.default_rng(i).random((12 + i, 14), np.float32) for i in range(4)]


def evaluation_of(*values):
    return Evaluation([Score(str(i), value, value / 2, value / 100) for i, value in values])


def test_each_score_is_that_of_one_image_with_the_next_seed():
    result = jl.evaluate(jl.mle, IMAGES, SENSOR, rng=5)
    for number, (score, image) in enumerate(zip(result.scores, IMAGES, strict=True)):
        estimate = jl.mle(SENSOR.expose(image, rng=5 + number), SENSOR)
        assert score == Score(
            str(number),
            jl.metrics.psnr(estimate, image),
            jl.metrics.snr(estimate, image),
            jl.metrics.ssim(estimate, image),
        )


def test_the_default_seed_is_0_and_another_seed_changes_the_scores():
    one, other = (jl.evaluate(jl.mle, IMAGES, SENSOR, rng=seed) for seed in (0, 1))
    assert jl.evaluate(jl.mle, IMAGES, SENSOR) == one
    assert (one.values("psnr") != other.values("psnr")).all()


def test_an_array_and_a_list_of_images_are_scored_alike():
    stack = np.stack([image[:12] for image in IMAGES])
    assert jl.evaluate(jl.mle, stack, SENSOR) == jl.evaluate(jl.mle, list(stack), SENSOR)


def test_a_network_is_scored_like_its_reconstruction():
    network = jl.Network.initial(SENSOR, sigma=1.0)
    assert jl.evaluate(network, IMAGES, SENSOR) == jl.evaluate(network.reconstruct, IMAGES, SENSOR)


def test_the_argument_sensor_exposes_the_images_and_not_the_network_s_own():
    network = jl.Network.initial(SENSOR)
    noisy = SENSOR.replace(dark_counts=0.5)
    result = jl.evaluate(network, IMAGES[:1], noisy)
    estimate = network.reconstruct(noisy.expose(IMAGES[0], rng=0), noisy)
    assert result.scores[0].psnr == jl.metrics.psnr(estimate, IMAGES[0])


def test_color_images_are_scored():
    image = np.random.default_rng(9).random((12, 13, 3), np.float32)
    [score] = jl.evaluate(jl.mle, [image], SENSOR, channel_axis=-1).scores
    estimate = jl.mle(SENSOR.expose(image, rng=0, channel_axis=-1), SENSOR)
    assert (score.psnr, score.ssim) == (
        jl.metrics.psnr(estimate, image),
        jl.metrics.ssim(estimate, image, channel_axis=-1),
    )


def test_images_of_a_mosaic_have_their_colors_on_the_last_axis():
    sensor = SENSOR.replace(mosaic="RGGB")
    images = np.random.default_rng(9).random((2, 12, 13, 3), np.float32)
    result = jl.evaluate("mle", images, sensor, channel_axis=-1)
    assert jl.evaluate("mle", images, sensor) == jl.evaluate("mle", list(images), sensor) == result
    estimate = jl.reconstruct(sensor.expose(images[0], rng=0), sensor, method="mle")
    expected = jl.metrics.ssim(estimate, images[0], channel_axis=-1)
    assert result.scores[0].ssim == expected
    with pytest.raises(ValueError, match="image: expected red, green, and blue"):
        jl.evaluate("mle", list(images[..., 0]), sensor)


def test_the_white_balance_changes_no_score():
    image = np.random.default_rng(9).random((12, 13, 3), np.float32)
    factors = np.float32([1.25, 1.0, 1.5])
    sensor = SENSOR.replace(mosaic=Mosaic("RGGB", white_balance=factors))
    balanced = jl.reconstruct(sensor.expose(image, rng=0), method="mle")
    [score] = jl.evaluate("mle", [image], sensor).scores
    assert score.psnr == pytest.approx(jl.metrics.psnr(balanced / factors, image), abs=1e-4)
    assert score.ssim == pytest.approx(jl.metrics.ssim(balanced / factors, image, channel_axis=-1))
    assert jl.metrics.psnr(balanced, image) < score.psnr - 0.5


def test_the_method_receives_sensor_and_threads():
    calls = []

    def method(bits, sensor, *, threads):
        calls.append((bits.shape, sensor, threads))
        return np.zeros(IMAGES[0].shape, np.float32)

    jl.evaluate(method, IMAGES[:1], SENSOR, threads=1)
    assert calls == [((2, 24, 28), SENSOR, 1)]


def test_threads_do_not_change_the_scores():
    results = [jl.evaluate(jl.mle, IMAGES, SENSOR, threads=threads) for threads in (1, 2, None)]
    assert results[0] == results[1] == results[2]


def test_progress_is_called_after_each_image():
    fractions = []
    jl.evaluate(jl.mle, IMAGES, SENSOR, progress=fractions.append)
    assert fractions == [0.25, 0.5, 0.75, 1.0]


def test_mean_is_over_the_images():
    result = jl.evaluate(jl.mle, IMAGES, SENSOR)
    for metric in METRICS:
        values = [getattr(score, metric) for score in result.scores]
        assert result.values(metric).tolist() == values
        assert result.mean(metric) == pytest.approx(sum(values) / 4)


@pytest.mark.parametrize(
    ("number", "fraction", "worst"),
    [
        (1, 0.01, 1), (20, 0.05, 1), (21, 0.05, 2), (100, 0.05, 5), (100, 0.01, 1),
        (101, 0.01, 2), (100, 0.051, 6), (7, 0.5, 4), (7, 1, 7),
    ],
)  # fmt: skip
def test_the_number_of_worst_images_is_rounded_up(number, fraction, worst):
    order = np.random.default_rng(number).permutation(number)
    result = evaluation_of(*((i, float(20 + i)) for i in order))
    expected = np.mean(20 + np.arange(worst))
    assert result.mean_of_worst("psnr", fraction) == pytest.approx(expected, rel=1e-12)
    assert result.mean_of_worst("snr", fraction) == pytest.approx(expected / 2, rel=1e-12)
    assert result.mean_of_worst("ssim", fraction) == pytest.approx(expected / 100, rel=1e-12)


def test_the_rounding_error_of_a_fraction_adds_no_image():
    # 0.07 x 100 is 7.000000000000001 in binary.
    result = evaluation_of(*((i, float(i)) for i in range(100)))
    assert result.mean_of_worst("psnr", 0.07) == np.mean(range(7))


def test_each_metric_has_its_own_worst_images():
    result = Evaluation([Score("a", 10.0, 30.0, 0.9), Score("b", 20.0, 5.0, 0.2)])
    worst = [result.mean_of_worst(metric, 0.5) for metric in METRICS]
    assert worst == [10.0, 5.0, 0.2]


@pytest.mark.parametrize("fraction", [0, -0.1, 1.01, math.nan, "0.5", None])
def test_a_fraction_outside_its_range_is_refused(fraction):
    with pytest.raises(ValueError, match=r"fraction: expected a number in \(0, 1\]"):
        evaluation_of((0, 1.0)).mean_of_worst("psnr", fraction)


def test_an_unknown_metric_is_refused():
    with pytest.raises(ValueError, match="metric: expected one of psnr, snr, ssim, got 'mse'"):
        evaluation_of((0, 1.0)).mean("mse")


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_csv_has_a_row_for_each_image_in_order(tmp_path):
    names = ["b.png", "a.png", 'with, comma and "quotes".png', "σ.png"]
    result = jl.evaluate(jl.mle, IMAGES, SENSOR, names=names)
    path = tmp_path / "scores.csv"
    result.write_csv(path)
    assert path.read_text(encoding="utf-8").splitlines()[0] == "image,psnr_db,snr_db,ssim"
    rows = read(path)
    assert [row["image"] for row in rows] == names
    for row, score in zip(rows, result.scores, strict=True):
        back = [float(row[name]) for name in ("psnr_db", "snr_db", "ssim")]
        assert back == pytest.approx([score.psnr, score.snr, score.ssim], abs=5.1e-7)


def test_the_name_of_the_csv_is_a_text_or_a_path(tmp_path):
    result = evaluation_of((0, 20.0))
    result.write_csv(str(tmp_path / "text.csv"))
    result.write_csv(tmp_path / "path.csv")
    assert read(tmp_path / "text.csv") == read(tmp_path / "path.csv")
    with pytest.raises(TypeError, match=r'as in evaluation.write_csv\("scores.csv"\), got int'):
        result.write_csv(3)


def test_images_too_small_for_ssim_have_no_value_and_a_blank_in_the_csv(tmp_path):
    result = jl.evaluate(jl.mle, [np.full((10, 30), 0.5), np.full((11, 11), 0.5)], SENSOR)
    assert result.scores[0].ssim is None
    assert result.scores[1].ssim is not None
    assert np.isnan(result.values("ssim")).tolist() == [True, False]
    assert math.isfinite(result.mean("psnr"))
    assert math.isnan(jl.evaluate(jl.mle, np.full((2, 4, 4), 0.5), SENSOR).mean("ssim"))
    result.write_csv(tmp_path / "scores.csv")
    blank, full = read(tmp_path / "scores.csv")
    assert blank["ssim"] == ""
    assert float(full["ssim"]) == pytest.approx(result.scores[1].ssim, abs=1e-6)


def test_the_means_of_ssim_are_over_the_images_that_have_one():
    scores = [Score(str(i), 20.0, 15.0, ssim) for i, ssim in enumerate([None, 0.5, 0.75, None])]
    result = Evaluation(scores)
    assert (result.mean("ssim"), result.mean_of_worst("ssim", 0.5)) == (0.625, 0.5)
    assert [row[-1] for row in result.rows()] == [
        "0.625 (2 of 4 images)",
        "0.500 (2 of 4 images)",
        "0.500 (2 of 4 images)",
    ]
    assert [row[-1] for row in Evaluation(scores[:1]).rows()] == ["none"] * 3


def test_a_perfect_estimate_has_an_infinite_psnr_also_in_the_csv(tmp_path):
    result = jl.evaluate(lambda bits, sensor, threads: IMAGES[0], IMAGES[:1], SENSOR)
    assert result.mean("psnr") == math.inf
    result.write_csv(tmp_path / "scores.csv")
    assert float(read(tmp_path / "scores.csv")[0]["psnr_db"]) == math.inf


@pytest.mark.parametrize(
    ("images", "options", "error", "message"),
    [
        ([], {}, ValueError, "images: expected at least one, got none"),
        (np.empty((0, 4, 4)), {}, ValueError, "images: expected at least one, got none"),
        (IMAGES, {"names": ["a"]}, ValueError, "names: expected one for each of 4 images, got 1"),
        (IMAGES, {"names": 1}, TypeError, "names: expected a list with a name .*, got 1"),
        (IMAGES, {"names": "abcd"}, TypeError, "names: expected a list with a name .*, got 'abcd'"),
        ([np.zeros((4, 4), int)], {}, TypeError, "image: expected floats"),
        ([np.full((4, 4), np.nan)], {}, ValueError, "finite"),
        (np.ma.ones((2, 4, 4)), {}, TypeError, "images: .* got a masked one"),
        ([np.zeros((0, 4))], {}, ValueError, "image: expected"),
        ([np.zeros(4)], {}, ValueError, "images: expected a list"),
        (np.zeros((9, 8, 3)), {}, ValueError, r"shape \(9, 8, 3\) looks like color; put one"),
        (np.zeros((9, 8, 3)), {"channel_axis": -1}, ValueError, "put one image in a list"),
        (IMAGES, {"rng": -1}, ValueError, "rng"),
    ],
)
def test_invalid_input_is_refused(images, options, error, message):
    with pytest.raises(error, match=message):
        jl.evaluate(jl.mle, images, SENSOR, **options)


def test_a_network_for_another_sensor_is_refused():
    with pytest.raises(ValueError, match="sensor: the network needs data with its own trials"):
        jl.evaluate(jl.Network.initial(SENSOR), IMAGES, jl.Sensor(oversampling=3))


@pytest.mark.parametrize("images", ["folder", None])
def test_anything_but_a_list_of_images_is_refused(images):
    with pytest.raises(TypeError, match="images: expected an array"):
        jl.evaluate("mle", images, jl.Sensor())


def test_anything_but_a_sensor_is_refused():
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, .*got 8"):
        jl.evaluate("mle", [np.full((16, 16), 0.5)], 8)


def test_a_network_is_evaluated_in_the_requested_precision():
    network = jl.pretrained(SENSOR, "small")
    expected = jl.evaluate(network.with_precision("bf16"), IMAGES[:1], SENSOR)
    assert jl.evaluate("network-small", IMAGES[:1], SENSOR, precision="bf16") == expected
    assert jl.evaluate("network-small", IMAGES[:1], SENSOR) != expected
    with pytest.raises(ValueError, match="precision: expected f32 for mle, got bf16"):
        jl.evaluate("mle", IMAGES[:1], SENSOR, precision="bf16")


def test_a_stack_in_a_list_is_no_image():
    for shape in ((4, 8, 8), (2, 2, 8, 8)):
        with pytest.raises(ValueError, match=r"each image of shape \(H, W\), got shape .* index 1"):
            jl.evaluate("mle", [np.ones((8, 8)), np.ones(shape)], SENSOR)
    with pytest.raises(ValueError, match=r"\(H, W\) and an axis of channels, got shape"):
        jl.evaluate("mle", [np.ones((2, 8, 8, 3))], SENSOR, channel_axis=-1)


def test_a_bool_is_no_seed():
    with pytest.raises(TypeError, match=r"rng: expected an int, .* got True"):
        jl.evaluate("mle", [np.ones((8, 8))], SENSOR, rng=True)


def test_evaluations_of_equal_scores_are_equal():
    results = [jl.evaluate("mle", [np.full((8, 8), 0.5)], SENSOR) for _ in range(2)]
    assert results[0] == results[1]
    assert hash(results[0]) == hash(results[1])
