"""`jotlight reproduce`: the command."""

import json

import pytest

from jotlight.experiments import EXPERIMENTS
from jotlight.experiments.experiment import Experiment, Part, PartResult


@pytest.mark.slow
def test_one_experiment_runs_alone_in_the_default_folder(run, tmp_path):
    status, output = run("reproduce", "fig5", "--quick")
    assert status == 0, output
    assert "reproduction-quick/report.html" in output
    assert (tmp_path / "reproduction-quick/results/fig5.csv").is_file()
    settings = json.loads((tmp_path / "reproduction-quick/parts/fig5/settings").read_text())
    assert settings["quick"] is True


def test_a_stopped_run_prints_how_to_resume(run, tmp_path, monkeypatch):
    from jotlight.experiments import runner

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "run_part", stopped)
    status, output = run("reproduce", "fig5", "--quick")
    assert status == 130
    assert "The same command resumes the run" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fig8"], "expected one of fig5, fig6a, fig6b, fig7, timing, gain, or all, got 'fig8'"),
        (["fig7", "--data", "nowhere"], "there is no folder nowhere"),
        (["fig6b", "--data", "."], "expected"),
        (["fig5", "-o", "file"], "expected a folder"),
        (["fig5", "-o", "file/inside"], "file"),
    ],
)
def test_bad_input_gets_an_error_message(run, tmp_path, arguments, message):
    (tmp_path / "file").write_text("")
    status, output = run("reproduce", *arguments)
    assert status == 1
    assert message in output
    assert "Traceback" not in output


def test_the_names_in_the_help_are_those_of_the_experiments(run):
    from jotlight.cli.reproduce import EXPERIMENT_NAMES

    assert list(EXPERIMENTS) == list(EXPERIMENT_NAMES)


def test_a_function_is_refused_where_no_methods_are_compared(run, own_module):
    status, output = run("reproduce", "fig5", "--quick", "-m", f"{own_module}:mean")
    assert status == 1
    assert "method: fig5 compares no methods; fig7, timing, and gain do" in output


@pytest.mark.parametrize(
    "experiment",
    [
        pytest.param("fig7", marks=pytest.mark.slow),
        pytest.param("gain", marks=pytest.mark.exhaustive),
    ],
)
def test_a_function_of_the_user_is_a_row_of_the_table(run, data, own_module, tmp_path, experiment):
    arguments = ["--quick", "--data", data, "-m", f"{own_module}:mean", "-o", "out"]
    status, output = run("reproduce", experiment, *arguments)
    assert status == 0, output
    assert f"{own_module}:mean" in (tmp_path / f"out/results/{experiment}.csv").read_text()
    assert f"| {own_module}:mean |" in (tmp_path / "out/results/reproduction.md").read_text()
    (tmp_path / f"{own_module}.py").write_text("def mean(bits):\n    return bits.counts() / 5\n")
    status, output = run("reproduce", experiment, *arguments)
    assert status == 1
    assert "holds results with other settings (methods)" in output


def test_a_continued_run_says_that_files_behind_a_function_are_not_checked(
    run, own_module, monkeypatch
):
    def stopped(_):
        raise KeyboardInterrupt

    parts = [Part("first", 1, lambda _: PartResult([])), Part("second", 1, stopped)]
    experiment = Experiment(
        "gain", "Gain", {}, {}, lambda _: parts, lambda _: None, compares_methods=True
    )
    monkeypatch.setattr("jotlight.experiments.EXPERIMENTS", {"gain": experiment})
    for expected in ("gain, first", "gain: 1 of 2 parts are done; if a file that"):
        status, output = run("reproduce", "gain", "-m", f"{own_module}:mean")
        assert status == 130
        assert expected in output
