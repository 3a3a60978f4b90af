import warnings

import numpy as np
import pytest

import jotlight as jl


def captures():
    rng = np.random.default_rng(0)
    dark = rng.random((205, 12, 16)) < 0.02
    dark[:, 3, 5] = True
    flat = rng.random((205, 12, 16)) < 0.5
    return jl.Bits.from_array(dark), jl.Bits.from_array(flat)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize("chunk", [7, 90])
def test_the_calibration_is_that_of_one_machine(chunk):
    dark, flat = captures()
    lazy = jl.dask.calibrate(dark.to_dask(chunk), flat.to_dask(chunk), width=dark.width)
    found, expected = lazy.compute(), jl.calibrate(dark, flat)
    for name in ("dark_counts", "mask", "hot", "dead", "efficiency"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
        np.testing.assert_array_equal(getattr(lazy, name).compute(), getattr(expected, name))
    assert found.dark_steadiness.correlation == expected.dark_steadiness.correlation
    assert found.flat_steadiness.homogeneity_z == expected.flat_steadiness.homogeneity_z
    np.testing.assert_array_equal(found.flat_steadiness.map, expected.flat_steadiness.map)


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize("frames", [19, 84])
def test_the_rest_of_the_frames_may_be_almost_a_block(frames):
    dark = captures()[0][:frames]
    found, expected = jl.dask.calibrate(dark).compute(), jl.calibrate(dark)
    assert found.dark_steadiness.correlation == expected.dark_steadiness.correlation
    np.testing.assert_array_equal(found.dark_ones, expected.dark_ones)


def test_few_frames_have_no_test_of_steadiness():
    dark = jl.Bits.from_array(np.random.default_rng(0).random((6, 12, 16)) < 0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        assert jl.dask.calibrate(dark).compute().dark_steadiness is None


def test_warnings_of_the_calibration_are_issued_here():
    frames = np.random.default_rng(0).random((100, 12, 16)) < 0.3
    twice = jl.Bits.from_array(np.repeat(frames, 2, axis=0))
    lazy = jl.dask.calibrate(twice)
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        lazy.compute()
    assert any("frames are correlated" in str(each.message) for each in issued)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"false_positive_rate": 0.5}, "false_positive_rate"),
        ({"max_dark": -1}, "max_dark"),
        ({"flat": jl.Bits.from_array(np.ones((9, 4, 40), bool))}, "the dark capture's 12 x 16"),
    ],
)
def test_bad_options_are_refused_before_work(options, message):
    with pytest.raises(ValueError, match=message):
        jl.dask.calibrate(captures()[0], **options)


def test_dark_and_flat_captures_of_different_regions_are_refused(tmp_path):
    jl.save(jl.Bits.from_array(np.zeros((20, 16, 24), bool)), tmp_path / "a.npy")
    bits = jl.open(tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"flat capture is of rows 8:16 .*\(--region\)$"):
        jl.dask.calibrate(bits[:, :8], bits[:, 8:])
