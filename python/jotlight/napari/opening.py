"""`bits.show(viewer=True)`: bits in napari, or on the page of the viewer."""

import sys
import threading
import webbrowser
from importlib.util import find_spec

from jotlight.napari.lazy import make_layer
from jotlight.sensing.bits import Bits
from jotlight.view.extra import require_server
from jotlight.view.viewed import Viewed


def open_viewer(bits: Bits) -> None:
    """Open bits in napari if it is installed, and else on the page of the viewer.

    A program waits until napari is closed, or until Ctrl-C ends the page. An interactive session
    goes on.

    Raises
    ------
    MissingExtraError
        When neither napari nor the packages of the page are installed.
    """
    viewed = Viewed.from_bits(bits)
    if find_spec("napari") is not None and find_spec("qtpy") is not None:
        _open_napari(viewed)
    else:
        _open_page(viewed)


def _open_napari(viewed: Viewed) -> None:
    import napari

    data, arguments, _ = make_layer(viewed)
    viewer = napari.Viewer(title=f"{viewed.title} - jotlight")
    viewer.add_image(data, **arguments)
    viewer.window.add_plugin_dock_widget("jotlight")
    if not _is_interactive():
        napari.run()


def _open_page(viewed: Viewed) -> None:
    require_server()
    from jotlight.view.serving import Server

    server = Server(viewed)

    def started() -> None:
        print(f"{viewed.title}: {server.address}")
        webbrowser.open(server.address)

    if _is_interactive():
        # The page lives as long as the session.
        threading.Thread(target=server.run, args=(started,), daemon=True).start()
        return
    try:
        server.run(started)
    except KeyboardInterrupt:
        print("ended")


def _is_interactive() -> bool:
    """Return whether Python waits for more input after this call."""
    return hasattr(sys, "ps1") or bool(sys.flags.interactive) or "ipykernel" in sys.modules
