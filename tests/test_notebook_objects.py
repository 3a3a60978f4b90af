"""Results in notebooks and in terminals: short texts, small tables, thumbnails, and figures."""

import copy
import html.parser
import re

import numpy as np
import pytest

import jotlight as jl
from jotlight.figures import Figure
from jotlight.formats.reading import open_capture
from jotlight.motion.films.film import film
from jotlight.training import History, Record
from moving import in_memory

SENSOR = jl.Sensor(oversampling=2, frames=16)
IMAGE = jl.datasets.photograph("camera")[100:148, 150:214]
BITS = SENSOR.expose(IMAGE, rng=0)
RANDOM = np.random.default_rng(0)
HISTORY = History(
    [Record(n, 2.0**-n, 3.0**-n, 20.0 + n if n % 5 == 0 else None) for n in range(11)]
)
PLAN = jl.plan(jl.Sensor(), (0.05, 1.0), target_psnr=30.0)
UNCERTAINTY = jl.uncertainty(BITS)
CALIBRATION = jl.calibrate(
    RANDOM.binomial(1000, 0.01, (40, 50)), RANDOM.binomial(1000, 0.4, (40, 50)), frames=1000
)


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Return every kind of public result, by the name of its type."""
    scene = jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=32), shape=(64, 96), photons=0.5, rng=0
    )
    bits = in_memory(scene)
    motion = jl.align(bits)
    info = jl.reconstruct(BITS, method="admm-tv", return_info=True)[1]
    path = tmp_path_factory.mktemp("counts") / "counts.npy"
    np.save(path, np.stack([part.counts() for part in BITS.windows(4)]).astype(np.uint16))
    comparison = jl.compare(["mle", "noniterative-gaussian"], IMAGE, SENSOR)
    network = jl.pretrained(SENSOR)
    found = [
        *(SENSOR, BITS, network, network.layers[3], HISTORY, HISTORY.records[0], PLAN),
        *(UNCERTAINTY, CALIBRATION, scene, motion, jl.merge(bits, motion=motion)),
        *(next(film(bits, window=32)), comparison, comparison.results[0], info),
        *(info.history, jl.evaluate("mle", [IMAGE] * 30, SENSOR), open_capture(path)),
    ]
    return {type(each).__name__: each for each in found}


FEATURES = {
    "Sensor": "html",
    "Bits": "html image",
    "Network": "html image plot",
    "Layer": "",
    "History": "html image plot",
    "Record": "",
    "Plan": "html image plot",
    "Uncertainty": "html image plot",
    "Calibration": "html image plot",
    "MovingScene": "",
    "Motion": "html image plot",
    "Merged": "html image",
    "FilmImage": "",
    "Comparison": "html image plot",
    "MethodResult": "",
    "Info": "",
    "ConvergenceHistory": "html image plot",
    "Evaluation": "html",
    "CountStack": "html image",
}
"""What each object shows beside its text: a table in HTML, an image above it, a figure."""


def objects_with(feature):
    """Return the names of the objects with a feature."""
    return [name for name, features in FEATURES.items() if feature in features]


class Tags(html.parser.HTMLParser):
    """A parser that checks that all tags are closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], []

    def handle_starttag(self, tag, attrs):
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def text_of(shown):
    """Return the texts in HTML, whose tags must be closed."""
    parser = Tags()
    parser.feed(shown)
    assert parser.open == []
    return " ".join(parser.text)


@pytest.mark.parametrize("name", FEATURES)
def test_the_text_of_an_object_is_short(objects, name):
    for text in (repr(objects[name]), str(objects[name])):
        assert len(text) < 250
        assert "array(" not in text
        assert " at 0x" not in text


DRAWN = {}
"""The objects that were shown, and their HTML, by identity."""


def html_of(shown):
    """Return the HTML of an object, whose thumbnail is drawn once."""
    if id(shown) not in DRAWN:
        DRAWN[id(shown)] = shown, shown._repr_html_()
    return DRAWN[id(shown)][1]


