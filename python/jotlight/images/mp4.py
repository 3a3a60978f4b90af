"""Videos in H.264, which the program ffmpeg of the package imageio-ffmpeg encodes."""

import collections
import contextlib
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.images.color import check_sides
from jotlight.output_files import described_error

_QUALITY = 10
"""Constant rate factor of x264. Smaller is better, and viewers see no loss up to 17."""

_MAX_SIDE = 16_384
"""Maximum number of rows and columns of x264."""

_COLORS = {
    "range": "tv",
    "colorspace": "bt709",
    "color_primaries": "bt709",
    "color_trc": "iec61966-2-1",
}
"""What the file states about its colors: those of sRGB, as in a PNG, with the matrix of BT.709.

Without a statement, players guess a matrix by the size of the images.
"""

_SCALE = "out_color_matrix=bt709:out_range=tv:flags=bicubic+accurate_rnd+full_chroma_int"
"""How RGB or gray levels become Y'CbCr."""


@contextlib.contextmanager
def mp4_writer(path: Path, fps: float) -> Iterator[Callable[[FloatImage], None]]:
    """Yield a function that adds an image (H, W) or (H, W, 3), in [0, 1], to a video.

    Raises
    ------
    OSError
        If ffmpeg cannot write the file.
    ValueError
        If an image is too large for the format.
    """
    ffmpeg: _Encoder | None = None

    def send(image: FloatImage) -> None:
        nonlocal ffmpeg
        check_sides(image, ".mp4", _MAX_SIDE)
        levels = _even_levels(image)
        ffmpeg = ffmpeg or _Encoder(path, levels.shape, fps)
        ffmpeg.write(levels)

    try:
        yield send
        if ffmpeg is not None:
            ffmpeg.finish()
    finally:
        if ffmpeg is not None:
            ffmpeg.stop()


def _even_levels(image: FloatImage) -> npt.NDArray[np.uint8]:
    """Return 8-bit levels of even height and width, because H.264 stores color at half of both."""
    height, width = image.shape[:2]
    margins = ((0, height % 2), (0, width % 2), (0, 0))[: image.ndim]
    levels = np.pad(np.rint(image * 255).astype(np.uint8), margins, mode="edge")
    return np.ascontiguousarray(levels)


class _Encoder:
    """A process of ffmpeg, which encodes raw images."""

    def __init__(self, path: Path, shape: tuple[int, ...], fps: float) -> None:
        import imageio_ffmpeg

        pixels = "gray" if len(shape) == 2 else "rgb24"
        size = f"{shape[1]}x{shape[0]}"
        source = ["-f", "rawvideo", "-pix_fmt", pixels, "-s", size, "-r", str(fps), "-i", "-"]
        stated = ":".join(f"{name}={value}" for name, value in _COLORS.items())
        colors = ["-vf", f"scale={_SCALE},format=yuv420p,setparams={stated}"]
        codec = [*colors, "-c:v", "libx264", "-crf", str(_QUALITY), "-v", "error"]
        self._path = path
        self._process = subprocess.Popen(  # noqa: S603
            [imageio_ffmpeg.get_ffmpeg_exe(), "-y", *source, *codec, f"file:{path}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            # Ctrl-C must not reach ffmpeg. Python ignores SIGXFSZ, and ffmpeg must ignore it too,
            # so that a limit on file sizes does not kill it.
            start_new_session=True,
            restore_signals=False,
        )
        assert self._process.stdin is not None
        assert self._process.stderr is not None
        self._input, self._messages = self._process.stdin, self._process.stderr
        self._lines: collections.deque[bytes] = collections.deque(maxlen=100)
        # If nobody read its messages, ffmpeg would wait as soon as the pipe is full.
        self._reader = threading.Thread(target=self._lines.extend, args=(self._messages,))
        self._reader.start()

    def write(self, levels: npt.NDArray[np.uint8]) -> None:
        """Send an image to ffmpeg. Raise OSError if ffmpeg has failed."""
        try:
            self._input.write(levels.data)
        except BrokenPipeError:
            self.finish()

    def finish(self) -> None:
        """Wait until the file is complete. Raise OSError if ffmpeg has failed."""
        self._close_input()
        status = self._process.wait()
        self._reader.join()
        if status != 0:
            text = b"".join(self._lines).decode(errors="replace")
            raise described_error(f"ffmpeg ended with status {status}\n{text}", self._path)

    def stop(self) -> None:
        """End ffmpeg, unless it has ended."""
        self._process.kill()
        self._close_input()
        self._process.wait()
        self._reader.join()
        self._messages.close()

    def _close_input(self) -> None:
        with contextlib.suppress(BrokenPipeError):
            self._input.close()
