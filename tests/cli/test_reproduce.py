import csv
import json
import re
from typing import get_args

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.cli import app
from jotlight.evaluation.methods import DEEP_NETWORKS, METHODS
from jotlight.experiments import EXPERIMENTS
from jotlight.experiments.bsds_methods import crop_center
from jotlight.experiments.experiment import Data
from jotlight.experiments.posterior_mean import posterior_mean_psnr
from jotlight.experiments.report.content import Verdict
from jotlight.experiments.report.markdown import render_markdown
from jotlight.experiments.report.report import read_report
from reference.datasets import TEST, make_data


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return make_data(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module")
def made(tmp_path_factory, data):
    """All experiments, quick, once for all tests."""
    folder = tmp_path_factory.mktemp("made") / "out"
    words = ["reproduce", "all", "--quick", "--data", str(data), "-o", str(folder)]
    assert app.run(words) == 0
    return folder


def rows_of(folder, name):
    with (folder / "results" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def installed():
    return {
        name
        for name, method in METHODS.items()
        if method.available and name not in ("mle-iterative", *DEEP_NETWORKS)
    }


def test_each_experiment_leaves_its_table_and_figures(made):
    for name in EXPERIMENTS:
        assert rows_of(made, name)
    for name in ("fig5.svg", "fig6a.svg", "fig6b.svg", "gain-exposure.svg", "gain-bits.svg"):
        assert (made / "results" / name).read_text().startswith("<?xml")
    with Image.open(made / "results/fig7.jpg") as picture:
        assert min(picture.size) > 300


def test_the_page_and_the_markdown_have_every_experiment(made):
    page = (made / "report.html").read_text("utf-8")
    text = (made / "results/reproduction.md").read_text("utf-8")
    for experiment in EXPERIMENTS.values():
        assert experiment.title in page
        assert f"## {experiment.title}" in text
    assert "quick runs" in page
    assert "quick runs" in text
    targets = re.findall(r"\]\(([^)#]+)\)", text)
    assert targets
    for target in targets:
        assert (made / "results" / target).is_file(), target


def test_the_markdown_follows_from_the_tables_alone(made):
    text = (made / "results/reproduction.md").read_text("utf-8")
    again = render_markdown(read_report(made / "results"))
    assert again == text


def test_the_same_command_again_does_nothing_anew(made, data, run):
    before = {path: path.stat().st_mtime_ns for path in (made / "parts").rglob("*")}
    status, said = run("reproduce", "all", "--quick", "--data", data, "-o", made)
    assert status == 0
    assert {path: path.stat().st_mtime_ns for path in (made / "parts").rglob("*")} == before
    for name in EXPERIMENTS:
        assert re.search(rf"{name}: (\d+) of \1 parts are done", said)


def test_full_settings_do_not_mix_with_quick_ones(made, run):
    status, said = run("reproduce", "fig5", "-o", made)
    assert status == 1
    assert "other settings" in said
    assert "--restart" in said


def test_fig5_starts_with_the_cost_of_the_initial_network(made):
    sensor = jl.Sensor(oversampling=6)
    scenes = jl.datasets.uniform_scenes(np.random.default_rng(5), 64)
    for sigma in (0.25, 0.7):
        network = jl.Network.initial(sensor, sigma=sigma)
        errors = [
            np.sum((network.reconstruct(sensor.expose(scene, rng=i)) - scene) ** 2) / 2
            for i, scene in enumerate(scenes)
        ]
        rows = [row for row in rows_of(made, "fig5") if float(row["sigma"]) == sigma]
        assert [int(row["iteration"]) for row in rows] == list(range(41))
        # Six standard errors: of the 128 scenes of a step, and of ours.
        spread = 6 * np.std(errors) * np.sqrt(1 / 128 + 1 / 64)
        assert float(rows[0]["cost"]) == pytest.approx(np.mean(errors), abs=spread)
    # From the other start the noise of a batch hides so short a way.
    assert float(rows[-1]["cost"]) < 0.98 * float(rows[0]["cost"])


def test_fig6a_lies_between_its_start_and_the_limit(made):
    rows = rows_of(made, "fig6a")
    for bits, exact in ((9, 13.147), (100, 22.132)):
        found = {
            (row["estimator"], row["sigma"]): float(row["psnr"])
            for row in rows
            if int(row["bits"]) == bits
        }
        # 64 scenes of 32 x 32: the mean square error is known to about half a percent.
        assert found["mle", ""] == pytest.approx(exact, abs=0.15)
        assert found["mle", ""] < found["learned", ""] < posterior_mean_psnr(bits) + 0.15
        assert found["initial", "0.25"] == pytest.approx(exact, abs=0.2)


def test_fig6b_is_what_evaluate_gives(made, data):
    tests = Data(data).cifar10("test", 32)
    sensor = jl.Sensor(oversampling=3)
    found = {
        (row["estimator"], row["sigma"]): float(row["psnr"])
        for row in rows_of(made, "fig6b")
        if row["bits"] == "9"
    }
    assert found["mle", ""] == pytest.approx(jl.evaluate(jl.mle, tests, sensor).mean("psnr"), 1e-5)
    start = jl.Network.initial(sensor, sigma=0.6)
    expected = jl.evaluate(start, tests, sensor).mean("psnr")
    assert found["initial", "0.6"] == pytest.approx(expected, 1e-5)


def test_fig7_tells_what_its_pictures_show(made, data):
    names, images = Data(data).bsds300("test", 2)
    sensor = jl.Sensor(oversampling=4)
    rows = rows_of(made, "fig7")
    assert {row["method"] for row in rows} >= installed()
    for number, (name, image) in enumerate(zip(names, images, strict=True)):
        truth = crop_center(image, 128)
        bits = sensor.expose(truth, number)
        for row in (row for row in rows if row["image"] == name):
            with Image.open(made / f"parts/fig7/{name}-{row['method']}.png") as file:
                shown = np.asarray(file, np.float32) / 255
            # The picture has 8 bits.
            assert float(row["psnr"]) == pytest.approx(jl.metrics.psnr(shown, truth), abs=0.05)
            if row["method"] in METHODS and row["method"] != "network-two-layer":
                estimate = METHODS[row["method"]].run(bits, sensor)
                for measure in ("psnr", "snr", "ssim"):
                    expected = getattr(jl.metrics, measure)(estimate, truth)
                    assert float(row[measure]) == pytest.approx(expected, abs=1e-3)
        with Image.open(made / f"parts/fig7/{name}-bits.png") as file:
            assert (np.asarray(file) == bits.to_array()[0]).all()


def test_fig7_shows_the_network_that_it_learned(made, data):
    _, images = Data(data).bsds300("test", 1)
    network = jl.Network.load(made / "parts/fig7/network.safetensors")
    truth = crop_center(images[0], 128)
    estimate = network.reconstruct(network.sensor.expose(truth, 0))
    row = next(
        r
        for r in rows_of(made, "fig7")
        if (r["image"], r["method"]) == (TEST[0], "network-two-layer")
    )
    assert float(row["psnr"]) == pytest.approx(jl.metrics.psnr(estimate, truth), 1e-5)


def test_timing_has_every_method_in_every_round(made):
    rows = rows_of(made, "timing")
    seen = {(row["cores"], row["method"], row["round"]) for row in rows}
    assert seen == {
        (cores, method, str(number))
        for cores in ("one core", "all cores")
        for method in installed() | {"network-untied"}
        for number in range(2)
    }
    assert len(rows) == len(seen)
    times = {row["method"]: float(row["milliseconds"]) for row in rows}
    assert all(time > 0 for time in times.values())
    # Orders of magnitude apart.
    assert times["admm-tv"] > times["mle"]


def test_gain_has_every_method_for_every_sensor(made, data):
    rows = rows_of(made, "gain")
    sensors = {(row["axis"], row["bits"], row["gain"]) for row in rows}
    assert sensors == {
        ("exposure", "16", "4.0"),
        ("exposure", "16", "16.0"),
        ("bits", "9", "9.0"),
        ("bits", "36", "36.0"),
    }
    names, images = Data(data).bsds300("test")
    truth = crop_center(images[0], 64)
    for axis, bits, gain in sensors:
        found = {
            row["method"]: float(row["psnr"])
            for row in rows
            if (row["axis"], row["bits"], row["gain"], row["image"]) == (axis, bits, gain, names[0])
        }
        assert found.keys() == installed()
        sensor = jl.Sensor(oversampling=round(int(bits) ** 0.5), gain=float(gain))
        seen = sensor.expose(truth, 0)
        for method, psnr in found.items():
            # One network was learned on the way; BM3D's own threads do not always agree.
            if method == "network-two-layer" and gain == "4.0":
                assert psnr > found["network-initial"]
                continue
            expected = jl.metrics.psnr(METHODS[method].run(seen, sensor), truth)
            assert psnr == pytest.approx(expected, abs=1e-3), method


def test_every_claim_has_a_verdict_and_figures(made):
    report = read_report(made / "results")
    claims = [claim for section in report.sections for claim in section.claims]
    assert len(claims) >= 11
    for claim in claims:
        assert claim.verdict in get_args(Verdict)
        assert re.search(r"\d", claim.result) or claim.verdict == "not tested"
        assert claim.reason or claim.verdict not in ("not reproduced", "in part")


def test_one_experiment_alone_in_the_usual_folder(run, tmp_path):
    status, said = run("reproduce", "fig5", "--quick")
    assert status == 0, said
    assert "reproduction-quick/report.html" in said
    assert (tmp_path / "reproduction-quick/results/fig5.csv").is_file()
    settings = json.loads((tmp_path / "reproduction-quick/parts/fig5/settings").read_text())
    assert settings["quick"] is True


def test_a_stopped_run_says_how_to_go_on(run, tmp_path, monkeypatch):
    from jotlight.experiments import runner

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(runner, "run_part", stopped)
    status, said = run("reproduce", "fig5", "--quick")
    assert status == 130
    assert "The same command resumes the run" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fig8"], "expected one of fig5, fig6a, fig6b, fig7, timing, gain, or all, got 'fig8'"),
        (["fig7", "--data", "nowhere"], "there is no folder nowhere"),
        (["fig6b", "--data", "."], "expected"),
        (["fig5", "-o", "file"], "expected a folder"),
        (["fig5", "-o", "file/inside"], "file"),
    ],
)
def test_bad_input(run, tmp_path, words, message):
    (tmp_path / "file").write_text("")
    status, said = run("reproduce", *words)
    assert status == 1
    assert message in said
    assert "Traceback" not in said


def test_the_names_in_the_help_are_those_of_the_experiments(run):
    from jotlight.cli.reproduce import _NAMES

    assert list(EXPERIMENTS) == list(_NAMES)
