"""A sensor that contradicts the one of the data is reported once, with the reason."""

import re

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.films.film import film
from jotlight.sensing.data.contradictions import contradictions
from jotlight.sensing.parameters.mosaic import Mosaic

BRACKET = np.repeat([16.0, 1.0], 4)
SCENE = np.random.default_rng(0).random((16, 16), np.float32) * 0.4 + 0.3
COLORS = np.stack([SCENE] * 3, axis=-1)


def run_all(data, sensor):
    """Yield each method that takes a sensor as a function without arguments."""
    plain = (jl.noniterative, jl.admm_tv) if sensor.has_plain_bits else ()
    for run in (jl.mle, *plain, jl.merge_readings, jl.reconstruct, jl.uncertainty):
        yield lambda run=run: run(data, sensor)


@pytest.mark.parametrize(
    ("stated", "changes", "message"),
    [
        (
            jl.Sensor(frames=8, threshold=2),
            {"threshold": 1},
            "threshold: the data state threshold 2, but threshold 1 is used instead; leave out "
            "sensor= (--threshold) unless the data are wrong",
        ),
        (
            jl.Sensor(frames=8, gain=BRACKET),
            {"gain": 68.0},
            "gain: the data state a gain for each frame (16, 16, 16, 16, ...), but one gain for "
            "all frames is used instead; leave out sensor= (--gain)",
        ),
        (
            jl.Sensor(frames=8, gain=BRACKET),
            {"gain": BRACKET[::-1], "threshold": 2},
            "threshold and gain: the data state threshold 1 and a gain for each frame (16, 16, 16, "
            "16, ...), but threshold 2 and a gain for each frame (1, 1, 1, 1, ...) are used",
        ),
    ],
    ids=["threshold", "gain", "both"],
)
def test_all_methods_report_it(stated, changes, message):
    bits = stated.expose(SCENE, rng=0)
    sensor = stated.replace(**changes)
    for run in run_all(bits, sensor):
        with pytest.warns(jl.JotlightWarning, match=re.escape(message)) as caught:
            run()
        assert len(caught) == 1
    for run in run_all(bits, stated):
        run()


@pytest.mark.parametrize("other", [None, "BGGR"])
@pytest.mark.parametrize("run", [jl.reconstruct, jl.uncertainty])
def test_another_mosaic_is_reported(other, run):
    stated = jl.Sensor(frames=8, mosaic="RGGB")
    bits = stated.expose(COLORS, rng=0)
    expected = "no mosaic" if other is None else "the mosaic Mosaic('BGGR')"
    message = f"mosaic: the data state the mosaic Mosaic('RGGB'), but {expected} is used instead"
    category = jl.PeriodicRatesWarning if other is None else jl.JotlightWarning
    with pytest.warns(category, match=re.escape(message)) as caught:
        run(jl.Bits(bits.packed, bits.width, stated), stated.replace(mosaic=other))
    assert len({str(each.message) for each in caught}) == 1


@pytest.mark.parametrize("data", ["bits", "readings"])
def test_another_mosaic_of_a_file_is_reported(tmp_path, data):
    stated = jl.Sensor(frames=8, mosaic="RGGB", bit_depth=1 if data == "bits" else 4)
    jl.save(stated.expose(COLORS, rng=0), tmp_path / "a.npy")
    jl.open(tmp_path / "a.npy", mosaic="RGGB")
    message = r"mosaic: the data state .*RGGB.* but .*BGGR.* instead; leave out mosaic= \(--mosaic"
    with pytest.warns(jl.JotlightWarning, match=message):
        opened = jl.open(tmp_path / "a.npy", mosaic="BGGR")
    assert opened.sensor.mosaic == Mosaic("BGGR")
    jl.reconstruct(opened)


@pytest.mark.slow
@pytest.mark.parametrize("run", [jl.merge, jl.align, lambda *data: next(film(*data, window=8))])
def test_motion_reports_it(run):
    stated = jl.Sensor(frames=16)
    bits = stated.expose(np.tile(SCENE, (4, 4)), rng=0)
    with pytest.warns(jl.JotlightWarning) as caught:
        run(bits, stated.replace(threshold=2))
    assert sum("threshold: the data state" in str(each.message) for each in caught) == 1


def test_merged_counts_and_lists_are_compared():
    sensor = jl.Sensor(frames=8)
    merged = jl.Merged([[3, 1]], 8.0, sensor)
    bits = sensor.expose(SCENE, rng=0)
    for data in (merged, [bits, bits]):
        with pytest.warns(jl.JotlightWarning, match="threshold: the data state threshold 1"):
            jl.mle(data, sensor.replace(threshold=2))


def test_what_callers_may_change_is_not_reported():
    mask = np.zeros((16, 16), bool)
    mask[0, 0] = True
    stated = jl.Sensor(frames=8, gain=BRACKET, threshold=[1, 2] * 4)
    better = stated.replace(
        max_intensity=4.0,
        dark_counts=0.01,
        efficiency=np.full((16, 16), 0.5),
        mask=mask,
        gain=1.7 * BRACKET,
        exposure_time=1e-3,
    )
    assert contradictions(stated, better, (16, 16)) == []
    gray = jl.Sensor(frames=8)
    assert contradictions(gray, gray.replace(mosaic="RGGB", gain=2.0), (16, 16)) == []
    slightly = 1 + 1e-6 * np.arange(8)
    assert contradictions(gray, gray.replace(gain=slightly), (16, 16)) == []
    balanced = Mosaic("RGGB", white_balance=[2, 1, 1.5])
    tile = Mosaic("RGRG/GBGB/RGRG/GBGB", transmission=0.9 * np.eye(3))
    for other in (balanced, tile):
        assert (
            contradictions(gray.replace(mosaic="RGGB"), gray.replace(mosaic=other), (16, 16)) == []
        )
