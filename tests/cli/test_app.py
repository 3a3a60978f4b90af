"""The command line as a whole: exit codes, usage errors, help, and shell completion."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.app import COMMANDS, app
from jotlight.cli.terminal.examples import EXAMPLES


@pytest.mark.parametrize(
    ("arguments", "message", "help_command"),
    [
        (["recontruct"], 'Unknown command "recontruct"', "jotlight --help"),
        (["info"], "FILE is required, as in `jotlight info capture.npy`.", "jotlight info --help"),
        (
            ["info", "a.npy", "b.npy"],
            "`jotlight info` takes 1 argument; leave out b.npy.",
            "jotlight info --help",
        ),
        (["info", "a.npy", "--nope"], "Unknown option: --nope", "jotlight info --help"),
        (
            ["train", "photos"],
            "--output is required, as in `jotlight train",
            "jotlight train --help",
        ),
        (["film", "a.npy", "-o", "b"], "--window is required, as in", "jotlight film --help"),
        (["plan", "1", "--frames", "x"], 'unable to convert "x" into int', "jotlight plan --help"),
        (
            ["reconstruct", "-", "-o", "a.tif"],
            "-: standard input is for `jotlight view - --follow`; elsewhere, write it to a file",
            "jotlight reconstruct --help",
        ),
        (["info", "a.npy", "--width"], "--width requires an argument", "jotlight info --help"),
    ],
)
def test_a_wrong_command_line_gets_one_line_and_exit_code_2(run, arguments, message, help_command):
    status, output = run(*arguments)
    assert status == 2
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert message in line
    assert line.endswith(f"Try '{help_command}'.")


def test_without_a_command_help_is_shown(run):
    status, output = run()
    assert status == 0
    assert output == run("--help")[1] == run("-h")[1]


def test_the_help_of_a_command_has_a_short_name(run):
    status, output = run("plan", "-h")
    assert status == 0
    assert output == run("plan", "--help")[1]


def test_the_home_folder_is_found_where_a_shell_leaves_the_tilde(run, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    jl.save(jl.Sensor(frames=4).expose(np.full((8, 8), 0.5), rng=0), tmp_path / "a.npy")
    assert run("info", "~/a.npy")[0] == 0
    assert run("reconstruct", "~/a.npy", "--output=~/a.tif", "--method", "mle")[0] == 0
    assert jl.read_image(tmp_path / "a.tif").shape == (8, 8)
    options = "--method", "mle", "--uncertainty=~/u.npz"
    assert run("reconstruct", "~/a.npy", "--output=~/a.tif", *options)[0] == 0
    assert (tmp_path / "u.npz").exists()
    for arguments in (
        ["reconstruct", "~/none.npy", "-o", "a.tif"],
        ["convert", "~/none.npy", "-o", "a.npy"],
        ["view", "~/none.npy"],
        ["train", "~/none.npy", "-o", "a.safetensors"],
        ["reconstruct", "~/a.npy", "-o", "a.tif", "--dark-counts", "~/none.npy"],
        ["reconstruct", "~/a.npy", "-o", "a.tif", "--efficiency", "~/none.npy"],
        ["reconstruct", "~/a.npy", "-o", "a.tif", "--threshold", "~/none.npy"],
        ["reconstruct", "~/a.npy", "-o", "a.tif", "--mosaic", "~/none.npy.json"],
        ["calibrate", "~/a.npy", "-o", "a.safetensors", "--mosaic", "~/none.npy.json"],
        ["reconstruct", "~/a.npy", "-o", "a.tif", "--mask", "~/none.npy"],
    ):
        status, output = run(*arguments)
        assert status == 1
        assert str(tmp_path / "none.npy") in output


@pytest.mark.parametrize("text", ["~/a", "."])
@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "two.npz", "--key"],
        ["info", "two.npz", "--frame-range"],
        ["info", "two.npz", "--format"],
        ["reconstruct", "one.npy", "-o", "a.tif", "--method"],
        ["reconstruct", "one.npy", "-o", "a.tif", "--gain"],
        ["convert", "two.npz", "-o", "a.npy", "--window", "2", "--storage-option"],
        ["demo", "--photo"],
        ["plan", "1", "--size"],
    ],
)
def test_a_text_that_names_no_file_is_left_as_it_is(run, arguments, text):
    np.save("one.npy", np.ones((4, 8, 8), bool))
    np.savez("two.npz", a=np.ones((4, 8, 8), bool), b=np.ones((4, 8, 8), bool))
    status, output = run(*arguments, text)
    assert status == 1
    assert f"'{text}'" in output


def test_the_current_folder_is_a_capture(run, tmp_path, monkeypatch):
    folder = tmp_path / "frames"
    folder.mkdir()
    for number in range(2):
        jl.save(np.eye(4, 5, dtype=int), folder / f"{number}.png")
    monkeypatch.chdir(folder)
    options = "--unpacked", "--frames", "2", "--method", "mle"
    status, output = run("info", ".")
    assert status == 0
    assert "4 x 5" in output
    assert run("reconstruct", ".", *options, "-o", "../a.tif")[0] == 0
    assert "frames" in run("info", "../a.tif")[1]


HELP: dict[str, str] = {}


def help_of(run, command):
    """Return the name of a command and its help page, which is made once."""
    name = command.__name__.replace("_", "-")
    if name not in HELP:
        status, output = run(name, "--help")
        assert status == 0
        HELP[name] = output
    return name, HELP[name]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_every_command_has_a_help_page_with_a_text_for_each_option(run, command):
    name, output = help_of(run, command)
    assert f"Usage: jotlight {name}" in output
    arguments = app[name].assemble_argument_collection()
    assert len(arguments)
    for argument in arguments:
        if argument.show:
            assert argument.parameter.help, argument.name


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_every_option_shows_its_default_or_is_required(run, command):
    name, output = help_of(run, command)
    entries = re.split(r"\n│ [* ]{0,4}(?=\S)", output)
    options = [entry for entry in entries if entry.startswith("--")]
    shown = [each for each in app[name].assemble_argument_collection() if each.show]
    assert len(options) == sum(each.name.startswith("--") for each in shown)
    missing = [
        each for each in options if not re.search(r"Default\b|\[default:|\[required\]", each)
    ]
    assert missing == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_help_page_shows_the_defaults_of_its_own_command(run, command):
    text = " ".join(help_of(run, command)[1].split())
    others = [f"for {each.__name__.replace('_', '-')}" for each in COMMANDS]
    found = [each for each in others if re.search(rf"Default:[^│]*\b{each}\b", text)]
    assert found == []


def test_each_command_has_examples():
    names = [command.__name__.replace("_", "-") for command in COMMANDS]
    assert list(EXAMPLES) == names


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "line"), [(name, line) for name, lines in EXAMPLES.items() for line in lines]
)
def test_the_examples_of_a_help_page_are_command_lines(run, command, line):
    words = shlex.split(line)
    assert words[:2] == ["jotlight", command]
    assert len(line) < 80, "a line of a terminal"
    app.parse_args(words[1:], exit_on_error=False, print_error=False)
    assert line in " ".join(run(command, "--help")[1].split())


def test_an_option_that_occurs_twice_takes_its_last_value(run, tmp_path):
    np.save("scene.npy", np.full((6, 8), 0.5, np.float32))
    arguments = ["simulate", "scene.npy", "-o", "a.npy", "-k", 2, "-t", 3]
    assert run(*arguments, "--oversampling", 5, "-t", 1, "-o", "b.npy")[0] == 0
    assert jl.open("b.npy").sensor == jl.Sensor(oversampling=5)
    assert not (tmp_path / "a.npy").exists()


def test_a_name_that_begins_with_a_hyphen_follows_two_hyphens(run):
    np.save("-scene.npy", np.full((6, 8), 0.5, np.float32))
    assert run("simulate", "-o", "a.npy", "--", "-scene.npy")[0] == 0
    assert jl.open("a.npy").shape == (1, 24, 32)


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_has_a_completion_script(shell):
    script = app.generate_completion(shell=shell)
    for text in ("reconstruct", "fine-tune", "frame-range"):
        assert text in script


def test_help_loads_no_heavy_package():
    heavy = {"scipy", "skimage", "matplotlib", "torch", "tifffile", "PIL", "safetensors", "jinja2"}
    code = "import sys; from jotlight.cli.app import run; run(['--help']);"
    code += "print('loaded:', *sorted({name.split('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = done.stdout.split("loaded: ")[1].split()
    assert "cyclopts" in loaded
    assert not heavy & set(loaded)


ITERATIVE = {"admm-tv": jl.admm_tv, "mle-iterative": jl.mle_iterative}


def test_version_is_printed_and_help_lists_every_command(run):
    assert jl.__version__ in run("--version")[1]
    overview = run("--help")[1]
    for command in (
        "demo",
        "compare",
        "simulate",
        "reconstruct",
        "train",
        "fine-tune",
        "evaluate",
        "info",
        "convert",
    ):
        assert command in overview
        assert run(command, "--help")[0] == 0


def test_help_shows_the_defaults(run):
    output = run("simulate", "--help")[1]
    assert "[default: 4]" in output
    assert "[default: 1]" in output


def test_help_lists_the_iterative_methods_and_their_options(run):
    for command in ("reconstruct", "compare", "evaluate"):
        output = run(command, "--help")[1]
        assert all(name in output for name in ITERATIVE)
    output = run("reconstruct", "--help")[1]
    for option in ("--weight", "--norm", "--tol", "--max-iter", "isotropic", "anisotropic"):
        assert option in output
    assert "Iterative methods" in output


def test_help_states_the_defaults_of_the_command(run):
    panels = run("reconstruct", "--help")[1].split("\n╭─ ")
    assert ["--demosaicing" in panel for panel in panels[:4]] == [False, False, True, False]
    assert "half a count below" in run("film", "--help")[1]
    assert "or that of --start" in run("fine-tune", "--help")[1]
    planned = run("plan", "--help")[1]
    assert "A capture or a network that states" not in planned
    assert "half a count below" in planned
    assert "--exposure-time" not in planned


LONG = {"demo", "train", "fine-tune", "reproduce", "view"}
"""Commands whose examples take long or do not end, or need PyTorch or further data."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("command", [name for name in EXAMPLES if name not in LONG])
def test_the_examples_of_a_help_page_run(run, photo_folder, monkeypatch, command):
    monkeypatch.setattr(sys, "path", list(sys.path))
    Path("mine.py").write_text("def denoise(bits):\n    return bits.counts() / 16\n")
    Path("photo.png").write_bytes((photo_folder / "0.png").read_bytes())
    image, flat = jl.datasets.photograph("camera")[:64, :64], np.full((32, 32), 0.5)
    jl.save(jl.Sensor(frames=64).expose(image, rng=0), "capture.npy")
    np.save("counts.npy", jl.open("capture.npy").counts())
    scene = jl.datasets.moving(image, "shake", sensor=jl.Sensor(frames=64), shape=(48, 48), rng=0)
    jl.save(scene.bits, "moving.npy")
    jots = np.random.default_rng(0).random((64, 256, 512)) < 0.3
    np.packbits(jots, axis=2, bitorder="little").tofile("raw.bin")
    jl.save(jl.Sensor(frames=400, dark_counts=0.01).expose(np.zeros((32, 32)), rng=0), "dark.npy")
    jl.save(jl.Sensor(frames=400, dark_counts=0.01).expose(flat, rng=1), "flat.npy")
    jl.Network.initial(jl.Sensor(oversampling=4)).save("mine.safetensors")
    if command == "gather":
        video = ["reconstruct", "capture.npy", "-o", "videos/{name}.zarr", "--window", 16]
        assert run(*video, "--method", "mle", "--part", "1/1")[0] == 0
    for line in EXAMPLES[command]:
        status, output = run(*shlex.split(line)[1:])
        assert status == 0, output
