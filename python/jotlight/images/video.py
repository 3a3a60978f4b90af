"""Videos: one image per window of frames, written one by one."""

import contextlib
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError
from jotlight.files import atomic_folder, atomic_write
from jotlight.images.color import FloatImage
from jotlight.images.io import image_writer
from jotlight.images.mp4 import mp4_writer
from jotlight.images.tone import Tone
from jotlight.output_files import OutputFile, open_output

AddImage = Callable[[npt.NDArray[np.float32]], None]


def is_floats(path: Path) -> bool:
    """Return whether a video with this name holds floats.

    Raises
    ------
    MissingExtraError
        If `.mp4` needs the package imageio-ffmpeg.
    ValueError
        If the ending is unknown.
    """
    suffix = path.suffix.lower()
    if suffix not in ("", ".npy", ".mp4", ".gif"):
        raise ValueError(
            f"{path}: expected a name for a video: one that ends in .npy (floats), .mp4 or .gif, "
            f"or a name without ending for a new folder of .png, got {suffix}"
        )
    if suffix == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise MissingExtraError(
            "videos in .mp4 need the package imageio-ffmpeg, which is not installed: "
            "pip install 'jotlight[video]'; .npy, .gif and folders of .png work without it"
        )
    return suffix == ".npy"


@contextlib.contextmanager
def video_writer(
    path: Path, number: int, *, tone: Tone | None = None, fps: float = 25.0, depth: int = 8
) -> Iterator[AddImage]:
    """Yield a function that adds the next image to a video, which is written atomically.

    Parameters
    ----------
    path : path
        `.npy`: float32 (N, H, W) or (N, H, W, C), unchanged. `.mp4`: H.264; an odd last row or
        column is repeated. `.gif`: 256 levels or colors; all images are in memory. No ending: a
        new folder of `00000.png` and so on.
    number : int
        N, the number of images.
    tone : Tone, optional
        The curve from intensities to the display, for all images. Default: linear, 1 is white.
    fps : float
        Images per second of a `.mp4` or `.gif`.
    depth : {8, 16}
        Bits of a `.png`.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "video.npy"
    >>> with video_writer(path, 2) as add:
    ...     add(np.zeros((3, 4), np.float32))
    ...     add(np.ones((3, 4), np.float32))
    >>> np.load(path).shape
    (2, 3, 4)
    """
    curve = tone or Tone("linear")
    if is_floats(path):
        with atomic_write(path) as temporary, open_output(temporary) as file:
            yield lambda image: _append(file, image, number)
    elif path.suffix.lower() == ".gif":
        images: list[npt.NDArray[np.uint8]] = []
        with atomic_write(path) as temporary:
            yield lambda image: images.append(np.rint(curve(image) * 255).astype(np.uint8))
            _write_gif(temporary, images, fps)
    elif path.suffix:
        with atomic_write(path) as temporary, mp4_writer(temporary, fps) as send:
            yield lambda image: send(curve(image))
    else:
        write = image_writer("a.png", depth=depth)
        with atomic_folder(path) as folder:
            digits = max(5, len(str(number)))
            names = (folder / f"{index:0{digits}d}.png" for index in range(number))
            yield lambda image: write(next(names), curve(image))


def _append(file: OutputFile, image: FloatImage, number: int) -> None:
    if file.tell() == 0:
        header = {"descr": "<f4", "fortran_order": False, "shape": (number, *image.shape)}
        np.lib.format.write_array_header_1_0(file, header)
    file.write(image.astype("<f4").tobytes())


def _write_gif(path: Path, images: list[npt.NDArray[np.uint8]], fps: float) -> None:
    """Write images (H, W) or (H, W, 3) as an animation that repeats."""
    from PIL import Image as PillowImage

    first, *others = (PillowImage.fromarray(image) for image in images)
    with open_output(path) as file:
        first.save(file, "GIF", save_all=True, append_images=others, duration=1000 / fps, loop=0)
