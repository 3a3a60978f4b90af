"""Measure memory, time, and quality of `jotlight reconstruct --motion` for very long bursts.

    python benchmarks/memory/long_bursts.py FOLDER [--frames 100000 1000000] [--threads 1] [--keep]

FOLDER holds a capture of 256 x 512 jots while it is measured: 16 GB per million frames. The camera
shakes: it passes 4,000 poses in 100,000 frames. In longer bursts, it goes back and forth along this
path, and the frames are repeated, with their noise. The reference time is in the middle of the
path. Writing 100,000 frames takes four minutes on one core, and repeating them takes less.

Memory is the peak of anonymous memory of the process (RssAnon of /proc), which excludes the file
and the libraries. PSNR is that of the image at the reference time, without a border of 8 pixels.
The error of the motion is the root mean square over all jots and 200 times, in pixels. The last
column is the time from Ctrl-C until the process ends, the longest of some attempts. Linux only.
"""

import argparse
import dataclasses
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.datasets.moving_scenes import MovingScene

SIZE = 256, 512
PHOTONS = 0.2
POSES = 4000
FRAMES_OF_PATH = 100_000
INNER = (slice(8, -8),) * 2
SAMPLES = 200
CHUNK = 4096
INTERRUPTIONS = 4
"""Number of times at which a reconstruction is interrupted."""
LAST = 0.6
"""The last of these times, as a fraction of the time of the first run.

Later runs take less time, because the file is in memory then.
"""


def main() -> None:
    """Measure each number of frames, and print a row for it."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frames", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="keep the captures, and use them again")
    options = parser.parse_args()
    # Shells let processes in the background ignore Ctrl-C, and their children, too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    print("| frames | seconds | memory in MiB | PSNR | error of the motion | Ctrl-C |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: |")
    for frames in options.frames:
        burst = LongBurst(frames)
        path = options.folder / f"burst-{frames}.npy"
        if not path.exists():
            burst.write(path)
        try:
            print(burst.measure(path, options.threads), flush=True)
        finally:
            if not options.keep:
                path.unlink()


@dataclasses.dataclass(frozen=True)
class LongBurst:
    """A long burst of a shaken camera."""

    frames: int

    @property
    def scene(self) -> MovingScene:
        """The scene, in which each time is a pose."""
        photograph = np.tile(jl.datasets.photograph("camera"), (1, 2))
        sensor = jl.Sensor(frames=POSES)
        return jl.datasets.moving(
            photograph, "shake", sensor=sensor, shape=SIZE, photons=PHOTONS, rng=0
        )

    def poses(self) -> npt.NDArray[np.intp]:
        """Return the pose of each frame."""
        phase = np.pi * (np.arange(self.frames) - self.frames // 2) / FRAMES_OF_PATH
        return np.rint((POSES - 1) / 2 + (POSES / 2 - 1) * np.sin(phase)).astype(np.intp)

    def write(self, path: Path) -> None:
        """Write the packed bits."""
        packed = np.lib.format.open_memmap(
            path, "w+", np.uint8, (self.frames, SIZE[0], SIZE[1] // 8)
        )
        if self.frames <= FRAMES_OF_PATH:
            self._draw(packed)
            return
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            once = Path(folder, "once.npy")
            LongBurst(FRAMES_OF_PATH).write(once)
            repeat(np.load(once, mmap_mode="r"), packed)

    def _draw(self, packed: npt.NDArray[np.uint8]) -> None:
        """Draw the bits pose by pose, so that the scene is rendered only once for each."""
        scene, poses = self.scene, self.poses()
        rng = np.random.default_rng(1)
        for pose in np.unique(poses):
            frames = np.flatnonzero(poses == pose)
            gain = scene.sensor.gain / POSES * len(frames)
            sensor = scene.sensor.replace(frames=len(frames), gain=gain)
            packed[frames] = np.asarray(sensor.expose(scene.image(pose), rng=rng).packed)

    def measure(self, path: Path, threads: int) -> str:
        """Return the row of the table."""
        scene, poses = self.scene, self.poses()
        gain = scene.sensor.gain / POSES * self.frames
        with tempfile.TemporaryDirectory() as folder:
            image, motion = Path(folder, "image.npy"), Path(folder, "motion.safetensors")
            command = [sys.executable, "-m", "jotlight", "reconstruct", path, "-o", image]
            command += ["--bits", "--gain", gain, "--threads", threads, "--motion"]
            command += ["--save-motion", motion]
            arguments = [str(each) for each in command]
            seconds, memory = run(arguments)
            estimate, found = np.load(image), jl.Motion.load(motion)
            image.unlink()
            motion.unlink()
            interrupted = max(
                interrupt(arguments, LAST * seconds * (attempt + 1) / INTERRUPTIONS)
                for attempt in range(INTERRUPTIONS)
            )
        reference = poses[self.frames // 2]
        at_reference = scene.motion(reference)
        psnr = jl.metrics.psnr(estimate[INNER], scene.image(reference)[INNER])
        squares = [
            ((found.at(time) - scene.motion(poses[time]) + at_reference) ** 2).sum(axis=0).mean()
            for time in np.linspace(0, self.frames - 1, SAMPLES).astype(int)
        ]
        error = float(np.sqrt(np.mean(squares)))
        return (
            f"| {self.frames:,} | {seconds:.0f} | {memory / 2**20:.0f} | {psnr:.2f} | {error:.3f} "
            f"| {interrupted:.1f} s |"
        )


def repeat(once: npt.NDArray[np.uint8], packed: npt.NDArray[np.uint8]) -> None:
    """Repeat the frames of one path back and forth, with its middle in the middle of a burst."""
    frames, period = len(packed), len(once)
    for start in range(0, frames, CHUNK):
        times = np.arange(start, min(start + CHUNK, frames)) - frames // 2 + period // 2
        number, place = np.divmod(times, period)
        packed[start : start + len(times)] = once[
            np.where(number % 2 == 0, place, period - 1 - place)
        ]


def run(command: list[str]) -> tuple[float, int]:
    """Return the seconds that a command takes, and the peak of its anonymous memory in bytes."""
    start, peak = time.perf_counter(), 0
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            peak = max(peak, anonymous_bytes(process.pid))
            time.sleep(0.02)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {process.returncode}")
    return time.perf_counter() - start, peak


def anonymous_bytes(pid: int) -> int:
    """Return the anonymous memory of a process, or 0 if it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    sizes = [line.split()[1] for line in lines if line.startswith("RssAnon:")]
    return 1024 * int(sizes[0]) if sizes else 0


def interrupt(command: list[str], seconds: float) -> float:
    """Return the seconds from Ctrl-C, some seconds after its start, to the end of a command."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        time.sleep(seconds)
        if process.poll() is not None:
            raise SystemExit("expected a command that still runs")
        start = time.perf_counter()
        process.send_signal(signal.SIGINT)
        process.wait()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
