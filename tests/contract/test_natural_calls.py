"""Calls as newcomers type them: each works the first time, or says what to write instead."""

import importlib
import pickle
import re
import warnings

import matplotlib as mpl
import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.sensing.parameters.provenance import Provenance

SENSOR = jl.Sensor(frames=16)
IMAGE = jl.datasets.photograph()[100:164, 180:260]
BITS = SENSOR.expose(IMAGE, rng=0)
COUNTS = BITS.counts()


def test_estimates_need_nothing_but_the_data():
    best = jl.reconstruct(BITS)
    network = jl.pretrained(SENSOR)
    for same in (network.reconstruct(COUNTS), network(COUNTS), network(BITS)):
        np.testing.assert_array_equal(same, best)
    assert jl.metrics.psnr(best, IMAGE, data_range=1) > 25
    assert jl.mle(BITS).shape == IMAGE.shape


def test_stacks_and_colors_are_estimated_at_once():
    stack = np.stack([COUNTS, COUNTS[::-1]])
    estimates = jl.mle(stack, SENSOR)
    assert estimates.shape == stack.shape
    np.testing.assert_array_equal(estimates[1], jl.mle(stack[1], SENSOR))
    np.testing.assert_array_equal(jl.pretrained(SENSOR)(stack)[0], jl.reconstruct(BITS))
    np.testing.assert_array_equal(jl.mle(SENSOR.expose([IMAGE, IMAGE], rng=0))[0], jl.mle(BITS))
    color = jl.datasets.photograph("coffee")[:64, :80]
    bits = SENSOR.expose(color, rng=0, channel_axis=-1)
    assert jl.reconstruct(bits).shape == color.shape
    with pytest.raises(ValueError, match="looks like color; pass channel_axis=-1"):
        SENSOR.expose(color, rng=0)
    with pytest.raises(ValueError, match="looks like color; pass channel_axis=-1"):
        jl.mle(np.zeros((64, 80, 4), int), SENSOR)


def test_own_functions_estimate_each_channel_and_each_image_of_a_stack():
    counts = np.stack([COUNTS, COUNTS[::-1], COUNTS[:, ::-1], COUNTS, COUNTS], axis=-1)
    expected = jl.reconstruct(counts, SENSOR, channel_axis=-1, method="noniterative-tv")
    found = jl.reconstruct(counts, SENSOR, channel_axis=-1, method=jl.noniterative)
    np.testing.assert_array_equal(found, expected)
    stack = np.moveaxis(counts, -1, 0)
    np.testing.assert_array_equal(
        jl.reconstruct(stack, SENSOR, method=lambda counts: counts / 16), np.float32(stack / 16)
    )


@pytest.mark.parametrize("wrong", ["medium", 16])
def test_networks_are_chosen_by_a_sensor(wrong):
    with pytest.raises(TypeError, match=r"such as Sensor\(frames=16\), got"):
        jl.pretrained(wrong)


def test_a_stack_is_not_taken_for_colors():
    with pytest.raises(ValueError, match="pass a list of Merged for a stack"):
        jl.Merged(np.stack([COUNTS] * 3), 16, SENSOR)
    for channels in (3, 4):
        color = np.stack([COUNTS] * channels, -1)
        with pytest.raises(ValueError, match="looks like color; pass channel_axis=-1"):
            jl.Merged(color, 16, SENSOR)
        assert jl.mle(jl.Merged(color, 16, SENSOR, channel_axis=-1)).shape == color.shape
    maps = np.full(COUNTS.shape, 16.0)
    estimates = jl.mle(np.stack([COUNTS] * 2), SENSOR, trials=maps)
    np.testing.assert_array_equal(estimates[1], jl.mle(COUNTS, SENSOR))


@pytest.mark.slow
def test_the_uncertainty_of_a_stack_shows_its_first_image():
    for shape, axis in (((2, 64, 80), None), ((2, 3, 64, 80), 1), ((2, 3, 64, 80), None)):
        counts = np.broadcast_to(COUNTS, shape)
        known = jl.uncertainty(counts, SENSOR, channel_axis=axis)
        assert known.low.shape == shape
        assert "<img" in known._repr_html_()
        known.plot()


def test_networks_of_files_need_the_sensor_if_they_serve_many(tmp_path):
    jl.pretrained(SENSOR).save(tmp_path / "mine.safetensors")
    network = jl.Network.load(tmp_path / "mine.safetensors")
    np.testing.assert_array_equal(network(COUNTS, SENSOR), jl.reconstruct(BITS))
    with pytest.raises(TypeError, match=r"pass the sensor .* Sensor\(frames=16\)"):
        network(COUNTS)


