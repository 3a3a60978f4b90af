"""Videos: one image per window of frames, written one by one."""

import contextlib
import itertools
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.checks import real_number, shown
from jotlight.disk_space import check_disk_space
from jotlight.errors import MissingExtraError
from jotlight.files import atomic_folder, atomic_write, refuse_folder
from jotlight.images.color import fit_channels
from jotlight.images.gif import MAX_FPS, gif_writer
from jotlight.images.io import check_depth, image_writer
from jotlight.images.mp4 import mp4_writer
from jotlight.images.tiff import kind_of
from jotlight.images.tone import Tone
from jotlight.output_files import open_output

AddImage = Callable[[npt.NDArray[np.float32]], None]

FLOATS = (".npy", ".tif", ".tiff")
"""Endings of videos that keep floats."""

DEFAULT_FPS = 25.0
"""Images per second of a film."""

_FPS_RANGE = 0.01, 10_000
"""Images per second of a film. Files have no place for longer or much shorter times."""

_MAX_TIFF = 1 << 31
"""Bytes of images up to which a TIFF is not a BigTIFF, which fewer programs read."""


def is_floats(path: Path) -> bool:
    """Return whether a video with this name holds floats.

    Raises
    ------
    MissingExtraError
        If `.mp4` needs the package imageio-ffmpeg.
    OSError
        If the path is a folder that exists.
    ValueError
        If the ending is unknown, or there is nothing before it.
    """
    suffix = path.suffix.lower()
    if path.name.lower() in (*FLOATS, ".mp4", ".gif"):
        raise ValueError(
            f"{path}: expected a name before the ending, such as {path.with_name('film')}"
            f"{path.name.lower()}"
        )
    if suffix not in (*FLOATS, ".mp4", ".gif"):
        refuse_folder(path, "film.gif", may_be_new=True)
    if suffix not in ("", *FLOATS, ".mp4", ".gif"):
        raise ValueError(
            f"{path}: expected a name for a film: one that ends in .npy or .tif (floats), .mp4 or "
            f".gif, or a name without ending for a new folder of .png, got {suffix}"
        )
    if suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise MissingExtraError(
            "videos in .mp4 need the package imageio-ffmpeg, which is not installed: "
            "pip install 'jotlight[video]'; .npy, .tif, .gif and folders of .png work without it"
        )
    return suffix in FLOATS


def check_kind(path: Path, fps: float, depth: int) -> None:
    """Raise ValueError unless a video with this name may have such a rate and such values.

    Parameters
    ----------
    path : path
        The ending is that of the kind of the video.
    fps : float
        Images per second. A video that is no animation may only have the default.
    depth : int
        Bits per value. Only a folder of `.png` may have 16.

    Examples
    --------
    >>> check_kind(Path("a.gif"), 10.0, 8)
    >>> check_kind(Path("a.tif"), 10.0, 8)
    Traceback (most recent call last):
      ...
    ValueError: fps: is for .mp4 and .gif; a.tif has no place for 10 images per second; leave it ...
    """
    low, high = _FPS_RANGE
    if not low <= real_number(fps) <= high:
        raise ValueError(f"fps: expected {low} to {high} images per second, got {shown(fps)}")
    if path.suffix.lower() not in (".mp4", ".gif") and fps != DEFAULT_FPS:
        raise ValueError(
            f"fps: is for .mp4 and .gif; {path} has no place for {fps:g} images per second; leave "
            "it out"
        )
    if path.suffix.lower() == ".gif" and fps > MAX_FPS:
        raise ValueError(
            f"fps: expected up to {MAX_FPS} images per second for a .gif, because viewers show "
            f"faster ones more slowly, got {fps:g}; a .mp4 may be faster"
        )
    # A name without ending is that of a folder of .png.
    check_depth(path.suffix.lower() or ".png", depth, floats=".tif or .npy")


