"""`jotlight plan`."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.cost import motion_cost


@pytest.mark.slow
def test_the_command_prints_the_required_frames_and_draws_the_figure(run, tmp_path):
    expected = jl.plan(jl.Sensor(threshold=2), (0.1, 2.0), target_psnr=20.0)
    arguments = [
        "plan",
        "100:2000",
        "--frame-rate",
        1000,
        "-q",
        2,
        "--target-psnr",
        20,
        "--plot",
        "a.png",
    ]
    status, output = run(*arguments)
    assert status == 0
    seconds = f"{expected.required_frames / 1000:.3g} s"
    enough = f"{expected.required_frames} frames ({seconds}) of a scene that stands still are"
    assert enough in output
    assert f"{expected.psnr[-1]:.1f}" in output
    assert (tmp_path / "a.png").stat().st_size > 10_000
    status, output = run("plan", "0.5", "--frames", 100)
    assert status == 0
    assert [line.split()[0] for line in output.splitlines()[1:9]] == [
        "1", "2", "4", "8", "16", "32", "64", "100",
    ]  # fmt: skip


@pytest.mark.parametrize(("command", "options"), [("plan", ()), ("train", ("-o", "a.safetensors"))])
def test_hot_jots_are_searched_only_in_captures(run, command, options):
    status, output = run(command, "0.1", "--find-hot-jots", *options)
    assert status == 2
    assert "Unknown option: --find-hot-jots" in output


@pytest.mark.slow
def test_a_calibration_is_replaced_by_its_median_jot(run):
    rng = np.random.default_rng(0)
    dark = rng.gamma(4, 0.01, (32, 32))
    camera = jl.Sensor(frames=1000, threshold=2, dark_counts=dark)
    calibration = jl.calibrate(
        camera.expose(np.zeros(dark.shape), 1), camera.expose(np.full(dark.shape, 0.7), 2),
        threshold=2,
    )  # fmt: skip
    calibration.save("c.safetensors")
    median = float(np.median(calibration.dark_counts[~calibration.mask]))
    for more in ([], ["--efficiency", 0.5]):
        status, output = run("plan", "0.1:2", "--calibration", "c.safetensors", *more)
        assert status == 0
        assert run("plan", "0.1:2", "-q", 2, "--dark-counts", repr(median), *more) == (0, output)
    arguments = ["plan", "0.1:2", "--calibration", "c.safetensors", "--dark-counts", 0.5]
    assert run(*arguments)[1] == run("plan", "0.1:2", "-q", 2, "--dark-counts", 0.5)[1]


@pytest.mark.slow
def test_a_plan_of_a_calibration_is_that_of_its_sensor_in_python(run):
    rng = np.random.default_rng(0)
    shape, efficiency = (32, 32), rng.uniform(0.4, 1.0, (32, 32))
    camera = jl.Sensor(frames=1000, efficiency=efficiency)
    captures = (camera.expose(np.full(shape, light), rng=rng) for light in (0.0, 0.7))
    calibration = jl.calibrate(*captures)
    calibration.save("c.safetensors")
    planned = jl.plan(calibration.sensor(16), (0.05, 2.0), target_psnr=30)
    options = ("--calibration", "c.safetensors", "--target-psnr", 30)
    output = run("plan", "0.05:2", *options)[1]
    assert f"{planned.required_frames} frames of a scene that stands still are" in output
    dark = repr(float(np.median(calibration.dark_counts[~calibration.mask])))
    assert output == run("plan", "0.05:2", "--dark-counts", dark, *options[2:])[1]


@pytest.mark.slow
def test_the_color_filters_of_a_calibration_do_not_change_a_plan(run):
    dark, flat = np.random.default_rng(0).binomial(1000, [[[0.01]], [[0.5]]], (2, 32, 32))
    outputs = []
    for mosaic in (None, "RGGB"):
        jl.calibrate(dark, flat, frames=1000, mosaic=mosaic).save("c.safetensors")
        outputs.append(run("plan", "0.1:2", "--calibration", "c.safetensors"))
    assert outputs[0] == outputs[1]
    assert outputs[0][0] == 0


def test_the_cost_of_motion_is_printed(run):
    for more, frames, size in (([], 100, (256, 512)), (["--size", "64x48"], 100, (64, 48))):
        status, output = run("plan", "0.5", "--frames", frames, *more)
        assert status == 0
        cost = motion_cost(frames, size)
        assert f"--motion takes about {cost.seconds:.2g} s on one thread and " in output
        assert f"{cost.memory / 1e6:.0f} MB for 100 frames of {size[0]} x {size[1]} jots" in output
        assert f"and {cost.further_seconds:.2g} s for each further image" in output
        assert "That is for a scene that moves as a whole" in output


def test_frames_that_all_help_are_not_compared_with_twice_as_many(run):
    output = run("plan", "0.02:0.5", "--speed", 0.1)[1]
    assert "all frames help that show the image: beyond 5,120 frames nothing" in output
    assert "twice as many" not in output


@pytest.mark.slow
def test_the_frames_that_help_at_a_speed_are_printed(run):
    arguments = ["plan", "0.01:0.5", "--frames", 64, "--size", "128x100"]
    status, output = run(*arguments, "--speed", 0.25)
    assert status == 0, output
    plan = jl.plan(jl.Sensor(), (0.01, 0.5), frames=[64], speed=0.25, size=(128, 100)).motion
    assert f"the sum of {plan.best_sum:,} frames is best; longer sums are worse" in output
    assert plan.best_aligned == plan.frames_in_view
    assert "With --motion, all frames help that show the image" in output
    assert f"beyond {plan.frames_in_view:,} frames nothing of the image is in view" in output
    assert f"an error of {plan.registration_error:.2g} pixels" in output
    status, per_second = run(
        "plan", "10:500", "--frame-rate", 1000, "--frames", 64, "--size", "128x100",
        "--speed", 250,
    )  # fmt: skip
    assert status == 0
    assert per_second.splitlines()[-2:] == output.splitlines()[-2:]
    slow = jl.plan(jl.Sensor(), (0.01, 0.5), frames=[64], speed=0.01, size=(128, 100)).motion
    assert slow.best_aligned < slow.frames_in_view
    helping = f"With --motion, up to {slow.best_aligned:,} frames help; twice as many gain less"
    assert helping in run(*arguments, "--speed", 0.01)[1]
    very_slow = run(*arguments, "--speed", 1e-9)[1]
    assert "the sum of 1,048,576 or more frames is best.\n" in very_slow
    assert "longer sums are worse" not in very_slow
    assert "At rest, all frames help." in run(*arguments, "--speed", 0)[1]
    output = run("plan", "1e-6", "--speed", 1, "--size", "64x64")[1]
    assert "There is too little light for --motion at this speed" in output
    output = run(*arguments, "--speed", 100)[1]
    assert "too fast for --motion, which needs 16 frames or more: beyond 2 frames nothing" in output


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["1:2", "--speed", -1], "speed: expected pixels per frame from 0 to 1000, got -1"),
        (["1", "--target-psnr", 201], "target_psnr: expected a number from 0 to 200, got 201"),
        (["2:1"], "from the darkest to the brightest point as MIN:MAX, such as 0.01:1, or one"),
        (["1:2", "--size", "256"], "size: expected HEIGHTxWIDTH in jots"),
        (["1:2", "--size", "0x9"], "size: expected HEIGHTxWIDTH in jots"),
        (["dim"], "MIN:MAX"),
        (["1:2", "--frame-rate", 0], "frame-rate"),
        (["1:2", "--plot", "a.txt"], "ends in .png"),
        (["1:2", "--frames", 0], "frames: expected"),
        (["1:2", "--gain", 3], "gain: has no effect, because the light is in photons per jot"),
        (
            ["1:2", "--gain", "4,1"],
            "gain: expected one number for all readings, got 4,1; in Py",
        ),
        (["1:2", "-q", "1,3", "--frames", 4], "threshold: expected one number for all readings, g"),
        (["1:2", "-q", "1,3,..."], "jotlight.plan_brackets finds exposures that differ"),
        (["1:2", "-q", "thresholds.npy"], "for all readings, got thresholds.npy; in Python"),
    ],
)
def test_invalid_arguments_get_one_line_that_names_the_cause(run, arguments, expected):
    status, output = run("plan", *arguments)
    assert status == 1
    [line] = output.splitlines()
    assert expected in line


def test_the_help_promises_one_threshold(run):
    status, output = run("plan", "--help")
    assert status == 0
    assert "several" not in output
    assert "number of photons that make a jot report 1. Default: 1." in " ".join(
        output.replace("│", "").split()
    )


def test_an_exposure_time_is_refused_with_the_option_to_use(run):
    status, output = run("plan", "1", "--exposure-time", 1e-5)
    assert status == 1
    assert "--frame-rate" in output


def test_a_gain_changes_what_a_maximum_intensity_means(run):
    arguments = ["plan", "0.5:2", "--frames", 8, "--max-intensity", 3]
    plans = [run(*arguments, "--gain", gain) for gain in (8, 2)]
    assert [status for status, _ in plans] == [0, 0]
    assert plans[0] != plans[1]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], ("A bit carries most", "have every bit at 1.")),
        (["--read-noise", 0.2], ("A bit carries most", "have every bit at 1.")),
        (
            ["--bit-depth", 4],
            ("A reading carries most", "have every reading at 15, the largest number."),
        ),
    ],
)
def test_the_last_lines_name_bits_or_readings(run, options, expected):
    status, output = run("plan", "0.1:1", "--frames", 4, *options)
    assert status == 0
    for text in expected:
        assert text in output
