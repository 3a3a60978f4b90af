"""Fixtures that several folders of tests use."""

import os

# pytest runs a process per core.
if "PYTEST_XDIST_WORKER" in os.environ and hasattr(os, "sched_setaffinity"):  # Linux
    cores = sorted(os.sched_getaffinity(0))
    worker = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
    os.sched_setaffinity(0, {cores[worker % len(cores)]})

import gc
import signal
import sys
from pathlib import Path

import hypothesis
import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from chromium import chromium, launch_options

hypothesis.settings.register_profile("quick", max_examples=30, deadline=None, derandomize=True)
hypothesis.settings.register_profile("slow", max_examples=1000, deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))

# All objects of the collection live until the end, so a search for garbage among them is in vain.
# `gc.disable` would last: dask, which is imported meanwhile, notes the present state as the usual.
THRESHOLDS = gc.get_threshold()
gc.set_threshold(0)


def pytest_collection_finish() -> None:
    """Search for garbage only among the objects of the tests."""
    gc.freeze()
    gc.set_threshold(*THRESHOLDS)


# Tests cut no power. Without this, they wait for the disk thousands of times. A closed file is an
# error as before.
os.fsync = os.fstat

# A shell lets its background jobs ignore Ctrl-C, and the tests may be one.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_xdist_setupnodes() -> None:
    """Let the linear algebra of each process use one thread.

    Threads on the cores of other processes would wait for each other. Plugins of pytest import
    NumPy before this file, so a process cannot limit its own threads here.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder with the experiments' data: bsds300/, real/, and others."""
    chosen = os.environ.get("JOTLIGHT_DATA")
    folder = Path(chosen) if chosen else Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no data in {folder}: set JOTLIGHT_DATA to the folder that holds bsds300/")
    return folder


@pytest.fixture(scope="module")
def browser():
    """Return a Chromium, for the tests of pages."""
    pytest.importorskip(
        "playwright.sync_api", reason="no Playwright: pip install 'jotlight[browser]'"
    )
    try:
        launch_options()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    with chromium() as running:
        yield running


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Return a function that runs a command in an empty folder.

    It returns the exit status, and everything that the command printed.
    """
    # The process that distributes the tests does not need these.
    from cyclopts import App

    from assembled_options import assemble_once
    from jotlight.cli import app
    from jotlight.cli.terminal import console

    monkeypatch.chdir(tmp_path)
    # Rich breaks lines at the terminal's width.
    monkeypatch.setattr(console.out, "width", 200)
    monkeypatch.setattr(console.err, "width", 200)
    monkeypatch.setattr(app, "end_at_once", sys.exit)
    monkeypatch.setattr(App, "assemble_argument_collection", assemble_once)

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["jotlight", *map(str, arguments)])
        console.shown_warnings.clear()
        with pytest.raises(SystemExit) as ended:
            app.main()
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out + printed.err

    return run


@pytest.fixture
def photo_folder(tmp_path):
    """Return a folder with three small photographs."""
    folder = tmp_path / "photos"
    folder.mkdir()
    levels = (jl.datasets.photograph("camera") * 255).astype(np.uint8)
    for number in range(3):
        top = 100 + 30 * number
        Image.fromarray(levels[top : top + 24, 180:204]).save(folder / f"{number}.png")
    return folder
