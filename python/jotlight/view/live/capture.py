"""A capture that grows while it is viewed."""

import contextlib
import threading
from collections.abc import Callable
from typing import Any

from jotlight.errors import error_message
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor
from jotlight.view.live.ring import FrameRing
from jotlight.view.live.tails import Tail
from jotlight.view.viewed import Opening, image_shape


class LiveCapture:
    """The frames that a camera writes now, of which the newest ones are in memory.

    A thread reads all frames as fast as they arrive, whatever the page does.

    Parameters
    ----------
    title : str
        The name of the capture.
    ring : FrameRing
        The memory for the newest frames.
    sensor : Sensor
        The sensor of one frame.
    provenance : Provenance
        The origin of the frames.
    is_range_known : bool
        Whether the capture or the user states the largest intensity.
    sensor_note : str
        That the sensor is assumed, and which one, or "" if the capture states it.
    """

    is_live = True
    cycle = 1

    def __init__(
        self,
        title: str,
        ring: FrameRing,
        sensor: Sensor,
        provenance: Provenance,
        *,
        is_range_known: bool = False,
        sensor_note: str = "",
    ) -> None:
        self.title, self.provenance = title, provenance
        self.opening = Opening()
        self.is_range_known, self.sensor_note = is_range_known, sensor_note
        self.ring = ring
        self.dropped = 0
        """Number of frames that were never read, or are missing in the capture."""
        self.ended = False
        self.problem: str | None = None
        """What is wrong with the capture, as the page shows it, or None."""
        self.remark: str | None = None
        """What happened last that needs no action, such as a file that is no capture."""
        self.stop = threading.Event()
        """The request to the thread to end."""
        self._sensor = sensor
        self._thread: threading.Thread | None = None

    @property
    def frames(self) -> range:
        """The frames in memory."""
        return self.ring.frames

    @property
    def shape(self) -> tuple[int, ...]:
        """(H, W): the shape of an image, in pixels."""
        layout = self.ring.layout
        return image_shape((1, layout.shape[0], layout.width), self._sensor)

    def sensor(self, number: int) -> Sensor:
        """Return the sensor of a window of `number` frames."""
        return self._sensor.replace(frames=number)

    def part(self, frames: range) -> Bits:
        """Return a copy of a window of frames."""
        return Bits(self.ring.read(frames), self.ring.layout.width, self.sensor(len(frames)))

    def facts(self) -> dict[str, Any]:
        """Return the available frames, and how many were dropped."""
        frames = self.frames
        return {
            "first": frames.start,
            "end": frames.stop,
            "dropped": self.dropped,
            "ended": self.ended,
            "problem": self.problem,
            "remark": self.remark,
            "rates": self.ring.rates(),
        }

    def drop(self, frames: int) -> None:
        """Count frames as dropped."""
        self.dropped += frames
        self.ring.skip(frames)

    def start(self, work: Callable[["LiveCapture"], None]) -> None:
        """Run a function in a thread, which adds frames until it returns or fails."""

        def run() -> None:
            try:
                work(self)
            except Exception as error:
                # Nobody else learns of an error in this thread.
                self.problem = error_message(error)
                if not isinstance(error, (OSError, ValueError)):
                    raise
            finally:
                self.ended = True

        self._thread = threading.Thread(target=run, daemon=True, name="jotlight-live")
        self._thread.start()

    def close(self) -> None:
        """Stop reading."""
        self.stop.set()
        if self._thread is not None:
            self._thread.join(1.0)


def read_stream(capture: LiveCapture, tail: Tail) -> None:
    """Add the frames of a stream of bytes, which follow each other without gaps, until it ends.

    If more frames of a file wait than the memory holds, the oldest ones are dropped and counted.
    """
    with contextlib.closing(tail):
        while not capture.stop.is_set():
            if not _read_once(capture, tail):
                return


def _read_once(capture: LiveCapture, tail: Tail) -> bool:
    """Add the bytes that have arrived, and return whether more may arrive."""
    ring = capture.ring
    if ring.partial_bytes == 0:
        skipped = tail.skip(ring.capacity * ring.frame_bytes, ring.frame_bytes)
        if skipped:
            capture.drop(skipped)
    try:
        ring.commit(tail.read(ring.reserve()))
    except EOFError:
        if left := ring.partial_bytes:
            size = ring.frame_bytes
            capture.problem = f"the last frame is not complete: {left} of {size} bytes"
        return False
    return True
