"""Overlays of a live capture are those of the image that is shown."""

import time

import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")

from jotlight.view.live.options import LiveOptions, open_live
from streams import ask, connected, read, read_until
from view_servers import serving


@pytest.mark.slow
@pytest.mark.parametrize("method", ["mle", "network-small"])
def test_overlays_follow_the_newest_frames(tmp_path, method):
    path = tmp_path / "a.bin"
    frames = np.random.default_rng(0).integers(0, 256, (64, 8, 1), np.uint8)
    path.write_bytes(frames.tobytes())
    live = open_live(path, LiveOptions(layout="8x8"), {"frames": 1})
    try:
        with serving(live) as server, connected(server) as stream:
            read(stream)
            ask(stream, method=method, overlays=["saturated"], follow=True)
            before = read_until(stream, "overlay")[1]
            assert not before.any()
            frames[:, 3, 0] = 255
            with path.open("ab") as file:
                file.write(frames.tobytes())
            shown = before
            end = time.monotonic() + 60
            while not shown.any() and time.monotonic() < end:
                header, content = read(stream)
                shown = content if header["type"] == "overlay" else shown
            assert np.argwhere(shown.reshape(8, 8))[:, 0].tolist() == [3] * 8
    finally:
        live.close()
