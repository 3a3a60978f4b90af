"""`bits.show(viewer=True)` opens napari, or else the page."""

import types

import numpy as np
import pytest

import jotlight as jl
from jotlight.napari import opening

BITS = jl.Sensor(frames=16).expose(np.full((8, 8), 0.5), rng=0)


def found(*names):
    return lambda name: object() if name in names else None


@pytest.mark.parametrize(
    ("installed", "expected"),
    [(("napari", "qtpy"), ["napari"]), (("napari",), ["page"]), ((), ["page"])],
)
def test_napari_is_preferred(monkeypatch, installed, expected):
    opened = []
    monkeypatch.setattr(opening, "find_spec", found(*installed))
    monkeypatch.setattr(opening, "_open_napari", lambda viewed: opened.append("napari"))
    monkeypatch.setattr(opening, "_open_page", lambda viewed: opened.append("page"))
    BITS.show(viewer=True)
    assert opened == expected


def test_without_both_the_message_says_how_to_install_one(monkeypatch):
    monkeypatch.setattr(opening, "find_spec", found())
    monkeypatch.setattr("jotlight.view.extra.find_spec", found())
    with pytest.raises(jl.MissingExtraError, match=r"pip install 'jotlight\[view\]'"):
        BITS.show(viewer=True)


@pytest.mark.parametrize("interactive", [True, False])
def test_the_page_opens_in_the_browser(monkeypatch, capsys, interactive):
    serving = pytest.importorskip("jotlight.view.serving", reason="no server")
    addresses, threads = [], []

    def run(self, started):
        started()
        self._socket.close()
        self._workshop.close()
        raise KeyboardInterrupt if not interactive else SystemExit

    def thread(target, args, daemon):
        threads.append((target, args))
        return types.SimpleNamespace(start=lambda: None)

    monkeypatch.setattr(opening, "find_spec", found())
    monkeypatch.setattr(opening, "_is_interactive", lambda: interactive)
    monkeypatch.setattr(opening.webbrowser, "open", addresses.append)
    monkeypatch.setattr(opening.threading, "Thread", thread)
    monkeypatch.setattr(serving.Server, "run", run)
    BITS.show(viewer=True)
    for target, args in threads:
        with pytest.raises(SystemExit):
            target(*args)
    assert len(addresses) == 1
    assert addresses[0].startswith("http://127.0.0.1:")
    assert addresses[0] in capsys.readouterr().out
    assert len(threads) == interactive
