"""Videos in H.264, which the program ffmpeg of the package imageio-ffmpeg encodes."""

import contextlib
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import numpy as np
import numpy.typing as npt

from jotlight.images.color import FloatImage
from jotlight.output_files import described_error

_QUALITY = 10
"""The constant rate factor of x264. Up to 17, the eye sees no loss."""


@contextlib.contextmanager
def mp4_writer(path: Path, fps: float) -> Iterator[Callable[[FloatImage], None]]:
    """Yield a function that adds an image (H, W) or (H, W, 3), in [0, 1], to a video.

    Raises
    ------
    ValueError
        If `fps` is not above 0.
    OSError
        If ffmpeg cannot write the file.
    """
    if not 0 < fps < 1e4:
        raise ValueError(f"fps: expected images per second above 0, got {fps}")
    # ffmpeg must never wait for a reader of its messages, so they go to a file.
    with tempfile.TemporaryFile() as messages:
        process: subprocess.Popen[bytes] | None = None

        def send(image: FloatImage) -> None:
            nonlocal process
            levels = _even_levels(image)
            process = process or _start(path, levels.shape, fps, messages)
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(levels.data)
                return
            _finish(process, path, messages)

        try:
            yield send
            if process is not None:
                _finish(process, path, messages)
        finally:
            if process is not None:
                process.kill()
                _close_input(process)
                process.wait()


def _even_levels(image: FloatImage) -> npt.NDArray[np.uint8]:
    """Return gray levels with an even height and width: H.264 stores color at half of both."""
    height, width = image.shape[:2]
    margins = ((0, height % 2), (0, width % 2), (0, 0))[: image.ndim]
    levels = np.pad(np.rint(image * 255).astype(np.uint8), margins, mode="edge")
    return np.ascontiguousarray(levels)


def _start(
    path: Path, shape: tuple[int, ...], fps: float, messages: IO[bytes]
) -> subprocess.Popen[bytes]:
    import imageio_ffmpeg

    pixels = "gray" if len(shape) == 2 else "rgb24"
    source = ["-f", "rawvideo", "-pix_fmt", pixels, "-s", f"{shape[1]}x{shape[0]}", "-r", str(fps)]
    codec = ["-c:v", "libx264", "-crf", str(_QUALITY), "-pix_fmt", "yuv420p"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", *source, "-i", "-", *codec, "-v", "error"]
    return subprocess.Popen(  # noqa: S603
        [*command, f"file:{path}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=messages,
        # Ctrl-C must not reach ffmpeg, and a limit of the file's size must not kill it.
        start_new_session=True,
        restore_signals=False,
    )


def _finish(process: subprocess.Popen[bytes], path: Path, messages: IO[bytes]) -> None:
    """Wait for ffmpeg to end. Raise OSError with its message if it failed."""
    _close_input(process)
    if process.wait() != 0:
        messages.seek(0)
        text = messages.read().decode(errors="replace").strip()
        last = text.splitlines()[-1] if text else f"it ended with status {process.returncode}"
        raise described_error(f"ffmpeg: {last}", path)


def _close_input(process: subprocess.Popen[bytes]) -> None:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()
