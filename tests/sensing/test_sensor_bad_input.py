"""Parameters of a sensor that are out of range or masked."""

import numpy as np
import pytest

import jotlight as jl


@pytest.mark.parametrize("number", [5e-324, 9e-19, 1.1e18, 1e308, 10**400, np.nan, np.inf, -1.0])
@pytest.mark.parametrize("name", ["gain", "max_intensity", "exposure_time"])
def test_numbers_out_of_the_range_of_physics_are_refused(name, number):
    with pytest.raises(ValueError, match=rf"{name}: expected a number from 1e-18 to 1e[+]18, got"):
        jl.Sensor(**{name: number})


@pytest.mark.parametrize("dark_counts", [1.1e18, np.full((2, 2), 1e39), np.nan, -1e-9])
def test_dark_counts_out_of_range_are_refused(dark_counts):
    with pytest.raises(ValueError, match=r"dark_counts: expected numbers from 0 to 1e[+]18"):
        jl.Sensor(dark_counts=dark_counts)


def test_other_numbers_of_frames_do_not_lead_out_of_range():
    with pytest.raises(ValueError, match="gain: expected a number from 1e-18"):
        jl.Sensor(gain=1e18).replace(frames=100)


@pytest.mark.parametrize("threads", [0, -1, 1025, 10**6])
def test_impossible_numbers_of_threads_are_refused(threads):
    with pytest.raises(ValueError, match="threads: expected a whole number from 1 to 1024"):
        jl.Sensor().rate(np.ones((2, 2)), threads=threads)


def test_masked_arrays_are_refused():
    masked = np.ma.masked_array(np.ones((2, 2)), [[True, False], [False, False]])
    with pytest.raises(TypeError, match="masked"):
        jl.Sensor().expose(masked, rng=0)
    with pytest.raises(TypeError, match="masked"):
        jl.mle(masked.astype(int), jl.Sensor())
    with pytest.raises(TypeError, match="masked"):
        jl.Bits.from_array(masked.astype(bool))


MASKED = np.ma.masked_array(np.full((3, 3), 0.5), np.eye(3, dtype=bool))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("efficiency", MASKED),
        ("dark_counts", MASKED),
        ("mask", MASKED > 1),
        ("threshold", np.ma.masked_array([[1, 2]], [[True, False]])),
        ("gain", np.ma.masked_array([1.0, 2.0], [True, False])),
    ],
)
def test_masked_parameters_are_refused(name, value):
    with pytest.raises(TypeError, match=f"{name}: expected a plain array, got a masked one"):
        jl.Sensor(frames=2, **{name: value})


@pytest.mark.parametrize("value", [np.nan, -0.5, 1e30, [[0.1, -3.0]]])
@pytest.mark.parametrize("name", ["dark_counts", "efficiency"])
def test_the_error_of_a_number_out_of_range_states_it(name, value):
    received = f"{np.min(value):g}" if np.ndim(value) else rf"({value}|{value:g})"
    with pytest.raises(
        ValueError, match=rf"{name}: expected .* got {received}".replace("+", r"\+")
    ):
        jl.Sensor(**{name: value})


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("dead_time", r"jotlight\.FreeRunning\(dead_time=\.\.\.\)"),
        ("exposure", r"gain \(photons\), or exposure_time \(seconds\)"),
        ("alpha", "gain"),
        ("pde", "efficiency"),
        ("DCR", r"dark_counts \(DCR \* exposure time\)"),
        ("psf", "kernel"),
        ("q", "threshold"),
        ("K_hat", "oversampling"),
        ("bayer", "mosaic"),
        ("cfa", "mosaic"),
        ("frame", "frames"),
    ],
)
def test_symbols_and_other_names_of_parameters_have_a_hint(name, hint):
    for call in (jl.Sensor, jl.Sensor().replace):
        with pytest.raises(TypeError, match=rf"got {name}; did you mean {hint}\?"):
            call(**{name: 1})


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"frames": 3, "gain": [3]}, r"each of the 3 frames, got .* Sensor\(frames=1, gain="),
        ({"gain": [3, 1]}, r"one for the only frame, got .* Sensor\(frames=2, gain="),
        ({"frames": 3, "gain": [[1]]}, r"each of the 3 frames, got .* Sensor\(frames=3, gain="),
        ({"frames": 4, "threshold": [1, 2]}, r"jots, got .* Sensor\(frames=2, threshold="),
    ],
    ids=str,
)
def test_the_example_for_values_of_frames_has_their_number(parameters, expected):
    with pytest.raises(ValueError, match=expected):
        jl.Sensor(**parameters)


def test_each_frame_has_a_gain_in_the_range():
    with pytest.raises(ValueError, match=r"gain: expected a number from 1\.6e-17 to 1e[+]18"):
        jl.Sensor(frames=16, gain=1e-18)
    bits = jl.Sensor(frames=16, gain=1.6e-17).expose(np.ones((2, 2)), rng=0)
    assert bits[:4].sensor.gain == pytest.approx(4e-18)
