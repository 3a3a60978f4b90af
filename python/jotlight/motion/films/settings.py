"""How the images of a film are made."""

import dataclasses

from jotlight.checks import shown
from jotlight.motion.films.memory import Memory, remembers
from jotlight.motion.motion import MODELS
from jotlight.parameter_names import check_choice

KEPT_WINDOWS = 4
"""Number of windows whose frames together show the motion of a scene if one is not enough."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmSettings:
    """How the images of a film are made: the arguments of :func:`jotlight.film`."""

    window: int
    step: int
    model: str
    causal: bool
    memory: bool | None
    upsample: int
    threads: int | None

    def __post_init__(self) -> None:
        check_choice("model", self.model, ("auto", *MODELS))
        for name, value in (("causal", self.causal), ("memory", self.memory)):
            if not isinstance(value, bool) and not (name == "memory" and value is None):
                raise TypeError(f"{name}: expected True or False, got {shown(value)}")

    def new_memory(self) -> Memory | None:
        """Return an empty memory, or None if the film has none."""
        has_memory = remembers(
            self.memory, self.window, self.step, causal=self.causal, upsample=self.upsample
        )
        return Memory(self.window, self.threads) if has_memory else None

    def window_at(self, start: int) -> range:
        """Return the numbers of the frames of the window that begins at a frame."""
        return range(start, start + self.window)

    def more_frames(self, known: range, start: int) -> range:
        """Return the numbers of up to four windows of known frames.

        They are around the window that begins at `start`, or before its end if the film is causal.
        """
        more = (KEPT_WINDOWS - 1) * self.window
        before, after = (more, 0) if self.causal else (more // 2, more // 2)
        return range(max(known.start, start - before), min(known.stop, start + self.window + after))
