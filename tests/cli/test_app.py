"""The command line as a whole: exit codes, usage errors, help, and shell completion."""

import subprocess
import sys

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.app import COMMANDS, app


@pytest.mark.parametrize(
    ("arguments", "message", "help_command"),
    [
        (["recontruct"], 'Unknown command "recontruct"', "jotlight --help"),
        (["info"], "parameter FILE requires an argument", "jotlight info --help"),
        (["info", "a.npy", "b.npy"], "Unused Tokens: ['b.npy']", "jotlight info --help"),
        (["info", "a.npy", "--nope"], "Unknown option: --nope", "jotlight info --help"),
        (["train", "photos"], "parameter --output requires an argument", "jotlight train --help"),
        (["plan", "1", "--frames", "x"], 'unable to convert "x" into int', "jotlight plan --help"),
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


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.__name__)
def test_every_command_has_a_help_page_with_a_text_for_each_option(run, command):
    name = command.__name__.replace("_", "-")
    status, output = run(name, "--help")
    assert status == 0
    assert output == run(name, "-h")[1]
    assert f"Usage: jotlight {name}" in output
    arguments = app[name].assemble_argument_collection()
    assert len(arguments)
    for argument in arguments:
        if argument.show:
            assert argument.parameter.help, argument.name


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


@pytest.mark.parametrize(
    "shell", ["bash", *(pytest.param(each, marks=pytest.mark.slow) for each in ("zsh", "fish"))]
)
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
        assert command in run("--help")[1]
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