@contextlib.contextmanager
def video_writer(
    path: Path,
    number: int | None = None,
    *,
    tone: Tone | None = None,
    fps: float = DEFAULT_FPS,
    depth: int = 8,
    note: Mapping[str, Any] | None = None,
) -> Iterator[AddImage]:
    """Yield a function that adds the next image to a video, which is written atomically.

    One image at a time is in memory.

    Parameters
    ----------
    path : path
        `.npy`: float32 (N, H, W) or (N, H, W, C), unchanged. `.tif`: a page of float32 for each
        image, unchanged. `.mp4`: H.264; an odd last row or column is repeated. `.gif`: 256 levels
        or colors for each image. No ending: a new folder of `00000.png` and so on.
    number : int, optional
        N, the number of images, if it is known. Without it, a TIFF is a BigTIFF.
    tone : Tone, optional
        The curve from intensities to the display, for all images. Default: linear, 1 is white.
    fps : float
        Images per second of a `.mp4` (0.01 to 10,000) or `.gif` (0.01 to 50).
    depth : {8, 16}
        Bits per value. 16 are for `.png`.
    note : mapping, optional
        Values that JSON can hold, for each `.png`. Other formats have no place for them.

    Raises
    ------
    OSError
        If a write fails, or `number` images of floats do not fit on the disk.
    ValueError
        If an argument is out of its range, the images have different shapes, or there is no image.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "video.npy"
    >>> with video_writer(path) as add:
    ...     add(np.zeros((3, 4), np.float32))
    ...     add(np.ones((3, 4), np.float32))
    >>> np.load(path).shape
    (2, 3, 4)
    """
    curve = tone or Tone("linear")
    shape: tuple[int, ...] | None = None
    check_kind(path, fps, depth)
    suffix = path.suffix.lower()
    with contextlib.ExitStack() as stack:
        if is_floats(path):
            temporary = stack.enter_context(atomic_write(path))
            writer = _npy_writer(temporary) if suffix == ".npy" else _tiff_writer(temporary, number)
            write = stack.enter_context(writer)
        elif suffix:
            temporary = stack.enter_context(atomic_write(path))
            encoder = gif_writer if suffix == ".gif" else mp4_writer
            write = _displayed(stack.enter_context(encoder(temporary, fps)), curve)
        else:
            folder = stack.enter_context(atomic_folder(path))
            write = _displayed(_png_writer(folder, number or 0, depth, note), curve)

        def add(image: npt.NDArray[np.float32]) -> None:
            nonlocal shape
            if shape is None and number is not None and is_floats(path):
                check_disk_space([(path, 4 * number * image.size)])
            shape = shape or image.shape
            if image.shape != shape:
                raise ValueError(
                    f"images: expected one shape for all, got {shape} and {image.shape}"
                )
            write(fit_channels(path, image))

        yield add
        if shape is None:
            raise ValueError(f"images: expected at least one for {path}, got none")


def _displayed(write: Callable[[FloatImage], None], curve: Tone) -> AddImage:
    return lambda image: write(curve(image))


def _png_writer(
    folder: Path, number: int, depth: int, note: Mapping[str, Any] | None
) -> Callable[[FloatImage], None]:
    write, digits = image_writer("a.png", depth=depth, note=note), max(5, len(str(number)))
    names = (folder / f"{index:0{digits}d}.png" for index in itertools.count())
    return lambda image: write(next(names), image)


@contextlib.contextmanager
def _npy_writer(path: Path) -> Iterator[AddImage]:
    number, shape = 0, (0,)
    with open_output(path) as file:

        def write_header() -> None:
            file.seek(0)
            header = {"descr": "<f4", "fortran_order": False, "shape": (number, *shape)}
            np.lib.format.write_array_header_1_0(file, header)

        def add(image: npt.NDArray[np.float32]) -> None:
            nonlocal number, shape
            if number == 0:
                shape = image.shape
                write_header()
            file.write(image.astype("<f4").tobytes())
            number += 1

        yield add
        # NumPy reserves space for the digits of the first dimension, so the size stays the same.
        write_header()


@contextlib.contextmanager
def _tiff_writer(path: Path, number: int | None) -> Iterator[AddImage]:
    import tifffile

    with open_output(path) as file, contextlib.ExitStack() as stack:
        tiff: tifffile.TiffWriter | None = None

        def add(image: npt.NDArray[np.float32]) -> None:
            nonlocal tiff
            if tiff is None:
                is_large = number is None or 4 * number * image.size > _MAX_TIFF
                tiff = stack.enter_context(tifffile.TiffWriter(file, bigtiff=is_large))
            tiff.write(image.astype(np.float32), contiguous=True, **kind_of(image))

        yield add
