"""Tables for planning, from the output of `measure.py stages`.

    python benchmarks/scale/measure.py stages --folder FOLDER > stages.txt
    python benchmarks/scale/plan.py stages.txt

It prints the hours for 7 TB on 1, 8, and 64 workers, the speeds of reading and writing at which
these workers are limited by disks and networks, and the workers that keep up with a camera.
"""

import argparse
import re
from pathlib import Path

GIB = 1 << 30
COLLECTION = 7e12 / GIB
"""Size of the collection in GiB."""

CAMERA = 1e6 / 8 * 1e5 / GIB
"""Bits of a camera of 1 Mpixel at 100,000 frames per second, in GiB per second."""

FRAMES_PER_GIB = GIB // (512 * 64)
WORKERS = 1, 8, 64


def read_stages(path):
    """Return the CPU seconds per GiB of each stage."""
    lines = re.findall(r"^(.+?)\s+([\d.]+) CPU s per GiB$", path.read_text(), re.M)
    return {name: float(seconds) for name, seconds in lines}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("stages", type=Path)
    stages = read_stages(parser.parse_args().stages)
    print("| stage | CPU seconds per GiB |\n| --- | --- |")
    for name, seconds in stages.items():
        print(f"| {name} | {seconds:.3g} |")
    windows = sorted({int(each) for each in re.findall(r"window (\d+)", " ".join(stages))})
    rows = []
    for window in windows:
        base = stages[f"map, count, and checksum, window {window}"]
        base += stages[f"write images, window {window}"]
        rows.append((f"counts of {window} frames", base, window))
        for method in ("mle", "network-small", "network-medium"):
            own = stages.get(f"estimate by {method}, window {window}")
            rows += [] if own is None else [(f"{method}, {window} frames", base + own, window)]
    print("\n| video | s per GiB | " + " | ".join(f"hours, {n} workers" for n in WORKERS), end="")
    print(" | reads and writes of 64 workers | workers for the camera |")
    print("| --- " * (len(WORKERS) + 4) + "|")
    for name, seconds, window in rows:
        hours = " | ".join(f"{COLLECTION * seconds / count / 3600:.2g}" for count in WORKERS)
        reads = WORKERS[-1] / seconds
        writes = reads * FRAMES_PER_GIB / window * 2**20 / GIB
        print(
            f"| {name} | {seconds:.3g} | {hours} | {reads:.3g} and {writes:.3g} GiB/s "
            f"| {CAMERA * seconds:.2g} |"
        )


if __name__ == "__main__":
    main()
