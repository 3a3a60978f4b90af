import sys

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight import cli
from jotlight.cli import console


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Run a command in an empty folder; give its exit status and all that it printed."""
    monkeypatch.chdir(tmp_path)
    # Rich breaks lines at the terminal's width.
    monkeypatch.setattr(console.out, "width", 200)
    monkeypatch.setattr(console.err, "width", 200)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["jotlight", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out + printed.err

    return run


@pytest.fixture
def pictures(tmp_path):
    """A folder with three small photographs."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    levels = (jl.datasets.photograph("camera") * 255).astype(np.uint8)
    for number in range(3):
        top = 100 + 30 * number
        Image.fromarray(levels[top : top + 24, 180:204]).save(folder / f"{number}.png")
    return folder
