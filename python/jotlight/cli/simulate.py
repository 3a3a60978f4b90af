"""``jotlight simulate``: the bits of a photograph, which may move."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from jotlight._engine import __version__
from jotlight.array_types import Packed
from jotlight.checks import as_image
from jotlight.cli.options.common_options import MOTION_PANEL, Gray, Photo, Seed, Threads, White
from jotlight.cli.options.sensor_options import ExposureOptions
from jotlight.cli.terminal.console import caution, progress, report
from jotlight.datasets.moving_scenes import MOTIONS, MovingScene, moving
from jotlight.datasets.moving_scenes.tables import read_poses
from jotlight.files import atomic_write, check_outputs
from jotlight.formats.files.checksums import file_checksum
from jotlight.formats.npy.description import companion_files, description_path, map_path
from jotlight.formats.writing import choose_output_format, write_capture
from jotlight.images.io import image_writer, read_image
from jotlight.layout import MAX_CHANNELS
from jotlight.output_links import follow_link
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.intensity_scale import gray_levels
from jotlight.sensing.parameters.provenance import SIMULATION, Provenance
from jotlight.sensing.sensor import Sensor

_ROUNDING = 1e-6
"""Largest relative rounding error of white."""


@Parameter(name="*", group=MOTION_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """How the photograph moves."""

    motion: Annotated[
        str | None,
        Parameter(
            help=f"A named scene: {', '.join(MOTIONS)}; or a text file with a line per frame: the "
            "shift in rows and columns, and optionally both degrees and zoom. Commas or spaces "
            "separate the numbers. Default: no motion."
        ),
    ] = None
    foreground: Annotated[
        Path | None,
        Parameter(
            help="A photograph of the objects in front of the photograph, for a scene with "
            "objects. Default: the photograph itself, turned by 180°."
        ),
    ] = None
    photons: Annotated[
        float | None,
        Parameter(
            help="Mean number of photons per jot and frame, to which --gain is scaled. Default: as "
            "--gain states."
        ),
    ] = None
    truth: Annotated[
        Path | None,
        Parameter(
            help="The exact image at the middle frame: .png, .jpg, .tif, .exr, or .npy. "
            "Default: none."
        ),
    ] = None

    def check(self) -> None:
        """Raise ValueError for options that do not belong together."""
        for name in ("foreground", "photons", "truth"):
            if self.motion is None and getattr(self, name) is not None:
                raise ValueError(f"{name}: is for a moving scene; add --motion shake, for example")
        if self.truth is not None:
            image_writer(self.truth)

    def settings(self) -> dict[str, Any]:
        """Return the values of the options that determine the bits, by name."""
        names = {"motion": self.motion, "foreground": self.foreground}
        files = {name: value and Path(value).name for name, value in names.items()}
        return {**files, "photons": self.photons}

    def files(self) -> list[Path]:
        """Return the files to read."""
        table = [] if self.motion is None or self.motion in MOTIONS else [Path(self.motion)]
        return [*table, *([] if self.foreground is None else [self.foreground])]

    def make_scene(
        self,
        image: npt.NDArray[np.floating],
        sensor: Sensor,
        seed: int,
        white: float | None,
        gray: bool,
    ) -> MovingScene:
        """Return the moving scene of an image."""
        assert self.motion is not None
        if self.motion not in MOTIONS and not Path(self.motion).is_file():
            raise ValueError(
                f"motion: there is no file {self.motion}; expected a file with a line for each "
                f"frame, or one of {', '.join(MOTIONS)}"
            )
        motion = self.motion if self.motion in MOTIONS else read_poses(Path(self.motion))
        front = self.foreground
        foreground = None if front is None else as_image(read_image(front, white=white, gray=gray))
        scene = moving(
            image, motion, sensor=sensor, foreground=foreground, photons=self.photons, rng=seed
        )
        if front is not None and not scene.has_objects:
            raise ValueError(
                f"foreground: expected a scene with objects, such as layers, got {self.motion}; "
                "leave it out"
            )
        return scene


def simulate(
    photo: Photo,
    /,
    *,
    output: Annotated[
        Path,
        Parameter(
            alias="-o", help="Packed bits, .npy. A .json that describes them lies beside it."
        ),
    ],
    motion: MotionOptions = MotionOptions(),
    sensor: ExposureOptions = ExposureOptions(),
    seed: Seed = 0,
    gray: Gray = False,
    white: White = None,
    threads: Threads = None,
) -> None:
    """Simulate the bits that a quanta image sensor reports of a photograph."""
    motion.check()
    exposed = Sensor(**sensor.to_kwargs())
    description = description_path(own := follow_link(output))
    maps = [map_path(description, name) for name in exposed.maps()]
    written = {output, description, *maps, *companion_files(own)}
    check_outputs([*written, motion.truth], [photo, *sensor.map_files(), *motion.files()])
    image = as_image(read_image(photo, white=white, gray=gray))
    if image.ndim > 3 or image.shape[2:] > (MAX_CHANNELS,):
        raise ValueError(
            f"photo: expected one image, (H, W) or (H, W, C) with at most {MAX_CHANNELS} channels, "
            f"got {image.shape}; write each image of a stack to a file of its own"
        )
    if motion.motion is None:
        bits = _still_bits(image, exposed, seed, threads)
    else:
        scene = motion.make_scene(image, exposed, seed, white, gray)
        bits = scene.bits
    settings = {"seed": seed, "gray": gray, "white": white, **motion.settings()}
    drawn = _with_origin(bits, photo, settings)
    with progress(1) as begin:
        write_capture(drawn, output, choose_output_format(output, "npy"), begin("drawing bits"))
    if motion.truth is not None:
        with atomic_write(motion.truth) as file:
            image_writer(motion.truth)(file, scene.image())
    report(f"{output}: {bits!r}")
    _caution_about_limit(image, exposed)


def _with_origin(
    bits: Bits | Readings, photo: Path, settings: Mapping[str, Any]
) -> Bits | Readings:
    """Return bits that state the photograph, the options that were set, and the version.

    Their sensor states the other options.
    """
    options = ", ".join(
        f"{name} {value}".removesuffix(" True")
        for name, value in settings.items()
        if value is not None and value is not False
    )
    notes = (
        f"simulated from {photo.name} by jotlight {__version__} with {options}",
        f"SHA-256 of {photo.name}: {file_checksum(photo)}",
    )
    origin = Provenance(SIMULATION, photo.name, notes)
    if isinstance(bits, Readings):
        return Readings(bits.frames, bits.sensor, origin)
    return bits.replace(provenance=origin)


def _caution_about_limit(image: npt.NDArray[np.floating], exposed: Sensor) -> None:
    """Print a remark if an image is brighter than the largest intensity that the file states.

    A white balance does not matter: it multiplies estimates after they are clipped.
    """
    brightest, largest = float(np.max(image)), exposed.max_intensity
    if brightest <= (1 + _ROUNDING) * largest or gray_levels([image], largest) is not None:
        return  # `expose` warns about gray levels
    caution(
        "max-intensity",
        f"the photo reaches {brightest:.3g}, and the bits see all of this light, but the "
        f"file states a largest intensity of {largest:g}, which clips estimates; "
        f"--max-intensity {1.005 * brightest:.3g} states more",
    )


def _still_bits(
    image: npt.NDArray[np.floating], exposed: Sensor, seed: int, threads: int | None
) -> Bits:
    """Return the bits of a photograph that does not move. They are drawn when they are read.

    Readings of several bits are drawn at once.
    """
    axis = None if image.ndim == 2 else -1
    exposed.check_map_shapes(*(size * exposed.oversampling for size in image.shape[:2]))
    channels = image.shape[2:] if exposed.mosaic is None else ()
    if exposed.bit_depth > 1:
        return exposed.expose(image, seed, channel_axis=axis, threads=threads)
    height, width = (size * exposed.oversampling for size in image.shape[:2])
    shape = (exposed.frames, height, math.ceil(width / 8), *channels)

    def draw(start: int, stop: int) -> Packed:
        frames = slice(start, stop)
        bits = exposed.expose(image, seed, channel_axis=axis, frames=frames, threads=threads)
        return np.asarray(bits.packed)

    return Bits(Frames(shape, draw), width, exposed)
