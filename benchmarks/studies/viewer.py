"""Measure the viewer in Chromium: the first image, dragging, single steps, live frames, and memory.

    python benchmarks/studies/viewer.py page --frames 65536
    python benchmarks/studies/viewer.py live --seconds 10
    python benchmarks/studies/viewer.py hour --frames 36000000

Requires the extras `view` and `browser`, and a Chromium on the path. `page` simulates a capture of
512 x 512 bits, 2 GiB for 65,536 frames, in the folder of the option `--folder`, and deletes it.
"""

import argparse
import asyncio
import contextlib
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import jotlight as jl

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from chromium import launch_options

RECORD = """
window.log = [];
const now = () => performance.timeOrigin + performance.now();
document.addEventListener("painted", (event) => log.push([now(), event.detail]));
document.addEventListener("input", () => log.push([now(), null]), true);
"""
HEIGHT, WIDTH, RATE = 256, 512, 10_000


@contextlib.contextmanager
def viewer(*arguments: str, **options) -> Iterator[tuple[str, subprocess.Popen]]:
    """Run `jotlight view`, and yield its address and its process."""
    command = [sys.executable, "-m", "jotlight", "view", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, **options)
    try:
        # The first line may say that the viewer waits for the first frame.
        addresses = (re.search(r"http\S+", line) for line in process.stdout)
        yield next(filter(None, addresses))[0], process
    finally:
        process.terminate()
        process.wait(20)


