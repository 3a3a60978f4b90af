"""The speed benchmarks of the deep networks: costs, programs, precision, and their section."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.experiments.report.markdown import render_markdown
from jotlight.networks.architectures import ARCHITECTURES
from short_benchmarks import BRIEF, make_case, make_run, make_task
from suite.case import Rival, measure
from suite.competitors import competitor_sections, cost_table, precision_table, ratio_table
from suite.machine import cores
from suite.page import build_report
from suite.tasks.deep_networks import (
    INPUT_TRANSFORM,
    OUTPUT_TRANSFORM,
    network_of,
    operations_per_pixel,
)
from suite.tasks.deep_rivals import AUTOCAST, PROGRAMS, RELU, SAME_RESULT, rivals
from suite.tasks.relu_network import WIDTHS, cost, hidden_channels
from suite.tasks.scene import HEIGHT, WIDTH, bits, counts, unpacked
from suite.tasks.two_layer_network import TORCH
from suite.threads import allowed_threads, limited

ROOT = Path(__file__).parents[2]
TRANSFORMS = "crates/jotlight/src/network/convolution/winograd/transforms.rs"


def make_network_task(**seconds):
    task = make_task("network-small", "Network, small", jotlight=2.0, **seconds)
    return task | {
        "multiply_adds": {"direct convolution": 914.0, "both": 471.75},
        "rounded_differences": {AUTOCAST: 0.02},
        "psnr": {"jotlight": 30.0, TORCH: 30.0, AUTOCAST: 29.75},
    }


@pytest.mark.parametrize("size", ARCHITECTURES)
def test_the_plain_network_costs_as_much_as_direct_convolution(size):
    operations = operations_per_pixel(network_of(size))
    channels = hidden_channels(operations.direct)
    assert cost(channels) == pytest.approx(operations.direct, rel=0.01)
    assert set(channels[:-1]) <= {*WIDTHS}
    assert operations.products < operations.performed < 0.52 * operations.direct


def test_the_cost_of_the_plain_network_counts_each_tap():
    # Filters of 4 x 4, 3 x 3, and 4 x 4 taps, for each of one fourth of the pixels.
    assert cost([3, 2]) == (16 * 3 + 9 * 3 * 2 + 16 * 2) / 4


def test_the_transforms_do_as_many_multiply_adds_as_the_engine():
    source = (ROOT / TRANSFORMS).read_text("utf-8")
    of_input, of_output = source.split("fn transform_input")[1].split("fn transform_output")
    number_of_input, number_of_output = (
        len(re.findall(r"\badd\(", body)) for body in (of_input, of_output)
    )
    # 6 rows and 6 columns of an input, 6 columns and 4 rows of an output, for 16 positions.
    assert number_of_input * (6 + 6) / 16 == INPUT_TRANSFORM
    assert number_of_output * (6 + 4) / 16 == OUTPUT_TRANSFORM


def test_counts_of_packed_bits_are_those_of_jots():
    pytest.importorskip("numpy", "2.0")
    blocks = unpacked(bits()).reshape(HEIGHT, 4, WIDTH, 4)
    assert np.array_equal(counts(bits()), blocks.sum(axis=(1, 3), dtype=np.float32))


def test_the_tables_list_every_program():
    each = rivals(jl.Network.initial(jl.Sensor(oversampling=4)), 1000.0)
    assert [rival.name for rival in each] == list(PROGRAMS)
    assert set(SAME_RESULT) == {
        rival.name
        for rival in each
        if rival.same and not rival.rounded and "jotlight" not in rival.name
    }


def test_a_program_knows_its_number_of_threads():
    with limited(1):
        assert allowed_threads() == 1
    assert allowed_threads() == cores()


def test_the_difference_of_less_precise_programs_is_stated_and_not_limited():
    each = [
        Rival("exact", lambda _: lambda: np.ones(3)),
        Rival("rounded", lambda _: lambda: np.full(3, 0.5), rounded=True),
        Rival("other", lambda _: lambda: np.zeros(3), same=False),
    ]
    measured = measure(make_case(each, psnr=lambda result: 30 * result[0]), [1], BRIEF)
    assert measured["differences"] == {"exact": 0}
    assert measured["rounded_differences"] == {"rounded": 0.5}
    assert measured["psnr"] == {"jotlight": 30, "exact": 30, "rounded": 15}


def test_the_section_has_ratios_precision_and_costs():
    task = make_network_task(**{TORCH: 8.0, AUTOCAST: 3.0, RELU: 1.0})
    assert [list(row) for row in ratio_table([task], [1]).rows] == [
        [TORCH, 4.0],
        [AUTOCAST, 1.5],
        [RELU, 0.5],
    ]
    assert [list(row) for row in precision_table([task]).rows] == [
        ["jotlight", None, 30.0, 0.0],
        [AUTOCAST, 0.02, 29.75, 0.25],
    ]
    assert [list(row) for row in cost_table([task]).rows] == [["small", 914.0, 471.75]]
    page = render_markdown(build_report(make_run(task)))
    assert "run.py --only network-small" in page


def test_a_program_that_was_left_out_of_one_size_has_an_empty_cell():
    large = make_network_task(**{TORCH: 8.0}) | {"title": "Network, large"}
    rows = ratio_table([make_network_task(**{RELU: 1.0}), large], [1]).rows
    assert [list(row) for row in rows] == [[TORCH, None, 4.0], [RELU, 0.5, None]]


def test_a_run_without_deep_networks_has_no_section():
    assert competitor_sections(make_run(make_task(jotlight=1.0)), "command") == []


def test_the_command_prints_a_line_for_a_program_that_is_not_installed(
    tmp_path, monkeypatch, capsys
):
    # Other folders have a program `run`, too, so this one is loaded by its path.
    spec = importlib.util.spec_from_file_location("run_speed", ROOT / "benchmarks/speed/run.py")
    run = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(run)
    case = make_case([Rival("absent", lambda _: None, "a_package_that_is_not_there")])
    monkeypatch.setattr(run, "TASKS", {"any": lambda quick: [case]})
    monkeypatch.setattr(run, "QUICK", BRIEF)
    monkeypatch.setattr(run, "DEBUG_BUILD", False)
    options = ["--quick", "--only", "any", "--threads", "1", "--output", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["run.py", *options])
    run.main()
    expected = "Any: absent is left out because the package a_package_that_is_not_there"
    assert f"{expected} is not installed." in capsys.readouterr().out.splitlines()
