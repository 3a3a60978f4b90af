"""Speed and memory of runs on a local cluster, compared with bare counting in memory.

    python benchmarks/scale/measure.py speed --folder FOLDER     speed, warm and cold
    python benchmarks/scale/measure.py small --folder FOLDER     "small": two workers and one thread
    python benchmarks/scale/measure.py memory --folder FOLDER    memory for 1, 4, and 16 GiB
    python benchmarks/scale/measure.py stages --folder FOLDER    seconds per GiB of each stage
    python benchmarks/scale/measure.py finish --folder FOLDER    completion of 512 images

The folder needs up to 21 GiB of free space. Each round measures everything in turns, so that other
programs affect all of it alike. The script prints one line of JSON for each round, and then the
median of each ratio.
"""

import argparse
import contextlib
import functools
import json
import os
import random
import shutil
import statistics
import time
from pathlib import Path

import numpy as np
from distributed import wait
from timing import (
    FRAME,
    FRAME_BYTES,
    GIB,
    cpu_time,
    drop_from_cache,
    in_processes,
    make_capture,
    on_workers,
    peak_memory,
    timed,
    wait_twice,
    warm_memory,
)

import jotlight as jl
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.reading import open_capture
from jotlight.runs.chunk_counting import add_counts
from jotlight.runs.cluster import connected
from jotlight.runs.estimator import choose_estimator
from jotlight.runs.jobs import CaptureSource, VideoJob
from jotlight.runs.running import Cluster, ThisProcess, run_jobs
from jotlight.runs.spans import Spans
from jotlight.runs.store import VideoStore
from jotlight.runs.streaming import Checksum, WindowCounter

WORKERS = 2


