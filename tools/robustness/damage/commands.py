"""The commands that write files: at least one for each writer."""

import dataclasses
from collections.abc import Iterator
from importlib.util import find_spec

from jotlight.formats.registry import WRITERS

RAW_INPUTS = {"swissspad2": "half.npy", "spad512s-sparse": "dark.npy"}
"""Inputs for formats that need frames of another size, or frames with few ones."""

CHECKPOINT = """
import sys
import numpy as np
from pathlib import Path
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, Record
vector = np.load("{inputs}/photos.npy").ravel().astype(float)
try:
    Checkpoint({{}}, vector, {{}}, History([Record(0, 1.0, 1.0, None)])).save(Path(sys.argv[1]))
except OSError as error:
    sys.exit(f"error: {{error}}")
"""
"""Script that writes a checkpoint without training."""


@dataclasses.dataclass(frozen=True)
class Command:
    """A command of jotlight. It reads files in folder `in` and writes files in folder `out`."""

    name: str
    """The command, and what it writes, for tables."""
    arguments: tuple[str, ...]
    replaces: bool = True
    """Whether the output may exist. New folders may not."""
    resumes: bool = False
    """Whether a later run continues where a killed one stopped, so that parts of the output may
    stay."""
    shows_progress: bool = False
    """Whether lines about its progress precede the message of an error."""
    script: str = ""
    """Python code that writes the output, where no command does so quickly."""
    needs: str = "numpy"
    """The package that the command needs."""

    @property
    def is_available(self) -> bool:
        """Return whether the package that the command needs is installed."""
        return find_spec(self.needs) is not None

    def launch(self, inputs: str = "in") -> tuple[list[str], list[str]]:
        """Return how Python starts the command, and its arguments, for a folder of inputs."""
        arguments = [word.replace("in/", f"{inputs}/", 1) for word in self.arguments]
        launcher = ["-c", self.script.format(inputs=inputs)] if self.script else []
        return launcher, arguments


def command(name: str, line: str, **options: object) -> Command:
    """Return a command from its name and its arguments in one line."""
    return Command(name, tuple(line.split()), **options)  # type: ignore[arg-type]


def conversions() -> Iterator[Command]:
    """Yield a conversion of bits, of bits with maps, and of counts, to each file and folder."""
    needs = {"hdf5": "h5py", "zarr": "zarr"}
    for name, writer in WRITERS.items():
        inputs = {"bits": RAW_INPUTS.get(name, "bits.npy")} if writer.bits else {}
        if writer.counts:
            inputs["counts"] = "counts.tif"
        if writer.bits and writer.keeps_sensor:
            inputs["bits with maps"] = "maps.npy"
        endings = list(writer.extensions[:1]) + [""] * (writer.folder or not writer.extensions)
        for kind, file in inputs.items():
            for ending in endings:
                place = f"{ending} of {kind}" if ending else f"folder of {kind}"
                # zarr's folders end in .zarr, too.
                new = not ending or name == "zarr"
                yield command(
                    f"convert to {name}: {place}",
                    f"convert in/{file} --to {name} -o out/a{ending}",
                    replaces=not new,
                    needs=needs.get(name, "numpy"),
                )


def reconstructions() -> Iterator[Command]:
    """Yield a reconstruction for each format of images, records, maps, and films."""
    line = "reconstruct in/small.npy -m mle -o out/a"
    for ending in (".png", ".jpg", ".tif", ".exr", ".npy"):
        needs = "OpenEXR" if ending == ".exr" else "numpy"
        yield command(f"reconstruct: {ending}", f"{line}{ending}", needs=needs)
    yield command("reconstruct: .png, 16 bits", f"{line}.png --depth 16")
    yield command("reconstruct: .tif and preview", f"{line}.tif --preview out/b.png")
    for ending in (".npz", ".npy", ".tif"):
        yield command(
            f"reconstruct: uncertainty {ending}", f"{line}.png --uncertainty out/b{ending}"
        )
    yield command(
        "reconstruct: record of the calibration",
        "reconstruct in/calibrated.npy -m mle -o out/a.npy "
        "--calibration in/calibration.safetensors",
    )
    yield command(
        "reconstruct: maps of the motion",
        f"{line}.npy --motion --motion-file in/motion.safetensors --maps out/b.npz",
    )
    line = "film in/small.npy -m mle --window 2 -o out/a"
    yield command("film: folder", line, replaces=False)
    for ending in (".npy", ".gif"):
        yield command(f"film: {ending}", f"{line}{ending}")
    yield command("film: .mp4", f"{line}.mp4", needs="imageio_ffmpeg")


def figures() -> Iterator[Command]:
    """Yield a command for each figure and each of its formats."""
    lines = {
        "compare": "compare in/photo.png -m mle -o out/a",
        "plan": "plan 0.01:1 --frames 4 --plot out/a",
        "info": "info in/calibration.safetensors --plot out/a",
    }
    for name, line in lines.items():
        for ending in (".png", ".pdf", ".svg"):
            yield command(f"{name}: figure {ending}", f"{line}{ending}")


def others() -> Iterator[Command]:
    """Yield the commands that write bits, networks, calibrations, tables, and pages."""
    yield command("simulate: .npy", "simulate in/photo.png -t 64 -o out/a.npy")
    yield command(
        "simulate: .npy with maps",
        "simulate in/photo.png -t 64 -k 1 -o out/a.npy "
        "--dark-counts in/maps.dark_counts.npy --mask in/maps.mask.npy",
    )
    calibrate = "calibrate in/black.tif in/flat.tif -t 4000 -o out/a.safetensors"
    yield command("calibrate: .safetensors", calibrate)
    yield command("calibrate: .safetensors and figure", f"{calibrate} --plot out/b.pdf")
    train = "train synthetic --steps 2 --batch 2 -o out/a.safetensors"
    yield command("train: .safetensors", train, shows_progress=True)
    yield command(
        "train: .safetensors and figure", f"{train} --plot out/b.png", shows_progress=True
    )
    yield Command("train: checkpoint", ("out/a.checkpoint.safetensors",), script=CHECKPOINT)
    yield command(
        "fine-tune: .safetensors",
        "fine-tune in/small.npy --start in/conditional.safetensors --steps 2 --batch 2 "
        "--patch 16 -o out/a.safetensors",
        shows_progress=True,
        needs="torch",
    )
    yield command("evaluate: .csv", "evaluate in/photos.npy -m mle -o out/a.csv")
    yield command(
        "reproduce: tables and pages",
        "reproduce fig5 --quick -o out/a",
        replaces=False,
        resumes=True,
        shows_progress=True,
    )


COMMANDS: tuple[Command, ...] = (*others(), *conversions(), *reconstructions(), *figures())
"""All commands. Each writer of jotlight serves at least one of them."""
