"""Progress: bars in notebooks, functions of the caller, and nothing elsewhere."""

import sys
import types

import numpy as np
import pytest

import jotlight as jl
from jotlight.calibration import find_hot_jots, steadiness
from jotlight.formats import open_capture, verify_capture
from jotlight.images.sets import read_image_set
from jotlight.progress import bars, equal_steps, shown_progress
from jotlight.sensing.data.periodic_rates import find_periodic_rates
from jotlight.training.photographs import read_photographs

SENSOR = jl.Sensor(oversampling=3)


class Output:
    """An output of a cell, as IPython's display(..., display_id=True) returns it."""

    def __init__(self):
        self.states = []

    def update(self, bar):
        [task] = bar.tasks
        self.states.append((task.completed, task.description))


@pytest.fixture
def notebook(monkeypatch):
    """Pretend to be a notebook whose clock stands still; return its outputs and its clock."""
    outputs, clock = [], types.SimpleNamespace(now=100.0)

    def display(bar, display_id):
        assert display_id
        assert "%" in bar._repr_mimebundle_((), ())["text/plain"]
        outputs.append(Output())
        outputs[-1].update(bar)
        return outputs[-1]

    fake = types.ModuleType("IPython.display")
    fake.display = display
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", fake)
    monkeypatch.setitem(sys.modules, "ipykernel", types.ModuleType("ipykernel"))
    monkeypatch.setattr(bars.console, "is_jupyter", True)
    monkeypatch.setattr(bars, "monotonic", lambda: clock.now)
    return outputs, clock


@pytest.fixture
def slow_notebook(notebook, monkeypatch):
    """Pretend to be a notebook in which each step takes a second; return its outputs."""
    outputs, clock = notebook

    def later():
        clock.now += 1
        return clock.now

    monkeypatch.setattr(bars, "monotonic", later)
    return outputs


def test_a_bar_in_a_notebook_appears_after_a_while_and_shows_the_end(notebook):
    outputs, clock = notebook
    with shown_progress(None, "long work") as update:
        update(0.1)
        assert outputs == []
        clock.now += 0.6
        update(0.2)
        update(0.25)  # too soon to be shown
        clock.now += 0.2
        update(0.5, "half of it")
        update(1.0)
    [output] = outputs
    assert output.states == [
        (0.2, "long work"),
        (0.5, "half of it"),
        (1.0, "half of it"),
    ]


def test_short_work_shows_no_bar(notebook):
    outputs, _ = notebook
    with shown_progress(True, "short work") as update:
        update(0.5)
        update(1.0)
    assert outputs == []


@pytest.mark.parametrize("progress", [None, False, print])
def test_parts_of_work_show_no_bar_of_their_own(notebook, progress):
    outputs, clock = notebook
    with (
        shown_progress(progress, "the whole") as update,
        shown_progress(None, "a part") as update_part,
    ):
        clock.now += 10
        update_part(0.5)
        update(1.0)
    assert [output.states[-1][1] for output in outputs] == ["the whole"] * (progress is None)
    with shown_progress(None, "after it") as update:
        clock.now += 10
        update(0.5)
    assert outputs[-1].states[-1] == (0.5, "after it")


def test_nothing_is_shown_outside_of_notebooks_and_terminals(capsys):
    for progress in (None, False, True):
        with shown_progress(progress, "work") as update:
            update(0.5)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("progress", ["yes", 1, 0.5])
def test_other_values_are_refused(progress):
    with pytest.raises(TypeError, match="expected True, False, or a function"):
        jl.evaluate("mle", np.full((1, 8, 8), 0.5), SENSOR, progress=progress)