@pytest.mark.parametrize("name", objects_with("html"))
def test_the_html_of_an_object_is_a_small_table_and_perhaps_a_thumbnail(objects, name):
    shown = html_of(objects[name])
    images = re.findall(r'<img alt="[^"]+: image" src="data:image/png;base64,[^"]+">', shown)
    assert len(images) == ("image" in FEATURES[name])
    assert len(shown) < 60_000  # a thumbnail has at most 192 x 192 pixels
    assert len(re.sub(r'src="[^"]+"', "", shown)) < 2000
    assert "<table>" in shown
    assert "array(" not in text_of(shown)


@pytest.mark.slow
def test_the_thumbnail_of_a_comparison_of_noise_is_small():
    noise = RANDOM.random((300, 400, 3))
    shown = jl.compare(["mle"], noise, SENSOR, channel_axis=-1)._repr_html_()
    assert len(shown) < 30_000


@pytest.mark.slow
@pytest.mark.parametrize("name", objects_with("plot"))
def test_a_figure_shows_itself_in_notebooks_without_pyplot(objects, name):
    figure = objects[name].plot()
    assert isinstance(figure, Figure)
    assert figure.axes
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_the_table_of_a_history_has_the_first_and_the_last_values():
    text = text_of(html_of(HISTORY))
    assert "steps 10" in text
    assert "cost 1 0.0009766" in text
    assert "test PSNR, dB 20.00 30.00" in text
    assert "held out" not in text
    assert repr(HISTORY) == (
        "<History: steps 0 to 10, cost 1 to 0.0009766, test PSNR 20.00 to 30.00 dB>"
    )


def test_an_empty_history_is_shown():
    assert repr(History()) == "<History: no records>"
    assert "steps 0" in text_of(History()._repr_html_())
    assert History().plot()._repr_png_().startswith(b"\x89PNG")


def test_the_curves_of_a_history_are_its_records():
    cost, gradient, tests = HISTORY.plot().axes
    np.testing.assert_array_equal(cost.lines[0].get_xydata(), [(n, 2.0**-n) for n in range(11)])
    np.testing.assert_array_equal(gradient.lines[0].get_ydata(), HISTORY.gradient_norm)
    np.testing.assert_array_equal(tests.lines[0].get_xydata(), [(0, 20), (5, 25), (10, 30)])


@pytest.mark.slow
def test_the_curves_of_fine_tuning_are_those_of_held_out_bits():
    history = History([Record(n, 0.5, 1.0, None, 0.6 - n / 100) for n in range(3)])
    *_, held_out = history.plot().axes
    np.testing.assert_allclose(held_out.lines[0].get_ydata(), [0.6, 0.59, 0.58])
    assert "held out, nats per bit 0.60000 0.58000" in text_of(history._repr_html_())


def test_the_table_and_the_curves_of_a_plan_are_its_numbers():
    text = text_of(html_of(PLAN))
    assert f"frames for 30 dB {PLAN.required_frames}" in text
    assert f"4,096 {PLAN.psnr[-1]:.1f} {PLAN.snr[-1, 0]:.1f} {PLAN.snr[-1, 12]:.1f}" in text
    assert f"{PLAN.required_frames}>" in repr(PLAN)
    psnr, snr = PLAN.plot().axes
    np.testing.assert_array_equal(psnr.lines[0].get_ydata(), PLAN.psnr)
    np.testing.assert_array_equal(snr.lines[0].get_ydata(), PLAN.snr[-1])
    np.testing.assert_array_equal(snr.lines[1].get_ydata(), PLAN.snr_bound[-1])
    unreachable = jl.plan(jl.Sensor(), 0.5, frames=[1], target_psnr=199.0)
    assert "frames for 199 dB: no number" in repr(unreachable)


@pytest.mark.slow
def test_the_long_table_of_a_plan_is_cut():
    plan = jl.plan(jl.Sensor(), 0.5, frames=range(1, 200))
    assert plan._repr_html_().count("<tr>") < 30


