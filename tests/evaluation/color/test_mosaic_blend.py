"""The blend of the color network with other methods behind a mosaic."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.color.mosaic_blend import blend_mosaic
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.parameters.mosaic import Mosaic

CHELSEA = jl.datasets.photograph("chelsea")[60:124, 120:184].astype(float)


@pytest.mark.parametrize("mosaic", [None, "RGBW"])
def test_a_capture_does_not_get_worse_when_it_grows(mosaic):
    quality = []
    for frames in (1000, 1001):
        sensor = jl.Sensor(frames=frames, mosaic=mosaic)
        bits = sensor.expose(CHELSEA, rng=0, channel_axis=-1 if mosaic is None else None)
        quality.append(jl.metrics.psnr(jl.reconstruct(bits), CHELSEA))
    assert quality[1] > quality[0] - 0.05


@pytest.mark.parametrize(
    "options",
    [{"frames": 2000}, {"frames": 8, "gain": 800.0, "bit_depth": 8}],
)
def test_many_trials_are_blended_by_default(options):
    data = jl.Sensor(mosaic="RGBW", **options).expose(CHELSEA[:32, :32], rng=0)
    found, info = jl.reconstruct(data, return_info=True)
    assert (info.method, info.title) == (
        "held-out",
        "best blend on held-out bits, color differences",
    )
    assert next(iter(info.shares)) == "color network"
    assert sum(info.shares.values()) == pytest.approx(1, abs=1e-5)
    alone, info = jl.reconstruct(data, demosaicing="network", return_info=True)
    assert info.method == "network-color"
    scene = CHELSEA[:32, :32]
    assert jl.metrics.psnr(found, scene) > jl.metrics.psnr(alone, scene) - 0.2


def test_the_color_images_of_a_stack_are_estimated_by_themselves():
    sensor = jl.Sensor(frames=2000)
    bits = [sensor.expose(CHELSEA[:16, :16], rng=seed, channel_axis=-1) for seed in (0, 1)]
    together = jl.reconstruct(bits, method="held-out")
    for each, one in zip(together, bits, strict=True):
        np.testing.assert_allclose(each, jl.reconstruct(one, method="held-out"), atol=1e-5)


def test_the_white_balance_multiplies_the_blend():
    sensor = jl.Sensor(frames=50)
    counts = np.random.default_rng(0).integers(0, 51, (16, 16)).astype(np.int32)
    counted = count_pixels(counts, sensor, None)
    plain, balanced = Mosaic("RGBW"), Mosaic("RGBW", white_balance=[2.0, 1.0, 3.0])
    colors, shares = blend_mosaic(counted, plain, "differences", None)
    white, same = blend_mosaic(counted, balanced, "differences", None)
    np.testing.assert_allclose(white, colors * np.float32([2, 1, 3]), rtol=1e-6)
    assert same == shares


def test_dead_pixels_are_served_with_one_warning():
    mask = np.zeros((32, 32), bool)
    mask[5, 6] = True
    sensor = jl.Sensor(frames=30, mosaic="RGBW", mask=mask)
    bits = sensor.expose(CHELSEA[:32, :32], rng=0)
    with pytest.warns(jl.JotlightWarning) as caught:
        found = jl.reconstruct(bits, method="held-out")
    assert len(caught) == 1
    assert np.isfinite(found).all()
