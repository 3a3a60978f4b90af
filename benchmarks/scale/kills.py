"""Kill workers, and the command itself, at random moments, and compare the results.

    python benchmarks/scale/kills.py --folder FOLDER

An undisturbed run makes the expected bytes. Then each of two runs is killed ten times: in the first
one, `kill -9` ends a random worker; in the second one, the command and all of its workers. The
command is started again until it ends by itself. The script prints the moments and whether all
bytes are equal, and exits with 1 if they are not.
"""

import argparse
import contextlib
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from timing import make_capture


def command(folder, name):
    """Return the command line of a run with many short units."""
    base = [sys.executable, "-m", "jotlight", "reconstruct", str(folder / "capture.npy"), "--bits"]
    options = ["--window", "64", "--quality", "small", "--chunks", "4MiB", "--workers", "2"]
    return [*base, "-o", str(folder / name), *options]


def digests(path):
    """Return the SHA-256 of each file of a folder by name."""
    return {
        file.relative_to(path).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }


def descendants(pid):
    """Return the processes that a process started, directly or indirectly."""
    found = []
    for thread in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):  # the thread has ended
            found += [int(each) for each in thread.read_text().split()]
    return [*found, *(each for child in found for each in descendants(child))]


def workers_of(pid):
    """Return the worker processes of a command."""
    found = []
    for child in descendants(pid):
        with contextlib.suppress(OSError):  # the process has ended
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


def wait_for_work(process, part, seconds):
    """Wait until another unit is complete, and then some seconds."""
    before = len(list(part.glob("groups/*.json")))
    while process.poll() is None and len(list(part.glob("groups/*.json"))) == before:
        time.sleep(0.01)
    time.sleep(seconds)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--frames", type=int, default=40_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    random.seed(options.seed)
    folder = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    make_capture(folder / "capture.npy", options.frames)
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    start = time.perf_counter()
    subprocess.run(command(folder, "expected.zarr"), check=True, **quiet)
    print(f"undisturbed run: {time.perf_counter() - start:.1f} s", flush=True)
    expected = digests(folder / "expected.zarr")
    failed = False
    for victim in ("worker", "command"):
        output = folder / f"{victim}.zarr"
        part, kills, starts = output.with_name(f"{output.name}.part"), 0, 0
        while not output.exists():
            process = subprocess.Popen(
                command(folder, output.name), start_new_session=True, **quiet
            )
            starts += 1
            while process.poll() is None and kills < options.kills:
                wait_for_work(process, part, random.uniform(0, 0.5))
                done = len(list(part.glob("groups/*.json")))
                if process.poll() is not None:
                    break
                if victim == "command":
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
                elif workers := workers_of(process.pid):
                    os.kill(random.choice(workers), signal.SIGKILL)
                else:
                    continue
                kills += 1
                print(f"kill {kills} of a {victim} after {done} groups", flush=True)
            process.wait()
        same = digests(output) == expected
        print(f"{victim}: {kills} kills, {starts} starts, equal bytes: {same}", flush=True)
        failed |= not same or kills < options.kills
    shutil.rmtree(folder)
    sys.exit(failed)


if __name__ == "__main__":
    main()
