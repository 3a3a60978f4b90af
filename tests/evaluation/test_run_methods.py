"""Many methods on the bits of one image."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.run_methods import compare_methods, select_methods

SENSOR = jl.Sensor(oversampling=4)
IMAGE = jl.datasets.photograph("camera")[100:140, 180:220]
BITS = SENSOR.expose(IMAGE, rng=0)


@pytest.mark.slow
def test_each_result_is_that_of_the_method_measured_against_the_image():
    names = [name for name in select_methods(SENSOR) if METHODS[name].required_package is None]
    titles = []
    results = compare_methods(IMAGE, BITS, SENSOR, names, begin=titles.append)
    assert titles == [METHODS[name].title for name in names]
    for name, result in zip(names, results, strict=True):
        estimate = METHODS[name].run(BITS, SENSOR)
        assert (result.estimate == estimate).all()
        assert result.psnr == jl.metrics.psnr(estimate, IMAGE)
        assert result.ssim == jl.metrics.ssim(estimate, IMAGE)
        assert result.seconds > 0


def test_an_iterative_method_reports_its_progress():
    fractions = []
    compare_methods(IMAGE, BITS, SENSOR, ["admm-tv"], begin=lambda title: fractions.append)
    assert len(fractions) > 1
    assert 0 <= fractions[0] < fractions[-1] == 1


def test_an_image_too_small_for_ssim_has_none():
    image = np.full((10, 12), 0.5)
    [result] = compare_methods(image, SENSOR.expose(image, rng=0), SENSOR, ["mle"])
    assert result.ssim is None
    assert np.isfinite(result.psnr)


@pytest.mark.parametrize(
    ("sensor", "included", "excluded"),
    [
        (SENSOR, {"mle", "network-large"}, {"mle-iterative"}),
        (jl.Sensor(kernel="cubic"), {"mle", "mle-iterative", "network-medium"}, {"held-out"}),
        (jl.Sensor(frames=2000), {"network-medium", "held-out"}, {"mle-iterative"}),
    ],
    ids=["box", "cubic", "2000 bits"],
)
def test_the_default_is_all_methods_that_serve_the_sensor_and_differ(sensor, included, excluded):
    names = select_methods(sensor)
    assert included <= set(names)
    assert not excluded & set(names)
    assert names == [name for name in METHODS if name in names]


def test_names_are_kept_in_their_order():
    names = ["noniterative-tv", "mle-iterative", "mle"]
    assert select_methods(SENSOR, names) == names


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("magic", "method: there is no 'magic'; expected one of mle, "),
        ("held-out", "held-out: expected the box kernel for a blend on held-out bits, got linear"),
    ],
)
def test_a_method_that_is_unknown_or_does_not_serve_the_sensor_is_refused(name, message):
    with pytest.raises(ValueError, match=message):
        select_methods(jl.Sensor(frames=20, kernel="linear"), ["mle", name])