@pytest.mark.slow
def test_uncertainty_is_summarized_also_without_information():
    assert f"saturated {UNCERTAINTY.saturated.mean():.2%}" in repr(UNCERTAINTY)
    assert f"{np.median(UNCERTAINTY.standard_error):.3g} in the median" in repr(UNCERTAINTY)
    error, width = UNCERTAINTY.plot().axes[:2]
    np.testing.assert_array_equal(error.images[0].get_array(), UNCERTAINTY.standard_error)
    np.testing.assert_array_equal(width.images[0].get_array(), UNCERTAINTY.high - UNCERTAINTY.low)
    mask = np.ones((4, 6), bool)
    mask[2, 3] = False
    masked = jl.Sensor(frames=4, mask=mask, efficiency=0.5)
    dead = jl.uncertainty(np.zeros((4, 6), int), masked, method="mle")
    assert "dead 95.83%" in repr(dead)
    assert "<img" in dead._repr_html_()
    assert dead.plot()._repr_png_().startswith(b"\x89PNG")
    color = jl.uncertainty(RANDOM.integers(0, 4, (4, 6, 3)), jl.Sensor(frames=4))
    assert color.plot().axes[0].images[0].get_array().shape == (4, 6)


def test_a_calibration_shows_what_the_command_line_reports():
    text = text_of(html_of(CALIBRATION))
    assert "jots 40 x 50" in text
    assert f"PRNU {CALIBRATION.prnu:.2%}" in text
    assert f"PRNU {CALIBRATION.prnu:.2%}>" in repr(CALIBRATION)


def test_an_evaluation_is_a_table_of_the_mean_and_the_worst(objects):
    lines = repr(objects["Evaluation"]).splitlines()
    assert lines[0].split() == ["PSNR", "SNR", "SSIM"]
    assert lines[1].split()[:3] == ["mean", f"{objects['Evaluation'].mean('psnr'):.2f}", "dB"]
    assert lines[2].startswith("worst 5 %")


def test_a_comparison_is_its_table(objects):
    lines = repr(objects["Comparison"]).splitlines()
    assert lines[0].split() == ["method", "PSNR", "SSIM", "time"]
    assert lines[1].startswith("maximum likelihood")


def test_counts_show_their_first_image(objects):
    stack = objects["CountStack"]
    np.testing.assert_array_equal(stack[0], BITS[:4].counts())
    np.testing.assert_array_equal(stack[-1], BITS[12:].counts())
    np.testing.assert_array_equal(np.stack(list(stack)), [p.counts() for p in BITS.windows(4)])
    assert repr(stack) == "<CountStack: 4 images of 48 x 64 counts, trials of each: unknown>"
    with pytest.raises(IndexError, match="from 0 to 3, got 4"):
        stack[4]


def test_the_residuals_of_an_iterative_method_are_drawn(objects):
    history = objects["ConvergenceHistory"]
    [axes] = history.plot().axes
    for line, (name, values) in zip(axes.lines, history.residuals.items(), strict=True):
        assert line.get_label() == name
        np.testing.assert_array_equal(line.get_ydata(), values)


def test_normalized_images_are_those_of_people():
    from jotlight.notebook import normalize

    assert normalize(np.full((2, 3), np.inf)).min() == 1
    assert normalize(np.zeros((2, 3))).max() == 0
    found = normalize(np.array([[0.0, 2.0, 4.0, np.inf]]))
    np.testing.assert_allclose(found, [[0, 0.5, 1, 1]], atol=0.01)
    assert normalize(np.ones((2, 3, 4))).shape == (2, 3)
    assert normalize(np.ones((2, 3, 3))).shape == (2, 3, 3)


@pytest.mark.parametrize("name", FEATURES)
def test_objects_can_be_compared_and_collected(objects, name):
    one, other = objects[name], copy.deepcopy(objects[name])
    assert one == one
    assert isinstance(one == other, bool)
    assert one in [other, one]