def memory(process: subprocess.Popen) -> str:
    """Return the present and the largest memory of a process."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    now, largest = (
        int(re.search(rf"{name}:\s+(\d+)", status)[1]) >> 10 for name in ("VmRSS", "VmHWM")
    )
    return f"memory of the server {now} MiB, at most {largest} MiB"


@contextlib.asynccontextmanager
async def empty_page():
    """Start Chromium, and yield an empty page."""
    from playwright.async_api import async_playwright

    options = launch_options()
    async with async_playwright() as driver:
        browser = await driver.chromium.launch(**options)
        page = await browser.new_page(viewport={"width": 1280, "height": 800})
        await page.add_init_script(RECORD)
        yield page
        await browser.close()


def simulate(path: Path, frames: int) -> None:
    """Write a capture of a photograph that moves and changes its brightness."""
    photo, step = jl.datasets.photograph("camera"), 256
    sensor = jl.Sensor(frames=step, gain=0.6 * step, dark_counts=0.001)
    out = np.lib.format.open_memmap(path, "w+", np.uint8, (frames, 512, 64))
    for start in range(0, frames, step):
        phase = start / frames
        scene = np.roll(photo, int(200 * phase), 1) * (0.65 + 0.35 * np.cos(10 * np.pi * phase))
        out[start : start + step] = sensor.expose(scene.astype(np.float32), rng=start).packed
    out.flush()


def percentiles(name: str, values: list[float]) -> None:
    ordered = sorted(values)
    high = ordered[int(0.95 * (len(ordered) - 1))]
    print(f"{name}: median {statistics.median(ordered):.0f} ms, 95th percentile {high:.0f} ms")


async def drag(page, seconds: float) -> None:
    """Drag the time slider, and print the number of images per second."""
    box = await page.locator("#start").bounding_box()
    y, session = box["y"] + box["height"] / 2, await page.context.new_cdp_session(page)
    await page.mouse.move(box["x"] + 5, y)
    await page.mouse.down()
    await page.evaluate("log.length = 0")
    start, pending = time.perf_counter(), set()
    while (passed := time.perf_counter() - start) < seconds:
        event = {"type": "mouseMoved", "x": box["x"] + 5 + passed / 4 % 1 * (box["width"] - 10)}
        event |= {"y": y, "button": "left", "buttons": 1}
        if len(pending) < 8:
            task = asyncio.ensure_future(session.send("Input.dispatchMouseEvent", event))
            pending.add(task)
            task.add_done_callback(pending.discard)
        await asyncio.sleep(0.01)
    log = await page.evaluate("log")
    await page.mouse.up()
    duration = (log[-1][0] - log[0][0]) / 1000
    painted = [header for _, header in log if header is not None]
    print(
        f"dragging: {len(painted) / duration:.1f} images per second from "
        f"{(len(log) - len(painted)) / duration:.1f} movements per second"
    )


async def step(page, number: int) -> None:
    """Move the slider by single steps, and print when each stage is painted."""
    times = defaultdict(list)
    await page.locator("#start").focus()
    await page.keyboard.press("Home")
    for index in range(number):
        await asyncio.sleep(0.3)
        await page.evaluate("log.length = 0")
        await page.keyboard.press("PageUp" if index % 16 < 8 else "PageDown")
        await asyncio.sleep(0.5)
        log = await page.evaluate("log")
        begin = next(when for when, header in log if header is None)
        first = {}
        for when, header in log:
            if header is not None:
                first.setdefault(header["stage"], when - begin)
                first.setdefault("any image", when - begin)
        for stage, delay in first.items():
            times[stage].append(delay)
    for stage, delays in times.items():
        percentiles(f"single steps, {stage}, {len(delays)} of {number}", delays)


async def measure_page(frames: int, folder: Path) -> None:
    path = folder / "capture.npy"
    simulate(path, frames)
    for method in ("mle", "network-small", "network-medium"):
        async with empty_page() as page:
            with viewer(str(path)) as (address, process):
                start = time.perf_counter()
                await page.goto(f"{address}#method={method}&window=64")
                await page.locator("#rate:not(:empty)").wait_for()
                first = time.perf_counter() - start
                print(f"{method}: first image {first:.2f} s after the address")
                await asyncio.sleep(2)
                await drag(page, 8.0)
                await step(page, 30)
                print(memory(process))


def write_frames(file, seconds: float, times: dict[int, float]) -> None:
    """Write 10,000 frames per second, and record when each batch was written."""
    frames = np.random.default_rng(0).integers(0, 256, (512, HEIGHT * WIDTH // 8), np.uint8)
    start, number = time.perf_counter(), 0
    while (passed := time.perf_counter() - start) < seconds:
        due = int(passed * RATE)
        while number < due:
            size = min(due - number, 50, 512 - number % 512)
            file.write(frames[number % 512 : number % 512 + size].data)
            number += size
            times[number] = 1000 * time.time()
        file.flush()
        time.sleep(0.002)
    file.close()


async def measure_live(seconds: float, folder: Path) -> None:
    path, times = folder / "growing.bin", {}
    with path.open("wb") as file:
        writer = threading.Thread(target=write_frames, args=(file, seconds + 4, times))
        writer.start()
        with viewer(str(path), "--follow", "--format", "swissspad2") as (address, process):
            async with empty_page() as page:
                await page.goto(f"{address}#method=mle&window=64&white=1")
                await asyncio.sleep(2)
                await page.evaluate("log.length = 0")
                await asyncio.sleep(seconds - 2)
                log = await page.evaluate("log")
                badge = await page.locator("#badge").inner_text()
            print(memory(process))
        writer.join()
    written = sorted(times.items())
    delays = []
    for painted, header in log:
        end = header["start"] + header["window"]
        delays.append(painted - next(when for number, when in written if number >= end))
    percentiles("live, from the writing of the newest frame to its painting", delays)
    print(
        f"live: at most {max(delays):.0f} ms, {len(delays) / (seconds - 2):.1f} images per second"
    )
    print(f"live: {badge}; {written[-1][0] / (seconds + 4):.0f} frames per second were written")


def measure_hour(frames: int) -> None:
    """Send as many frames as an hour has through standard input, as fast as it accepts them."""
    from websockets.sync.client import connect

    read, write = os.pipe()
    block = np.random.default_rng(0).integers(0, 256, (64, HEIGHT * WIDTH // 8), np.uint8).tobytes()
    arguments = ("-", "--follow", "--layout", f"{HEIGHT}x{WIDTH}")

    def send() -> None:
        with os.fdopen(write, "wb", buffering=0) as pipe:
            for _ in range(frames // 64):
                pipe.write(block)

    threading.Thread(target=send, daemon=True).start()
    with viewer(*arguments, stdin=read) as (address, process):
        os.close(read)
        host, token = re.match(r"http://([^/]+)/\?token=(\S+)", address).groups()
        url, start, images, shown = f"ws://{host}/stream?token={token}", time.time(), 0, 0.0
        state = {"window": 64, "method": "mle", "white": 1.0, "follow": True}
        with connect(url, origin=f"http://{host}", max_size=None) as stream:
            stream.send(json.dumps({"type": "view", "id": 1, "state": state}))
            for message in stream:
                header = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
                if header["type"] == "image":
                    stream.send('{"type": "ack"}')
                    images += 1
                if header["type"] != "live":
                    continue
                if header["ended"] or time.time() > shown + 30:
                    shown = time.time()
                    hours = header["end"] / RATE / 3600
                    print(
                        f"{hours:.2f} h of frames after {shown - start:.0f} s: {images} images, "
                        f"{header['dropped']} dropped, {memory(process)}",
                        flush=True,
                    )
                if header["ended"]:
                    break


def main() -> None:
    """Run one of the measurements."""
    parser = argparse.ArgumentParser(description="Measure the viewer.")
    parser.add_argument("subject", choices=["page", "live", "hour"])
    parser.add_argument("--frames", type=int, default=65_536)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--folder", type=Path, default=None)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        if options.subject == "page":
            asyncio.run(measure_page(options.frames, Path(folder)))
        elif options.subject == "live":
            asyncio.run(measure_live(options.seconds, Path(folder)))
        else:
            measure_hour(options.frames)


if __name__ == "__main__":
    main()