def share_counted(path, number, window, frames, ready, times):
    """Count the frames of a capture that is in memory, as one of the processes of the comparison.

    The capture is mapped, as by the workers. Without `path`, random frames are in an array of 512
    MiB, which is counted again and again. Each window is one call of the engine, which is the
    fastest form. The images are kept, as by the workers.
    """
    if path:
        data = open_capture(path, counts=False).packed.map(number * frames, (number + 1) * frames)
    else:
        data = np.random.default_rng(0).integers(0, 256, (16384, *FRAME), np.uint8)
    add_counts(data[:window], 512, 1, np.zeros((512, 512), np.int32), 1)
    wait_twice(ready)
    start, cpu = time.perf_counter(), time.process_time()
    images = np.empty((frames // window, 512, 512), np.int32)
    for index, image in enumerate(images):
        image[...] = 0
        first = index * window % len(data)
        add_counts(data[first : first + window], 512, 1, image, 1)
    times.put((time.perf_counter() - start, time.process_time() - cpu))


def share_read(path, number, ready, times):
    """Read a half of a file in blocks of 8 MiB, as one of the processes of the comparison."""
    size = path.stat().st_size // WORKERS
    buffer = memoryview(bytearray(1 << 23))
    wait_twice(ready)
    start, cpu, left = time.perf_counter(), time.process_time(), size
    with path.open("rb", buffering=0) as file:
        file.seek(number * size)
        while left > 0 and (read := file.readinto(buffer)):
            left -= read
    times.put((time.perf_counter() - start, time.process_time() - cpu))


def video_job(path, folder, window, method):
    """Return the job of `jotlight reconstruct --window`, with its checksum and its results."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    frames = jl.open(path, counts=False).shape[0]
    number = frames // window
    estimator = None if method is None else choose_estimator(jl.Sensor(frames=window), method)
    dtype = "int32" if method is None else "float32"
    group = max(1, max(1 << 27, frames * FRAME_BYTES // 1024) // (window * FRAME_BYTES))
    store = VideoStore(folder / "v.zarr", {"values": dtype}, (number, 512, 512), dtype, group)
    source = CaptureSource(str(path), ReadingOptions(counts=False))
    return VideoJob("v", source, Spans(window, window, number), 1, estimator, store)


def run_video(client, path, folder, window, method, prepare=lambda: None):
    """Return the seconds of a run that writes a video."""
    job = video_job(path, folder, window, method)
    times = on_workers(client, lambda: check(run_jobs([job], Cluster(client))), prepare)
    shutil.rmtree(folder, ignore_errors=True)
    return times


def check(outcome):
    assert outcome.made == ["v"], outcome


def lazy_images(path, window, method):
    """Return the counts of a capture as a lazy array, or their estimates."""
    bits = jl.open(path, counts=False)
    if method is None:
        return jl.dask.count(bits, window)
    return jl.dask.reconstruct(bits, jl.Sensor(frames=window), window, method=method)


def run_lazy(client, path, window, method, prepare=lambda: None):
    """Return the seconds until the workers hold all images of a lazy array."""
    images = lazy_images(path, window, method)
    return on_workers(client, lambda: wait(images.persist()), prepare)


def warm_up(client, path, folder):
    """Import everything that the workers need."""
    run_video(client, path, folder, 4096, "mle")
    run_lazy(client, path, 4096, None)


def speed_measurements(client, path, folder, frames, window):
    """Return functions that measure counting and "mle", in the page cache and outside, by name."""
    drop = functools.partial(drop_from_cache, path)
    lazy = functools.partial(run_lazy, client, path, window)
    run = functools.partial(run_video, client, path, folder, window)
    readers = [(path, number) for number in range(WORKERS)]

    def bare(source):
        shares = [(source, number, window, frames // WORKERS) for number in range(WORKERS)]
        return in_processes(share_counted, shares, warm_memory)

    return {
        "bare": lambda: bare(path),
        "bare, array": lambda: bare(None),
        "count": lambda: lazy(None, warm_memory),
        "mle": lambda: lazy("mle", warm_memory),
        "run counts": lambda: run(None, warm_memory),
        "run mle": lambda: run("mle", warm_memory),
        # Each of these begins right after the file was dropped, because the system returns free
        # memory within seconds, and needs time to get it again.
        "disk": lambda: in_processes(share_read, readers, drop),
        "cold count": lambda: lazy(None, drop),
        "cold mle": lambda: lazy("mle", drop),
        "cold run mle": lambda: run("mle", drop),
    }


def measure_speed(options):
    """Measure counting and "mle", with the file in the page cache and without.

    Each round has another order, because memory and disks depend on what came before.
    """
    path, folder = options.folder / "capture.npy", options.folder / "out"
    frames = options.gib * GIB // FRAME_BYTES
    make_capture(path, frames)
    rounds = []
    with connected(None, WORKERS) as client:
        warm_up(client, path, folder)
        for number in range(options.rounds):
            for window in options.windows:
                measurements = speed_measurements(client, path, folder, frames, window)
                names = [name for name in measurements if name in (options.only or measurements)]
                order = random.Random(number).sample(names, len(names))
                row = {name: measurements[name]() for name in order}
                rounds.append(
                    {"round": number, "window": window, "load": os.getloadavg()[0], **row}
                )
                print(json.dumps(rounds[-1]), flush=True)
    for window in options.windows:
        rows = [row for row in rounds if row["window"] == window]
        print(f"window {window}: medians of {len(rows)} rounds; ratios of time and of CPU time")
        for name in names:
            base = "disk" if name.startswith(("cold", "disk")) else "bare"
            speed = statistics.median(options.gib / row[name][0] for row in rows)
            ratio, cpu = (
                statistics.median(row[base][i] / row[name][i] for row in rows) for i in (0, 1)
            )
            print(f"    {name:19} {speed:6.2f} GiB/s   {ratio:.0%} and {cpu:.0%} of {base}")
    path.unlink()


def measure_small(options):
    """Measure "small" on two workers, and the same work in one thread."""
    path, folder, window = options.folder / "capture.npy", options.folder / "out", 64
    frames, method = options.gib * GIB // FRAME_BYTES, "network-small"
    make_capture(path, frames)
    ratios = {"lazy": [], "run": []}
    with connected(None, WORKERS) as client:
        warm_up(client, path, folder)
        for _ in range(options.rounds):
            job, images = video_job(path, folder, window, method), lazy_images(path, window, method)
            row = {}
            for title, alone, both in (
                (
                    "lazy",
                    lambda images=images: images.persist(scheduler="synchronous"),
                    lambda: run_lazy(client, path, window, method),
                ),
                (
                    "run",
                    lambda job=job: check(run_jobs([job], ThisProcess(True, 1))),
                    lambda: run_video(client, path, folder, window, method),
                ),
            ):
                cpu, seconds = time.process_time(), timed(alone)
                one, two = (seconds, time.process_time() - cpu), both()
                row[title] = [frames // window / each for each in (*one, *two)]
                ratios[title].append((one[0] / two[0] / WORKERS, one[1] / two[1]))
            print(json.dumps({**row, "load": os.getloadavg()[0]}), flush=True)
    print("images per second and per CPU second: one thread, two workers")
    for title, found in ratios.items():
        wall, cpu = (statistics.median(each[i] for each in found) for i in (0, 1))
        print(f"{title}: {wall:.0%} of {WORKERS} times one thread; {cpu:.0%} by CPU time")
    path.unlink()


def measure_memory(options):
    """Measure the memory of workers for captures of different lengths."""
    for gib in (1, 4, 16):
        path = options.folder / "capture.npy"
        make_capture(path, gib * GIB // FRAME_BYTES, sparse=True)
        for title in ("run", "lazy"):
            with connected(None, WORKERS) as client:
                before = max(each["VmHWM"] for each in client.run(peak_memory).values())
                if title == "run":
                    run_video(client, path, options.folder / "out", 1024, "mle")
                else:
                    lazy_images(path, 1024, "mle").max(axis=(1, 2)).compute()
                found = client.run(peak_memory).values()
            peak = max(each["VmHWM"] for each in found)
            anonymous = max(each["RssAnon"] for each in found)
            print(
                f"{gib:2} GiB, {title}: peak {peak} MiB per worker ({before} MiB before the work), "
                f"{anonymous} MiB not in files at the end",
                flush=True,
            )
        path.unlink()


def measure_stages(options):
    """Measure the CPU seconds per GiB of packed bits that one thread needs for each stage."""
    path = options.folder / "capture.npy"
    frames = GIB // FRAME_BYTES
    make_capture(path, frames)
    capture = open_capture(path, counts=False)
    stages = {}

    def best(name, function, scale=1.0):
        stages[name] = min(scale * cpu_time(function) for _ in range(options.rounds))
        print(f"{name:50} {stages[name]:9.3f} CPU s per GiB", flush=True)

    def read():
        for first in range(0, frames, 256):
            capture.packed.read(first, first + 256)

    best("read from the page cache", read)
    data = capture.packed.map(0, frames)

    def crc():
        checksum = Checksum()
        for first in range(0, frames, 256):
            checksum.update(data[first : first + 256])

    best("checksum", crc)
    for window in options.windows:
        spans = Spans(window, window, frames // window)

        def count(spans=spans):
            for _ in WindowCounter(capture, spans, 1, 1, mapped=True).windows(0, spans.number):
                pass

        best(f"map, count, and checksum, window {window}", count)
        counts = [capture[i * window : (i + 1) * window].counts(1)[None] for i in range(4)]
        scale = spans.number / len(counts)
        for method in ("mle", "network-small", "network-medium"):
            if method == "network-small" and window not in (9, 16, 25, 36, 49, 64, 81, 100):
                continue
            estimator = choose_estimator(jl.Sensor(frames=window), method)
            estimator(counts[0])
            best(
                f"estimate by {method}, window {window}",
                lambda estimator=estimator, counts=counts: [estimator(each) for each in counts],
                scale,
            )
        job = video_job(path, options.folder / "out", window, "mle")
        job.store.create()
        images = [np.ones((512, 512), np.float32)] * 16

        def write(images=images, store=job.store):
            for index, image in enumerate(images):
                store.write_image(index % store.shape[0], image)

        best(f"write images, window {window}", write, spans.number / len(images))
    shutil.rmtree(options.folder / "out", ignore_errors=True)
    path.unlink()


def measure_finish(options):
    """Measure the completion of a video: its images are compared, and flushed to the disk."""
    folder, number = options.folder / "out", 512
    image = np.random.default_rng(0).random((512, 512), np.float32)
    for _ in range(options.rounds):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        shape = number, *image.shape
        store = VideoStore(folder / "v.zarr", {"values": "float32"}, shape, "float32", 64)
        store.create()
        for index in range(number):
            store.write_image(index, image)
        for group in range(store.groups):
            store.mark(group, {"crc32": "0", "bytes": 0, "minimum": 0.0, "maximum": 1.0})
        cpu = time.process_time()
        seconds = timed(store.finish)
        print(f"{seconds:.2f} s, {time.process_time() - cpu:.2f} CPU s", flush=True)
    shutil.rmtree(folder)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("speed", "small", "memory", "stages", "finish"))
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--gib", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", nargs="+", help="names of what is measured for `speed`")
    parser.add_argument("--windows", type=int, nargs="+", default=[1024])
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(KeyboardInterrupt):
        globals()[f"measure_{options.what}"](options)


if __name__ == "__main__":
    main()
