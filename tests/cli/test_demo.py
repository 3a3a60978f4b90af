"""`jotlight demo`."""

import inspect

import pytest

from folders import file_names
from jotlight.cli.demo import demo
from jotlight.datasets import PHOTOGRAPHS


def test_the_default_photograph_is_one_of_scikit_image():
    assert inspect.signature(demo).parameters["photo"].default in PHOTOGRAPHS


@pytest.mark.slow
def test_demo_shows_all_methods_that_need_no_extra(run, tmp_path):
    status, output = run("demo", "--photo", "coins", "-o", "demo.png")
    assert status == 0
    assert output.count(" dB") >= 3
    assert "network, two-layer" in output
    assert file_names(tmp_path) == ["demo.png"]
