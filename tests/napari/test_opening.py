"""`bits.show(viewer=True)` opens napari, or else the page."""

import os
import signal
import subprocess
import sys
import threading
import urllib.request
import webbrowser

import numpy as np
import pytest

import jotlight as jl
from jotlight.napari import opening
from jotlight.view.viewed import Viewed

BITS = jl.Sensor(frames=16).expose(np.full((8, 8), 0.5), rng=0)


def found(*names):
    return lambda name: object() if name in names else None


@pytest.mark.parametrize(
    ("installed", "obstacle", "expected", "printed"),
    [
        (["napari"], None, ["napari"], ""),
        (["napari"], "there is no display", ["page"], "there is no display"),
        ([], None, ["page"], ""),
    ],
)
def test_napari_is_preferred(monkeypatch, capsys, installed, obstacle, expected, printed):
    opened = []
    monkeypatch.setattr(opening, "find_spec", found(*installed))
    monkeypatch.setattr(opening, "napari_obstacle", lambda: obstacle)
    monkeypatch.setattr(opening, "_open_napari", lambda viewed: opened.append("napari"))
    monkeypatch.setattr(opening, "_open_page", lambda viewed: opened.append("page"))
    BITS.show(viewer=True)
    assert opened == expected
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == bool(printed)
    assert printed in "".join(lines)


@pytest.fixture
def fake_qtpy(monkeypatch, tmp_path):
    """Return a function that replaces qtpy by a package with the given code."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "qtpy"]:
        monkeypatch.delitem(sys.modules, name)
    (tmp_path / "qtpy").mkdir()
    monkeypatch.syspath_prepend(tmp_path)

    def write(code, widgets=""):
        (tmp_path / "qtpy" / "__init__.py").write_text(code)
        (tmp_path / "qtpy" / "QtWidgets.py").write_text(widgets)

    yield write
    for name in ("qtpy", "qtpy.QtWidgets"):
        sys.modules.pop(name, None)


def test_a_missing_qt_binding_is_named(fake_qtpy):
    fake_qtpy("class QtBindingsNotFoundError(RuntimeError, ImportError): pass\n"
              "raise QtBindingsNotFoundError('No Qt bindings could be found')")  # fmt: skip
    assert "pip install PyQt6" in opening.napari_obstacle()


def test_a_broken_qt_binding_is_named(fake_qtpy):
    fake_qtpy("", "raise ImportError('libEGL.so.1: cannot open shared object file')")
    assert "Qt cannot be imported (libEGL.so.1" in opening.napari_obstacle()


APPLICATION = """
class QApplication:
    instance = staticmethod(lambda: None)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, "there is no display"),
        ({"QT_QPA_PLATFORM": "xcb"}, "there is no display"),
        ({"QT_QPA_PLATFORM": "offscreen"}, None),
        ({"QT_QPA_PLATFORM": "minimal:enable_fonts"}, None),
        ({"DISPLAY": ":0"}, "tried"),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "tried"),
    ],
)
def test_qt_is_tried_only_with_a_display(monkeypatch, fake_qtpy, variables, expected):
    fake_qtpy("", APPLICATION)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(opening, "_try_qt", lambda: "tried")
    obstacle = opening.napari_obstacle()
    assert obstacle is None if expected is None else expected in obstacle


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("pass", None),
        ("import sys; print('no display :7.', file=sys.stderr); sys.exit(1)", "no display :7)"),
        ("import os; os.abort()", "status -"),
    ],
)
def test_qt_that_does_not_start_is_an_obstacle(monkeypatch, program, expected):
    monkeypatch.setattr(opening, "_START_QT", program)
    obstacle = opening._try_qt()
    assert obstacle is None if expected is None else expected in obstacle


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
@pytest.mark.parametrize("display", [None, ":77"])
def test_without_a_display_the_page_opens(display):
    for name in ("napari", "PyQt6"):
        pytest.importorskip(name)
    program = (
        "import numpy, jotlight\n"
        "from jotlight.napari import opening\n"
        "opening._open_page = lambda viewed: print('the page')\n"
        "jotlight.Bits.from_array(numpy.eye(8, dtype=bool)).show(viewer=True)\n"
    )
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    variables = {name: value for name, value in os.environ.items() if name not in hidden}
    if display is not None:
        variables["DISPLAY"] = display
    ended = subprocess.run(
        [sys.executable, "-c", program], env=variables, capture_output=True, text=True, timeout=120
    )
    assert ended.returncode == 0, ended.stderr
    reason, page = ended.stdout.splitlines()
    # Without this library of the system, Qt fails before it looks for the display.
    assert "display" in reason or (display is not None and "xcb-cursor0" in reason)
    assert page == "the page"


def test_without_both_the_message_says_how_to_install_one(monkeypatch):
    monkeypatch.setattr(opening, "find_spec", found())
    monkeypatch.setattr("jotlight.view.extra.find_spec", found())
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[view\]'"):
        BITS.show(viewer=True)


PROGRAM = """
import sys
import numpy, jotlight
from jotlight.napari import opening
from jotlight.view.serving import Server

Server.open_browser = lambda self: None
opening.find_spec = lambda name: None
{session}
jotlight.Bits.from_array(numpy.eye(8, dtype=bool)[None]).show(viewer=True)
print("goes on", flush=True)
sys.stdin.readline()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "session",
    ["", "sys.ps1 = '>>> '", "sys.modules['ipykernel'] = sys"],
    ids=["script", "console", "notebook"],
)
def test_the_page_says_where_it_is_and_how_it_ends(session):
    pytest.importorskip("jotlight.view.serving", reason="no server")
    command = [sys.executable, "-c", PROGRAM.format(session=session)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, **pipes, text=True) as process:
        address = process.stdout.readline().removeprefix("bits: ").strip()
        assumed = "the bits do not state their sensor; assumed: Sensor()\n"
        assert process.stdout.readline() == assumed
        end = process.stdout.readline()
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        assert b"<title>jotlight</title>" in opener.open(address, timeout=20).read()
        if session:
            assert end == "The page works until this session ends\n"
        else:
            assert end == "Ctrl-C ends the viewer\n"
            process.send_signal(signal.SIGINT)
            assert process.stdout.readline() == "ended\n"
        assert process.stdout.readline() == "goes on\n"
        _, errors = process.communicate("\n", timeout=20)
    assert (process.returncode, errors) == (0, "")


def test_a_browser_in_the_terminal_does_not_delay_the_page(monkeypatch):
    pytest.importorskip("jotlight.view.serving", reason="no server")
    from view_servers import serving

    opened, begun, closed = [], threading.Event(), threading.Event()

    def browse(address):
        opened.append(address)
        begun.set()
        closed.wait(60)

    monkeypatch.setattr(webbrowser, "open", browse)
    with serving(Viewed.from_data(BITS)) as server:
        server.open_browser()
        assert begun.wait(20)
        assert len(opened) == 1
        assert not closed.is_set()
        closed.set()