BITS = SENSOR.replace(frames=8).expose(np.full((22, 22), 0.5), rng=0)
READINGS = jl.Sensor(frames=2, bit_depth=2).expose(np.full((4, 4), 0.5), rng=0)
BUILDING_BLOCKS = {
    "expose": lambda folder, **options: SENSOR.expose(np.full((4, 4), 0.5), rng=0, **options),
    "expose readings": lambda folder, **options: READINGS.sensor.expose([[0.5]], rng=0, **options),
    "counts": lambda folder, **options: BITS.counts(**options),
    "sum": lambda folder, **options: READINGS.sum(**options),
    "calibrate": lambda folder, **options: jl.calibrate(np.ones((8, 8), int), frames=9, **options),
    "calibrate bits": lambda folder, **options: jl.calibrate(BITS, **options),
    "steadiness": lambda folder, **options: steadiness(BITS, **options),
    "steadiness of few": lambda folder, **options: steadiness(BITS[:2], **options),
    "hot jots": lambda folder, **options: find_hot_jots(BITS, **options),
    "hot counts": lambda folder, **options: find_hot_jots([[1]], trials=2, **options),
    "periods": lambda folder, **options: find_periodic_rates(BITS, **options),
    "periods of counts": lambda folder, **options: find_periodic_rates([[1]], **options),
    "photographs": lambda folder, **options: read_photographs(
        [folder / "bsds300" / "test" / "0.png"], **options
    ),
    "images": lambda folder, **options: read_image_set(folder / "bsds300" / "test", **options),
    "stack": lambda folder, **options: read_image_set(folder / "stack.npy", **options),
    "BSDS300": lambda folder, **options: jl.datasets.bsds300("test", folder, **options),
    "capture": lambda folder, **options: verify_capture(folder / "bits.npy", **options),
    "count stack": lambda folder, **options: open_capture(folder / "bits.tif").sum(**options),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    (folder / "bsds300" / "test").mkdir(parents=True)
    jl.save_image(folder / "bsds300" / "test" / "0.png", np.full((4, 4), 0.5))
    np.save(folder / "stack.npy", np.full((2, 4, 4), 0.5, np.float32))
    jl.save(BITS, folder / "bits.npy")
    jl.save(BITS.counts(1), folder / "bits.tif")
    return folder


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize("run", BUILDING_BLOCKS.values(), ids=BUILDING_BLOCKS)
def test_building_blocks_take_the_same_values_and_have_no_bar_by_default(slow_notebook, run, files):
    for options in ({}, {"progress": False}, {"progress": lambda fraction: None}):
        run(files, **options)
        assert slow_notebook == []
    for progress in (True, None):
        run(files, progress=progress)
    with pytest.raises(TypeError, match="progress: expected True, False, or a function"):
        run(files, progress="yes")


def test_steps_have_equal_parts():
    done = []
    begin = equal_steps(lambda fraction, text: done.append((fraction, text)), 4)
    begin("a")
    begin("b")(0.5)
    assert done == [(0.0, "a"), (0.25, "b"), (0.375, "b")]


def run_train(**options):
    start = jl.Network.initial(SENSOR)
    jl.train(start, jl.datasets.uniform_scenes, steps=3, batch=4, rng=0, **options)


def run_merge(**options):
    scene = jl.datasets.moving(
        motion="shake", sensor=jl.Sensor(frames=32), shape=(64, 64), photons=0.5, rng=0
    )
    jl.merge(scene.bits, motion=jl.align(scene.bits, **options), **options)


def run_compare(**options):
    jl.compare(["mle", "admm-tv"], np.full((16, 16), 0.5), SENSOR, **options)


def run_evaluate(**options):
    jl.evaluate("mle", np.full((3, 16, 16), 0.5), SENSOR, **options)


@pytest.mark.slow
@pytest.mark.parametrize("run", [run_train, run_merge, run_compare, run_evaluate])
def test_long_work_has_a_bar_in_notebooks_that_reaches_its_end(slow_notebook, run):
    run()
    assert len(slow_notebook) == (2 if run is run_merge else 1)
    for output in slow_notebook:
        fractions = [fraction for fraction, _ in output.states]
        assert fractions == sorted(fractions)
        assert fractions[-1] == 1
    del slow_notebook[:]
    run(progress=False)
    assert slow_notebook == []
    done = []
    run(progress=done.append)
    assert slow_notebook == []
    assert done[-1] == 1


@pytest.mark.slow
def test_the_bar_of_a_training_shows_its_measurements(slow_notebook):
    records = []
    run_train(test=np.full((1, 32, 32), 0.5), callback=records.append)
    assert slow_notebook[0].states[-1][1] == (
        f"step 3/3  cost {records[-1].loss:.4g}  gradient {records[-1].gradient_norm:.3g}  "
        f"test {records[-1].test_psnr:.2f} dB"
    )


def test_the_tables_of_a_comparison_name_its_steps(slow_notebook):
    run_compare()
    texts = {text for _, text in slow_notebook[0].states}
    assert texts == {"drawing bits", "maximum likelihood", "ADMM, total variation"}
