"""`jotlight demo`."""

import pytest


def files(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.slow
def test_demo_shows_at_least_three_methods(run, tmp_path):
    status, output = run("demo", "-o", "demo.png")
    assert status == 0
    assert output.count(" dB") >= 3
    assert files(tmp_path) == ["demo.png"]
