"""`bits.show(viewer=True)`: frames in napari, or on the page of the viewer."""

import importlib
import os
import subprocess
import sys
import threading
from importlib.util import find_spec

from jotlight.napari.lazy import make_layer
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.view.extra import require_server
from jotlight.view.viewed import Viewed

_WIDGET_TITLE = "Reconstruct and measure"
"""Name of the dock widget in the manifest."""

_WITHOUT_DISPLAY = {"eglfs", "linuxfb", "minimal", "offscreen", "vnc"}
"""Values of QT_QPA_PLATFORM with which Qt needs no X11 and no Wayland."""

_NO_BINDING = {"QtBindingsNotFoundError", "ModuleNotFoundError"}
"""Errors of the import of qtpy without a Qt binding, and without qtpy itself."""

_START_QT = "from qtpy.QtWidgets import QApplication; QApplication([])"
"""A program that ends with the status 0 if Qt can open windows."""

_SECONDS = 60
"""Maximum time in seconds until this program has ended."""


def open_viewer(data: Bits | Readings) -> None:
    """Open frames in napari if it can show windows, and else on the page of the viewer.

    A program waits until napari is closed, or until Ctrl-C ends the page. An interactive session,
    such as a notebook, goes on. Lines state the address of the page and how it ends, and if napari
    is installed but cannot show windows, the reason.

    Raises
    ------
    MissingExtraError
        When neither napari nor the packages of the page are installed.
    """
    viewed = Viewed.from_data(data)
    if find_spec("napari") is None:
        _open_page(viewed)
        return
    reason = napari_obstacle()
    if reason is None:
        _open_napari(viewed)
        return
    print(
        f"napari is installed but cannot open a window: {reason}. The page opens instead.",
        flush=True,
    )
    _open_page(viewed)


def napari_obstacle() -> str | None:
    """Return why napari cannot open a window, or None if it can.

    Qt ends the whole process if it finds no display or lacks a library of the system. So on Linux,
    another process tries first.
    """
    try:
        importlib.import_module("qtpy.QtWidgets")
    except (ImportError, RuntimeError, ValueError) as error:  # qtpy raises any of them
        if type(error).__name__ in _NO_BINDING:
            return "it needs a Qt binding, such as PyQt6 (pip install PyQt6)"
        return f"Qt cannot be imported ({_first_line(str(error))})"
    if sys.platform != "linux" or _has_application():
        return None
    platform = os.environ.get("QT_QPA_PLATFORM", "").partition(":")[0]
    if platform in _WITHOUT_DISPLAY:
        return None
    if not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
        return "there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set)"
    return _try_qt()


def _has_application() -> bool:
    """Return whether Qt has already connected to a display."""
    return importlib.import_module("qtpy.QtWidgets").QApplication.instance() is not None


def _try_qt() -> str | None:
    """Return why Qt fails to start in another process, or None if it starts."""
    if not sys.executable:
        return None
    try:
        ended = subprocess.run(  # noqa: S603 - our own program
            [sys.executable, "-P", "-c", _START_QT],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_SECONDS,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"Qt does not start ({_first_line(str(error))})"
    if ended.returncode == 0:
        return None
    return f"Qt does not start ({_first_line(ended.stderr) or f'status {ended.returncode}'})"


def _first_line(text: str) -> str:
    r"""Return the first line of a text that is not empty.

    Examples
    --------
    >>> _first_line("  No Qt bindings could be found. \n and more"), _first_line("")
    ('No Qt bindings could be found', '')
    """
    return next((line.strip(" .") for line in text.splitlines() if line.strip(" .")), "")


def _open_napari(viewed: Viewed) -> None:
    import napari

    data, arguments, _ = make_layer(viewed)
    viewer = napari.Viewer(title=f"{viewed.title} - jotlight")
    viewer.add_image(data, **arguments)
    viewer.window.add_plugin_dock_widget("jotlight", _WIDGET_TITLE)
    if not _is_interactive():
        napari.run()


def _open_page(viewed: Viewed) -> None:
    require_server()
    from jotlight.view.serving import Server

    server = Server(viewed)
    is_session = _is_interactive()
    end = "The page works until this session ends" if is_session else "Ctrl-C ends the viewer"
    # A program whose output is a pipe must not wait behind lines that nobody sees.
    lines = [f"{viewed.title}: {server.address}", viewed.sensor_note, end]
    print(*filter(None, lines), sep="\n", flush=True)
    server.open_browser()
    if is_session:
        threading.Thread(target=server.run, daemon=True, name="jotlight-view").start()
        return
    try:
        server.run()
    except KeyboardInterrupt:
        print("ended")


def _is_interactive() -> bool:
    """Return whether Python waits for more input after this call."""
    return hasattr(sys, "ps1") or bool(sys.flags.interactive) or "ipykernel" in sys.modules
