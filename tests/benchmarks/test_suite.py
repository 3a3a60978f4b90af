"""The speed benchmarks: quantities derived from times, comparisons, and a short run."""

import copy
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jotlight._engine import cpu_level, cpu_levels
from jotlight.experiments.report.markdown import render_markdown
from short_benchmarks import BRIEF, PROBES, make_case, make_run, make_task
from suite.case import SCALAR_TOLERANCE, CannotRunError, Rival, compare_levels, measure
from suite.comparisons import compare, comparisons
from suite.derived import (
    filter_share_of_peak,
    limiting_resource,
    median_ratio,
    peak,
    ratio,
    relative_spread,
    share_of_bound,
    speedup,
)
from suite.page import build_report
from suite.tables import comparison_table, format_significant, method_table, thread_table
from suite.tasks.filtering import NDIMAGE, ONE_TAP, OPENCV
from suite.tasks.two_layer_network import BM3D, COMPILED, TORCH, TV
from suite.timing import race

ROOT = Path(__file__).parents[2]


def render(run):
    return render_markdown(build_report(run))


@pytest.mark.parametrize(
    ("value", "text"), [(1234.5, "1,234"), (99.96, "100"), (0.01234, "0.0123"), (2, "2")]
)
def test_numbers_have_three_significant_figures(value, text):
    assert format_significant(value) == text


def test_quantities_follow_from_the_times():
    task = make_task(jotlight=1.0, rival=3.0)
    assert ratio(task, "rival", 1) == 3
    assert peak(task, 1) == 1000
    assert limiting_resource(task, 1) == "memory"
    assert share_of_bound(task, 1) == 0.5
    assert relative_spread([1, 2, 3, 4, 5]) == pytest.approx(2 / 3)
    assert relative_spread([1.0]) == 0
    faster = copy.deepcopy(task)
    faster["seconds"]["2"] = {"jotlight": [0.5, 0.5]}
    assert speedup(faster, 2) == 2


def test_a_ratio_does_not_depend_on_a_machine_that_slows_down_between_rounds():
    assert median_ratio([4, 4, 8, 8], [2, 2, 4, 4]) == 2


def test_the_filter_alone_excludes_the_time_of_one_tap():
    task = make_task(jotlight=0.3, **{ONE_TAP: 0.1})
    assert filter_share_of_peak(task, ONE_TAP) == pytest.approx((100 - 10) / 1000 / 0.2)


def test_a_comparison_is_with_the_fastest_alternative():
    times = {OPENCV: 3.0, NDIMAGE: 2.0, ONE_TAP: 0.5}
    comparison = compare(make_task("filter", "Filter", jotlight=1.0, **times), 1)
    assert (comparison.alternative, comparison.ratio) == (NDIMAGE, 2.0)
    assert comparison.seconds == 1.0


def test_each_number_of_threads_has_its_own_fastest_alternative():
    times = {TORCH: 3.0, COMPILED: 2.0}
    task = make_task("network-small", "Network, small", jotlight=1.0, **times)
    task["seconds"]["2"] = {"jotlight": [0.5] * 2, TORCH: [1.0] * 2, COMPILED: [1.5] * 2}
    assert compare(task, 1).alternative == COMPILED
    assert (compare(task, 2).alternative, compare(task, 2).ratio) == (TORCH, 2.0)
    assert compare(task, 4) is None
    run = make_run(task) | {"threads": [1, 2]}
    (row,) = comparison_table(run).rows
    assert list(row) == ["Network, small", 1000.0, COMPILED, 2.0, 500.0, TORCH, 2.0]


def test_a_task_without_a_measured_alternative_has_no_comparison():
    run = make_run(make_task(jotlight=1.0), make_task("unknown", jotlight=1.0, NumPy=2.0))
    assert comparisons(run, 1) == []
    assert "Counting" in render(run)


def test_the_method_table_has_the_networks_and_the_other_methods():
    networks = [
        make_task("network-two-layer", "Network, two-layer", jotlight=1.0, **{TV: 2.0, BM3D: 3.0}),
        make_task("network-small", "Network, small", jotlight=4.0),
    ]
    table = method_table(make_run(*networks))
    assert [row[:2] for row in table.rows] == [
        ["Network, two-layer", 1000.0],
        ["Network, small", 4000.0],
        ["Non-iterative, TV (changed since)", 2000.0],
        ["Non-iterative, BM3D", 3000.0],
    ]
    assert all(row[2] for row in table.rows)
    assert method_table(make_run(make_task(jotlight=1.0))) is None


