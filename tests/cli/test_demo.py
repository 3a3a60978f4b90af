"""`jotlight demo`."""

import pytest

from folders import file_names


@pytest.mark.slow
def test_demo_shows_at_least_three_methods(run, tmp_path):
    status, output = run("demo", "-o", "demo.png")
    assert status == 0
    assert output.count(" dB") >= 3
    assert file_names(tmp_path) == ["demo.png"]
