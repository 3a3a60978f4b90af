"""Options of sensors, and sensors that commands do not take."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.options.sensor_options import SensorOptions

GRAY = {
    "evaluate": ("--mosaic",),
    "plan": ("--mosaic",),
    "train": ("--mosaic", "--bit-depth", "--read-noise"),
    "fine-tune": ("--mosaic", "--bit-depth", "--read-noise"),
}
REFUSED = {
    "mosaic": {"mosaic": "RGGB"},
    "readings": {"bit_depth": 4},
    "noise": {"read_noise": 0.3},
    "bracket": {"gain": np.repeat([8.0, 1.0], 4)},
}


@pytest.mark.parametrize(
    ("command", "option"), [(command, option) for command in GRAY for option in GRAY[command]]
)
def test_options_that_a_command_cannot_use_are_unknown_to_it(run, command, option):
    outputs = ("-o", "n.safetensors") if command in ("train", "fine-tune") else ()
    status, output = run(command, "photos", *outputs, option, "2")
    assert status != 0
    assert f"Unknown option: {option}" in output
    status, output = run(command, "--help")
    assert status == 0
    assert "--kernel" in output
    assert option not in output


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.parametrize(
    "command", [("fine-tune", "a.npy"), ("train", "synthetic", "--sensor", "a.npy")]
)
def test_networks_are_trained_for_gray_sensors_of_plain_bits(run, tmp_path, name, command):
    if command[0] == "fine-tune":
        pytest.importorskip("torch")
    sensor = jl.Sensor(frames=8, **REFUSED[name])
    shape = (16, 16, 3) if name == "mosaic" else (16, 16)
    jl.save(sensor.expose(np.full(shape, 0.5), rng=0), tmp_path / "a.npy")
    status, output = run(*command, "-o", "n.safetensors", "--steps", 2)
    assert status == 1
    assert "error: sensor: expected a gray sensor with bits of one gain and threshold" in output
    assert "jotlight." not in output.partition("error:")[2]
    assert run("reconstruct", "a.npy", "-o", "a.png")[0] == 0


def test_every_parameter_of_the_sensor_has_an_option():
    names = [field.name for field in dataclasses.fields(jl.Sensor)]
    assert [field.name for field in dataclasses.fields(SensorOptions)] == names