def test_the_thread_table_compares_two_threads_with_one():
    task = make_task(jotlight=1.9)
    task["seconds"]["2"] = make_task(jotlight=1.0)["seconds"]["1"]
    task["probes"]["operations"]["2"] = 3600.0
    (row,) = thread_table(make_run(task) | {"threads": [1, 2]}).rows
    assert list(row) == ["Counting", pytest.approx(1.9), pytest.approx(1.8), 1.0, 1.0]


def test_the_page_states_every_difference():
    task = make_task(jotlight=1.0, a=2.0)
    task |= {"level_differences": {"x86-64-v3": 2e-5}, "differences": {"a": 0.1}, "tolerance": 0.5}
    page = render(make_run(task))
    assert "from scalar code: x86-64-v3 2.0e-05." in page
    assert "Difference (tolerance 0.5): a 1.0e-01." in page


def test_a_program_that_cannot_run_is_left_out_with_its_reason():
    def refuse(_):
        raise CannotRunError("it refuses")

    rivals = [
        Rival("same", lambda _: lambda: np.ones(3)),
        Rival("absent", lambda _: None, "a_package_that_is_not_there"),
        Rival("refuses", refuse),
    ]
    measured = measure(make_case(rivals), [1], BRIEF)
    assert measured["left_out"] == {
        "absent": "the package a_package_that_is_not_there is not installed",
        "refuses": "it refuses",
    }
    assert list(measured["seconds"]["1"]) == ["jotlight", "same", *PROBES]
    assert measured["differences"] == {"same": 0}
    assert "Any: refuses is left out because it refuses." in render(make_run(measured))


def test_nothing_is_timed_where_results_differ():
    with pytest.raises(AssertionError, match="wrong differs"):
        measure(make_case([Rival("wrong", lambda _: lambda: np.zeros(3))]), [1], BRIEF)
    with pytest.raises(AssertionError, match="7 threads differ"):
        measure(make_case([], run=lambda threads: np.full(3, threads)), [1], BRIEF)


@pytest.mark.skipif(len(cpu_levels()) < 2, reason="this processor has one instruction set only")
@pytest.mark.parametrize("difference", [9e-5, 2e-4])
def test_instruction_sets_have_to_agree_with_scalar_code(difference):
    def run(_):
        return np.array([1.0, 1.0 if cpu_level() == "scalar" else 1.0 + difference])

    if difference < SCALAR_TOLERANCE:
        found = compare_levels(make_case([], run=run))
        assert set(found) == set(cpu_levels()) - {"scalar"}
        assert list(found.values()) == pytest.approx([difference] * len(found))
    else:
        with pytest.raises(AssertionError, match="any:"):
            compare_levels(make_case([], run=run))


def test_programs_take_turns():
    calls = []
    runs = {name: lambda threads, name=name: calls.append((name, threads)) for name in "ab"}
    times = race(runs, [1], BRIEF)
    assert [len(times["1"][name]) for name in "ab"] == [2, 2]
    # Each turn has two calls, and the first does not count.
    assert calls == [(name, 1) for name in "aabb"] * 2


@pytest.mark.slow
def test_the_command_writes_json_and_a_page(tmp_path):
    command = [sys.executable, str(ROOT / "benchmarks/speed/run.py"), "--quick"]
    subprocess.run(
        [*command, "--only", "counting", "--output", str(tmp_path)], check=True, capture_output=True
    )
    run = json.loads((tmp_path / "speed/run.json").read_text("utf-8"))
    assert render(run) == (tmp_path / "speed.md").read_text("utf-8")
    (counting,) = run["tasks"]
    assert counting["differences"]["NumPy, unpack and sum"] == 0


@pytest.mark.slow
def test_a_debug_build_is_refused():
    code = (
        "import sys; sys.path.insert(0, 'benchmarks/speed'); sys.argv = ['run.py', '--quick']\n"
        "from jotlight import _engine; _engine.DEBUG_BUILD = True\n"
        "import run; run.main()"
    )
    refused = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert refused.returncode == 1
    assert "debug build" in refused.stderr
