"""Options that align the frames of a moving scene."""

import dataclasses
import functools
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from jotlight.cli.captures.captured import Captured
from jotlight.cli.options.common_options import MOTION_PANEL
from jotlight.cli.terminal.console import progress
from jotlight.errors import plural
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.image_stack import stack_writer
from jotlight.motion.align import align
from jotlight.motion.merge import check_upsample, merge
from jotlight.motion.motion import MODELS, Motion
from jotlight.parameter_names import check_choice
from jotlight.sensing.merged import Merged

_ALIGNING = 0.8
"""Part of the progress bar that aligning takes; merging takes the rest."""


@Parameter(name="*", group=MOTION_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """How the frames of a moving scene are aligned."""

    motion: Annotated[
        bool, Parameter(help="Align the frames along the motion of the scene, for a sharp image.")
    ] = False
    motion_model: Annotated[
        str | None,
        Parameter(
            help=f"Model of the motion: auto, {', '.join(MODELS)}. Default: auto, the one that "
            "explains the bits best."
        ),
    ] = None
    upsample: Annotated[
        int | None,
        Parameter(
            help="2 for twice as many rows and columns as the jots, from shifts by fractions of "
            "a pixel. Default: 1."
        ),
    ] = None

    def check(self) -> None:
        """Raise ValueError for options that do not belong together."""
        for field in dataclasses.fields(self):
            if not self.motion and getattr(self, field.name) != field.default:
                name = field.name.replace("_", "-")
                raise ValueError(f"{name}: is for the motion of the scene; add --motion")
        check_choice("motion-model", self.model, ("auto", *MODELS))
        if self.upsample not in (None, 1, 2):
            raise ValueError(f"upsample: expected 1 or 2, got {self.upsample}")

    def files(self) -> list[Path]:
        """Return the files to read."""
        return []

    @property
    def factor(self) -> int:
        """Rows and columns of the image in units of those of the jots."""
        return self.upsample or 1

    @property
    def model(self) -> str:
        """The model of the motion."""
        return self.motion_model or "auto"

    def facts(self) -> dict[str, Any]:
        """Return how the frames are aligned, for records."""
        return {"model": self.model, "upsample": self.factor}


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmMotionOptions(MotionOptions):
    """How the frames of the images of a film are aligned."""

    causal: Annotated[
        bool,
        Parameter(
            help="Each image shows the last frame of its window, as in live viewing, rather than "
            "the middle."
        ),
    ] = False
    memory: Annotated[
        bool | None,
        Parameter(
            negative="--no-memory",
            help="Also count bits from before the window, where they agree with it. Their weight "
            "decreases with time. --step must be at most half of --window, or less than --window "
            "with --causal. Default: with --causal and such a step, unless --upsample is 2.",
        ),
    ] = None

    recurrent: Annotated[
        bool,
        Parameter(
            help="Estimate the images of a gray film with the film network. It also reads its last "
            "image, if --step is at most half of --window, or less than --window with --causal. "
            "It is for windows of 64 to 256 frames."
        ),
    ] = False

    def check(self) -> None:
        """Raise ValueError for options that do not belong together."""
        super().check()
        for name in ("memory", "recurrent"):
            if getattr(self, name) and self.factor > 1:
                raise ValueError(f"{name}: expected no --{name} with --upsample 2")

    def facts(self) -> dict[str, Any]:
        """Return how the frames are aligned, for records."""
        return {**super().facts(), "causal": self.causal, "recurrent": self.recurrent}


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImageMotionOptions(MotionOptions):
    """How the frames of one image are aligned, and the files of the motion."""

    at: Annotated[
        float | None,
        Parameter(
            help="Time of the image: a frame, counted from 0 within the frame range. Default: the "
            "middle."
        ),
    ] = None
    motion_file: Annotated[
        Path | None,
        Parameter(help="A motion that --save-motion wrote. It is used as it is. Default: none."),
    ] = None
    save_motion: Annotated[
        Path | None, Parameter(help="A .safetensors for the motion that was found. Default: none.")
    ] = None
    maps: Annotated[
        Path | None,
        Parameter(
            help="A .npz, .npy, or .tif with the trials, the fraction of the bits that agree, the "
            "error of the displacement, and the flag of each pixel. Default: none."
        ),
    ] = None

    def check(self) -> None:
        """Raise ValueError for options that do not belong together."""
        super().check()
        for name in ("motion_model", "save_motion"):
            if self.motion_file is not None and getattr(self, name) is not None:
                option = name.replace("_", "-")
                raise ValueError(f"{option}: is for a new motion; leave out --motion-file")
        if self.save_motion is not None and self.save_motion.suffix.lower() != ".safetensors":
            raise ValueError(
                f"save-motion: expected a name that ends in .safetensors, got {self.save_motion}"
            )
        if self.maps is not None:
            stack_writer(self.maps)

    def files(self) -> list[Path]:
        """Return the files to read."""
        return [] if self.motion_file is None else [self.motion_file]

    def paths(self) -> list[Path]:
        """Return all files to write."""
        return [path for path in (self.save_motion, self.maps) if path is not None]

    def facts_of(self, found: Motion) -> dict[str, Any]:
        """Return how the frames were aligned along a motion, for records."""
        at = found.reference if self.at is None else self.at
        facts = {**self.facts(), "found": found.model, "at": at}
        if self.motion_file is None:
            return facts
        checksum = file_checksum(self.motion_file)
        return {**facts, "model": None, "file": self.motion_file.name, "sha256": checksum}

    def align(self, captured: Captured, threads: int | None) -> tuple[Merged | None, Motion]:
        """Return the counts of a capture along its motion, and this motion.

        The counts are None for a scene that stands still behind a mosaic.
        """
        data, sensor = captured.data, captured.sensor
        check_upsample(self.factor, sensor)
        with progress(1) as begin:
            if self.motion_file is None:
                show = begin("aligning", _ALIGNING)
                motion = align(data, sensor, self.at, self.model, threads=threads, progress=show)
            else:
                motion = Motion.load(self.motion_file)
            if sensor.mosaic is not None and motion.model == "none":
                if self.maps is not None:
                    raise ValueError(
                        "maps: the scene stands still behind a mosaic, so nothing is merged; leave "
                        "it out"
                    )
                return None, motion
            show = begin("merging", 1 - _ALIGNING)
            merged = merge(
                data,
                sensor,
                self.at,
                motion,
                upsample=self.factor,
                threads=threads,
                progress=show,
            )
        return merged, motion

    def write(
        self, files: list[Path], merged: Merged | None, motion: Motion, metadata: dict[str, Any]
    ) -> None:
        """Write the temporary files, in the order of :meth:`paths`."""
        remaining = list(files)
        if self.save_motion is not None:
            motion.save(remaining.pop(0))
        if self.maps is not None and merged is not None:
            stack_writer(self.maps, metadata)(remaining.pop(0), _maps(merged))


def _maps(merged: Merged) -> dict[str, npt.NDArray[Any]]:
    """Return the maps of merged counts by name, all in the shape of the image."""
    found = {
        name: getattr(merged, name) for name in ("trials", "acceptance", "posterior_error", "flags")
    }
    return {name: _fill(map_, merged.shape) for name, map_ in found.items() if map_ is not None}


def _fill(values: npt.ArrayLike, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    """Return a number, or a map (H, W), in the shape of an image, (H, W) or (H, W, C)."""
    array = np.asarray(values)
    is_of_pixels = array.ndim == 2 and len(shape) == 3
    return np.broadcast_to(array[..., None] if is_of_pixels else array, shape)


def describe(merged: Merged | None, motion: Motion) -> list[str]:
    """Return what was found, one line each. `merged` is None if nothing was merged."""
    if merged is None:
        return ["motion: none, the scene stands still"]
    trials = np.broadcast_to(merged.trials, merged.shape)
    numbers = (
        f"{trials.min():g} {plural(float(trials.min()), 'trial')} per pixel or more, "
        f"{np.median(trials):g} in the median"
    )
    if merged.upsample > 1:
        numbers += f"; {np.mean(trials > 0):.1%} of the finer grid has readings"
    if motion.model == "none":
        return [f"motion: none, the scene stands still; {numbers}"]
    # One map at a time: long bursts have hundreds of times.
    lengths = functools.reduce(np.maximum, (np.hypot(*motion.at(time)) for time in motion.times))
    half, tenth = np.quantile(lengths, (0.5, 0.9))
    lines = [
        f"motion: {motion.model}; half of the scene moves by {half:.3g} jots or more, and a "
        f"tenth by {tenth:.3g} or more",
        numbers,
    ]
    if merged.acceptance is not None and merged.posterior_error is not None:
        error = np.median(merged.posterior_error) / merged.upsample
        lines.append(
            f"{merged.acceptance.mean():.1%} of the bits along the motion agree and are used; one "
            f"block of frames shows displacements to {error:.2g} jots in the median"
        )
    if merged.flags is not None:
        lines.append(f"{merged.flags.mean():.1%} of the pixels may have larger errors than others")
    return lines
