"""Make the screenshots that the guide shows: of the viewer's page, or of the plugin in napari.

    python tools/viewer_figures.py page docs/guide
    xvfb-run -s "-screen 0 1400x900x24" python tools/viewer_figures.py napari docs/guide

`page` requires the extras `view` and `browser`, and a Chromium on the path; `napari` requires the
extra `napari` and PyQt6. The capture is simulated from a photograph that jotlight contains.
"""

import argparse
import contextlib
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import jotlight as jl
from chromium import chromium

FRAMES, STEP = 4096, 16
SIDE = 512
WIDE = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}
PHONE_SCALE = 1.25
QUALITY = 88
"""Quality of JPEG files."""
BETWEEN_PHONES = 24
"""Distance of two phones in pixels."""


def simulate(path: Path) -> None:
    """Write a capture of a photograph that moves and changes its brightness."""
    photo, rng = jl.datasets.photograph("camera"), np.random.default_rng(0)
    jots = rng.choice(SIDE**2, 106, replace=False)
    mask = np.zeros(SIDE**2, bool)
    mask[jots[:62]] = True
    dark_counts = np.full(SIDE**2, 1e-3)
    dark_counts[jots[62:]] = 1.0  # hot
    arguments = {"gain": 0.9 * STEP, "dark_counts": dark_counts.reshape(SIDE, SIDE)}
    sensor = jl.Sensor(frames=STEP, mask=mask.reshape(SIDE, SIDE), **arguments)
    parts = []
    for start in range(0, FRAMES, STEP):
        phase = start / FRAMES
        scene = np.roll(photo, int(200 * phase), 1) * (0.6 - 0.4 * np.cos(6 * np.pi * phase))
        parts.append(sensor.expose(scene.astype(np.float32), rng=rng).packed)
    # The viewer has to find the hot jots.
    known = sensor.replace(frames=FRAMES, gain=0.9 * FRAMES, dark_counts=1e-3, exposure_time=1e-5)
    jl.save(jl.Bits(np.concatenate(parts), SIDE, known), path)


@contextlib.contextmanager
def viewer(path: Path) -> Iterator[str]:
    """Run `jotlight view`, and yield its address."""
    command = [sys.executable, "-m", "jotlight", "view", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield re.search(r"http\S+", process.stdout.readline())[0]
        finally:
            process.terminate()


def shoot(browser: Any, address: str, path: Path, **options: Any) -> None:
    """Write a screenshot of the page, on a computer with the values under the pointer."""
    page = browser.new_page(**options)
    page.goto(address)
    page.locator("#rate", has_text="network, medium").wait_for()
    page.locator("#timeline-caption", has_text="at each point").wait_for()
    for kind in re.findall("jots|uncertainty", address):
        page.locator(f"#{kind}-note:not(:empty)").wait_for()
    if not options.get("is_mobile"):
        page.mouse.move(480, 330)
        page.locator("#readout:not(:empty)").wait_for()
    page.screenshot(path=path, **({"quality": QUALITY} if path.suffix == ".jpg" else {}))
    page.close()


def join(paths: list[Path], path: Path) -> None:
    """Write two screenshots side by side."""
    images = [Image.open(each).convert("RGB") for each in paths]
    width, height = images[0].size
    joined = Image.new("RGB", (2 * width + BETWEEN_PHONES, height), (128, 128, 128))
    for index, image in enumerate(images):
        joined.paste(image, (index * (width + BETWEEN_PHONES), 0))
    joined.save(path, quality=QUALITY)


def make_page(capture: Path, folder: Path) -> None:
    """Make the figures of the page."""
    phone = {"viewport": PHONE, "device_scale_factor": PHONE_SCALE, "is_mobile": True}
    with chromium() as browser, viewer(capture) as address:
        address += "#method=network-medium"
        still = f"{address}&start=1504&window=64"
        flags = f"{address}&start=912&window=128&overlays=jots,uncertainty"
        shoot(browser, still, folder / "viewer-light.jpg", viewport=WIDE, color_scheme="light")
        shoot(browser, flags, folder / "viewer-dark.jpg", viewport=WIDE, color_scheme="dark")
        phones = [capture.with_name(f"{scheme}.png") for scheme in ("light", "dark")]
        for path in phones:
            shoot(browser, still, path, color_scheme=path.stem, **phone)
        join(phones, folder / "viewer-phone.jpg")


def make_napari(capture: Path, folder: Path) -> None:
    """Make the figure of the plugin."""
    import napari
    from qtpy.QtWidgets import QApplication

    def wait(condition: Callable[[], Any]) -> None:
        while not condition():
            QApplication.processEvents()
            time.sleep(0.02)

    window = napari.Viewer()
    window.window.resize(WIDE["width"], WIDE["height"])
    window.open(capture, plugin="jotlight")
    _, widget = window.window.add_plugin_dock_widget("jotlight", "Reconstruct and measure")
    widget.method.value = "network-medium"
    widget.reconstruct.native.click()
    wait(lambda: len(window.layers) == 2)
    window.dims.set_current_step(0, 14)
    layer = window.layers[-1]
    wait(lambda: layer.loaded)
    layer.gamma = 0.5
    layer.reset_contrast_limits()
    widget.measure.native.click()
    window.reset_view()
    end = time.monotonic() + 2.0
    wait(lambda: time.monotonic() > end)  # for the texts of the status bar
    image = window.window.screenshot(flash=False, canvas_only=False)
    Image.fromarray(image[..., :3]).save(folder / "viewer-napari.jpg", quality=QUALITY)
    window.close()


def main() -> None:
    """Make the figures of a subject."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("subject", choices=["page", "napari"])
    parser.add_argument("folder", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        capture = Path(name, "night.npy")
        simulate(capture)
        make = make_page if options.subject == "page" else make_napari
        make(capture, options.folder)


if __name__ == "__main__":
    main()