@pytest.fixture
def mosaic():
    """Return simulated bits under a Bayer mosaic."""
    light = np.full((128, 128), 0.2)
    light[::2, 1::2] = light[1::2, ::2] = 0.4
    return SENSOR.expose(light, rng=0)


CALLS = {
    "reconstruct": jl.reconstruct,
    "mle": jl.mle,
    "noniterative": jl.noniterative,
    "uncertainty": jl.uncertainty,
    "network": lambda data, sensor: jl.pretrained(sensor)(data, sensor),
    "named method": lambda data, sensor: jl.reconstruct(data, sensor, method="network-initial"),
    "function": lambda data, sensor: (
        jl.reconstruct(data, method=lambda bits: jl.mle(bits, sensor))
        if isinstance(data, jl.Bits)
        else jl.reconstruct(data, sensor, method="held-out")
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_a_mosaic_of_a_camera_is_reported_once(mosaic, call):
    captured = jl.Bits.from_array(mosaic.to_array(), SENSOR)
    for data in (captured, mosaic.counts(), np.stack([mosaic.counts()] * 2)):
        with pytest.warns(jl.PeriodicRatesWarning, match="filters of a Bayer mosaic") as found:
            call(data, SENSOR)
        assert len(found) == 1
    call(captured, SENSOR)  # bits are tested once
    call(captured[:16], SENSOR)
    call(mosaic, SENSOR)  # the sensor of simulated bits is gray
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.PeriodicRatesWarning)
        call(mosaic.counts(), SENSOR)


@pytest.mark.slow
def test_a_mosaic_is_reported_for_lists_and_merged_bits(mosaic):
    for call in (jl.mle, jl.reconstruct):
        captured = jl.Bits.from_array(mosaic.to_array(), SENSOR)
        with pytest.warns(jl.PeriodicRatesWarning):
            call([mosaic, captured])
    counts = CountStack(mosaic.to_array().astype(np.uint8), Provenance("npy", "a.npy"), trials=1)
    for data in (jl.Bits.from_array(mosaic.to_array()), counts):
        with pytest.warns(jl.PeriodicRatesWarning):
            jl.merge(data)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jl.Network("mine.safetensors"), r"Network\.load\(path\) reads a network file"),
        (lambda: jl.plan("a.npy", (0.01, 1)), r"sensor: expected a jotlight\.Sensor.*got 'a\.npy'"),
        (lambda: jl.plan(SENSOR, "0.01:1"), r"light: expected a number .* such as \(0\.01, 1\)"),
        (lambda: jl.compare("mle", "a.png", SENSOR), r"pass jotlight\.read_image\(path\)"),
        (lambda: jl.compare("mle", IMAGE, "a.npy"), r"sensor: expected a jotlight\.Sensor"),
        (lambda: jl.reconstruct(BITS, wieght=2), r"wieght: .* did you mean weight\?"),
    ],
)
def test_wrong_types_say_what_to_write(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_pytorch_is_found_when_it_is_installed():
    pytest.importorskip("torch")
    assert jl.torch.Network(jl.pretrained(SENSOR)) is not None
    with pytest.raises(AttributeError, match="no attribute 'tensorflow'"):
        jl.tensorflow  # noqa: B018


def test_bits_are_like_an_array(monkeypatch):
    mpl.use("agg")
    import matplotlib.pyplot as plt

    frames = np.asarray(BITS)
    assert frames.shape == (16, *IMAGE.shape)
    np.testing.assert_array_equal(BITS[0], frames[0])
    assert sum(int(frame.sum()) for frame in BITS) == COUNTS.sum()
    assert len(BITS) == 16
    plt.imshow(COUNTS)
    monkeypatch.setattr(plt, "show", lambda: None)
    BITS.show()
    plt.close("all")
    assert "<img" in BITS._repr_html_()
    assert "<table>" in SENSOR._repr_html_()


def test_integer_counts_can_be_denoised():
    assert jl.denoise.tv(COUNTS).mean() == pytest.approx(COUNTS.mean(), rel=0.01)


def test_objects_can_be_copied_and_compared(tmp_path):
    assert hash(SENSOR) == hash(jl.Sensor(frames=16))
    (tmp_path / "a.bin").write_bytes(np.zeros((3, 256, 64), np.uint8).tobytes())
    capture = jl.open(tmp_path / "a.bin", format="swissspad2")
    assert pickle.loads(pickle.dumps(capture)).shape == capture.shape
    assert pickle.loads(pickle.dumps(BITS)).shape == BITS.shape


def test_images_are_read_and_saved(tmp_path):
    jl.save_image(tmp_path / "a.png", IMAGE)
    np.testing.assert_allclose(jl.read_image(tmp_path / "a.png"), IMAGE, atol=1 / 255)


def test_a_function_is_compared_with_other_methods():
    found = jl.compare({"mine": lambda bits: bits.counts() / 16, "mle": "mle"}, IMAGE, SENSOR)
    assert [result.method for result in found.results] == ["mine", "mle"]
    assert "PSNR" in str(found)


def test_calls_that_cannot_work_say_what_to_write():
    with pytest.raises(TypeError, match=r"with names as in Sensor\(frames=16\)"):
        jl.Sensor(16)
    with pytest.raises(TypeError, match=r"such as Sensor\(frames=16\) for 16 trials per pixel"):
        jl.mle(COUNTS, 200)
    with pytest.raises(TypeError, match=r"such as Sensor\(frames=16\) for 16 trials per pixel"):
        jl.mle(COUNTS)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: jl.Sensor(gains=2), TypeError, r"got gains; did you mean gain\?"),
        (lambda: SENSOR.replace(frame=2), TypeError, r"got frame; did you mean frames\?"),
        (lambda: jl.mle(BITS.to_array()), TypeError, r"Bits\.from_array\(frames, sensor\)"),
        (lambda: jl.mle(BITS.to_array(), SENSOR), TypeError, r"Bits\.from_array\(frames, sensor\)"),
        (
            lambda: jl.open(COUNTS),
            TypeError,
            r'as in jotlight\.open\("capture\.npy"\), got ndarray',
        ),
        (lambda: jl.save("a.npy", BITS), TypeError, r"jotlight\.save\(bits, .*got Bits"),
        (lambda: jl.save_image(IMAGE, "a.png"), TypeError, r"save_image\(.*, image\), got ndarray"),
        (lambda: jl.save_film([IMAGE], "a.gif"), TypeError, r"save_film\(.*, images\), got list"),
        (lambda: jl.read_image(IMAGE), TypeError, r"read_image\(\"photo\.png\"\), got ndarray"),
        (lambda: jl.train([IMAGE], SENSOR), TypeError, r"jotlight\.train\(.*got list"),
        (lambda: jl.Network.load("medium"), OSError, r"quality=medium .* pretrained network"),
        (lambda: jl.find_hot_jots(BITS), AttributeError, r"jotlight\.calibration\.find_hot_jots"),
        (
            lambda: jl.Bits.from_array(np.zeros((2, 3, 9, 8), bool)),
            ValueError,
            r"at most 4 channels, got \(2, 3, 9, 8\); for a stack .* list of Bits",
        ),
        (lambda: jl.imread("a.png"), AttributeError, r"write jotlight\.read_image"),
        (
            lambda: jl.pretrained(SENSOR).eval(),
            AttributeError,
            r"jotlight\.torch\.Network\(network\)",
        ),
        (lambda: jl.pretrained(SENSOR).predict(COUNTS), AttributeError, r"network\(counts\)"),
    ],
)
def test_habits_of_other_libraries_lead_to_the_call(call, error, message):
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("simulate", "Sensor(frames=16).expose"),
        ("fine_tune", "torch.fine_tune"),
        ("convert", "save(jotlight.open(path)"),
        ("view", "open(path).show(viewer=True)"),
        ("info", "open(path)"),
        ("load", "open(path)"),
        ("psnr", "metrics.psnr"),
        ("show", "save_image(path"),
    ],
)
def test_names_of_commands_and_of_other_libraries_lead_to_a_call_that_exists(name, call):
    with pytest.raises(AttributeError, match=re.escape(f"{name!r}; write jotlight.{call}")):
        jl.__getattr__(name)  # another test may have imported jotlight.view
    if call.startswith("torch."):
        pytest.importorskip("torch")
    names = re.match(r"[\w.]+", call)[0].split(".")
    module = importlib.import_module(".".join(["jotlight", *names[:-1]]))
    assert callable(getattr(module, names[-1]))


@pytest.mark.parametrize("make", [jl.operators.spread, jl.operators.differences])
@pytest.mark.parametrize("shape", [64, 8.0, None, (8.0, 8.0), "88", jl.Sensor()])
def test_anything_but_a_shape_is_refused_with_what_to_pass(make, shape):
    with pytest.raises(TypeError, match=r"shape: expected \(H, W\) or \(N,\) .*; pass image.shape"):
        make(shape)
