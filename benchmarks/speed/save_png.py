"""Compare the time to write a PNG of 8 bits with that of Pillow's default.

    python benchmarks/speed/save_png.py [--rounds 21]

The images are photographs of 512 x 512 pixels, gray and in color, and a constant gray image of this
size. `jl.save_image` also chooses the white level, and renames a complete file over the old one.
All cases run in turn, round by round, so all of them meet the same state of the machine. The table
shows the median and the shortest time of each case, the ratio of the medians to Pillow's, and the
size of the file.
"""

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

import jotlight as jl


def main() -> None:
    """Time all cases, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=21)
    options = parser.parse_args()
    images = {
        name: np.rint(255 * jl.datasets.photograph(photo)).astype(np.uint8)
        for name, photo in (("gray", "camera"), ("color", "astronaut"))
    }
    images["constant"] = np.full((512, 512), 128, np.uint8)
    print("| image | writer | ms | shortest ms | ratio | kB |")
    print("| --- | --- | ---: | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as folder:
        for name, image in images.items():
            path = Path(folder, f"{name}.png")
            cases = {
                "Pillow": lambda path=path, image=image: Image.fromarray(image).save(path),
                "jotlight": lambda path=path, image=image: jl.save_image(path, image),
                "jotlight, floats": lambda path=path, image=image / 255: jl.save_image(path, image),
            }
            times = {case: [] for case in cases}
            for _ in range(options.rounds):
                for case, run in cases.items():
                    start = time.perf_counter()
                    run()
                    times[case].append(time.perf_counter() - start)
            for case, run in cases.items():
                run()
                middle = statistics.median(times[case])
                ratio = middle / statistics.median(times["Pillow"])
                size = path.stat().st_size / 1e3
                shortest = min(times[case])
                print(
                    f"| {name} | {case} | {1e3 * middle:.1f} | {1e3 * shortest:.1f} | {ratio:.2f} "
                    f"| {size:.0f} |"
                )


if __name__ == "__main__":
    main()
