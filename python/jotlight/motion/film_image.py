"""An image of a film, and how the images of a film are made."""

import dataclasses

from jotlight.motion.memory import Memory, remembers
from jotlight.motion.motion import MODELS, Motion
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged

KEPT_WINDOWS = 4
"""Number of windows whose frames together show the motion of a scene if one is not enough."""


@dataclasses.dataclass(frozen=True)
class FilmImage:
    """The bits of one image of a film, merged along the motion of the scene."""

    merged: Merged
    motion: Motion
    """The motion. Times count from the first frame of the window."""
    is_carried: bool
    """Whether the motion is that of the image before, with new blocks at its end."""
    data: Merged | Bits = dataclasses.field(repr=False)
    """What :func:`jotlight.reconstruct` estimates the image from: `merged`, or bits behind a
    mosaic: those of the window if the scene stands still, and those of fewer frames if no motion
    explains it. The flags of `merged` then say nothing about the image."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmSettings:
    """How the images of a film are made: the arguments of :func:`jotlight.motion.film.film`."""

    window: int
    step: int
    model: str
    causal: bool
    memory: bool | None
    upsample: int
    threads: int | None

    def __post_init__(self) -> None:
        if self.model != "auto" and self.model not in MODELS:
            names = ", ".join(MODELS)
            raise ValueError(f"model: expected auto or one of {names}, got {self.model!r}")

    def new_memory(self) -> Memory | None:
        """Return an empty memory, or None if the film has none."""
        has_memory = remembers(
            self.memory, self.window, self.step, causal=self.causal, upsample=self.upsample
        )
        return Memory(self.window) if has_memory else None

    def more_frames(self, first: int, stop: int, start: int) -> range:
        """Return the numbers of up to four windows of frames, of those from `first` to `stop`.

        They are around the window that begins at `start`, or before its end if the film is causal.
        """
        more = (KEPT_WINDOWS - 1) * self.window
        before, after = (more, 0) if self.causal else (more // 2, more // 2)
        return range(max(first, start - before), min(stop, start + self.window + after))
