"""The stages from a request to images: counts, maximum likelihood, and the chosen method."""

import dataclasses
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import AnyIntegers
from jotlight.errors import warn
from jotlight.estimators.brightness import unit_scale
from jotlight.sensing.merged import Merged
from jotlight.view.alignment import merge_window
from jotlight.view.display import display, display_difference, fit_white
from jotlight.view.estimate import Estimate, choose, estimate, fraction_estimate
from jotlight.view.messages import encode
from jotlight.view.notes import collected
from jotlight.view.overlays import error_levels, find_errors, find_saturated
from jotlight.view.running_counts import RunningCounts
from jotlight.view.state import COUNTS, ViewState
from jotlight.view.viewed import (
    MAX_BRIEF_BYTES,
    CancelledError,
    count_frames,
    frame_bytes,
    whole_cycles,
)
from jotlight.view.workshop import Workshop

MAX_KEEPING_UP = 0.1
"""Time in seconds of a method whose images follow a moving slider without previews."""


@dataclasses.dataclass
class ImageRequest:
    """A request of the page for an image, until a newer one cancels it."""

    number: int
    state: ViewState
    is_moving: bool = False
    """Whether the slider moves, so that the next request follows soon."""
    is_cancelled: bool = False
    started: float = dataclasses.field(default_factory=time.monotonic)

    def check(self) -> None:
        """Raise CancelledError if a newer request has replaced this one.

        While the slider moves, an image that takes a moment is completed. Otherwise a fast slider
        would cancel every image.
        """
        is_brief = self.is_moving and time.monotonic() - self.started < MAX_KEEPING_UP
        if self.is_cancelled and not is_brief:
            raise CancelledError


class Pipeline:
    """The computations of one connection. It keeps only the most recent results."""

    def __init__(self, workshop: Workshop) -> None:
        self.workshop = workshop
        self.viewed = workshop.viewed
        self.last: Estimate | None = None
        """The estimate of the most recent image, for the values under the pointer."""
        self._running = RunningCounts(workshop.viewed)
        self._merged: tuple[tuple[range, float], Merged | None, list[str]] | None = None
        """The aligned bits of a window, and the warnings of their alignment."""
        self._white = 1.0
        self._errors: tuple[Estimate, npt.NDArray[np.float32]] | None = None
        """The standard errors of an estimate."""
        self._sample_size = whole_cycles(self.viewed, MAX_BRIEF_BYTES // frame_bytes(self.viewed))

    def takes_long(self, state: ViewState) -> bool:
        """Return whether counting a window takes so long that a part of it is shown first."""
        return self._running.cost(state.span) > self._sample_size

    def sample_counts(self, request: ImageRequest) -> bytes:
        """Return an image of the middle of a window that takes long to count."""
        frames, number = request.state.span, self._sample_size
        before = (len(frames) - number) // 2
        start = frames.start + before - before % self.viewed.cycle
        sample = range(start, start + number)
        made = fraction_estimate(self.viewed, count_frames(self.viewed, sample), number)
        return self._image_message(request, made, "sample", time.perf_counter())

    def count(self, request: ImageRequest, methods: list[str]) -> tuple[AnyIntegers, bytes | None]:
        """Return the counts of the window of a request, and an image by the first method."""
        counts = self._running.move(request.state.span, request.check)
        return counts, self.preview(request, counts, methods[0]) if methods else None

    def preview(self, request: ImageRequest, counts: AnyIntegers, method: str) -> bytes:
        """Return an image of the counts, or of maximum likelihood, that is refined later."""
        start = time.perf_counter()
        with collected() as notes:
            made = estimate(self.viewed, request.state.span, method, counts, check=request.check)
        is_last = method == request.state.method and is_quick(request.state)
        stage = "final" if is_last else method
        return self._image_message(request, made, stage, start, notes)

    def refine(self, request: ImageRequest, counts: AnyIntegers) -> bytes:
        """Return the image of a method other than the counts, aligned or compared on request."""
        state, start = request.state, time.perf_counter()
        with collected() as notes:
            merged = self._merge(request) if state.align else None
            made, *others = (
                estimate(self.viewed, state.span, method, counts, merged, request.check)
                for method in (state.method, state.compare)
                if method is not None
            )
        self.workshop.record_seconds(state, time.perf_counter() - start)
        request.check()
        other = others[0] if others else None
        return self._image_message(request, made, "final", start, notes, other)

    def overlays(self, request: ImageRequest) -> Iterator[bytes]:
        """Yield the overlays of the most recent image."""
        made = self.last
        for kind in request.state.overlays:
            request.check()
            if made is None:
                continue
            if kind == "uncertainty" and made.method == COUNTS != request.state.method:
                continue  # an estimate replaces the counts soon
            try:
                map_, facts = self._overlay(kind, made)
            except (ValueError, TypeError) as error:
                # The other overlays are known all the same.
                map_ = np.zeros(made.image.shape[:2], np.uint8)
                facts = {"note": str(error), "unknown": True}
            size = {"height": map_.shape[0], "width": map_.shape[1]}
            header = {"type": "overlay", "kind": kind, "id": request.number, **size, **facts}
            yield encode(header, map_)

    def _overlay(self, kind: str, made: Estimate) -> tuple[npt.NDArray[np.uint8], dict[str, Any]]:
        """Return an overlay of an image, and facts about it as values of JSON."""
        if kind == "jots":
            map_, note = self.workshop.jots.find()
            return map_, {"note": note, "searched": self.workshop.jots.is_searched}
        if kind == "saturated":
            return find_saturated(made), {}
        with collected():
            errors = find_errors(made)
        self._errors = made, errors
        return error_levels(errors)

    def values_at(self, row: int, column: int) -> dict[str, Any] | None:
        """Return the values of a pixel of the most recent image in all units, or None outside."""
        made = self.last
        if made is None or row >= made.image.shape[0] or column >= made.image.shape[1]:
            return None
        value = made.image[row, column]
        trials = np.broadcast_to(made.trials, made.counts.shape[: np.ndim(made.trials)])
        readings = trials[row, column] if trials.ndim else trials
        facts: dict[str, Any] = {
            "row": row,
            "column": column,
            "counted": made.counted.name,
            "counts": np.asarray(made.counts[row, column]).tolist(),
            "trials": np.round(np.asarray(readings, np.float64), 2).tolist(),
        }
        if made.method == COUNTS:
            return facts
        if self._errors is not None and self._errors[0] is made:
            error = np.asarray(self._errors[1][row, column], np.float64)
            facts["error"] = [
                each if np.isfinite(each) else None for each in error.ravel().tolist()
            ]
        units = ["intensity"]
        if np.ndim(made.sensor.gain) == 0:  # otherwise the photons differ from frame to frame
            units += ["photons"]
            units += [] if made.sensor.exposure_time is None else ["photons-per-second"]
        for unit in units:
            facts[unit] = np.asarray(value * unit_scale(made.sensor, unit), np.float64).tolist()
        return facts

    def _merge(self, request: ImageRequest) -> Merged | None:
        frames, method = request.state.span, request.state.method
        key = frames, choose(self.viewed, len(frames), method).max_intensity
        if self._merged is None or self._merged[0] != key:
            with collected() as notes:
                merged, _ = merge_window(self.viewed, frames, method, request.check)
            self._merged = key, merged, notes
        for note in self._merged[2]:  # they concern every image of the same bits
            warn(note)
        return self._merged[1]

    def _image_message(
        self,
        request: ImageRequest,
        made: Estimate,
        stage: str,
        start: float,
        notes: list[str] | None = None,
        other: Estimate | None = None,
    ) -> bytes:
        state = request.state
        # Counts that an estimate replaces soon keep the white of the image before them.
        is_replaced = stage == "sample" or (made.method == COUNTS != state.method)
        is_auto = state.white is None and not is_replaced
        if state.white is not None:
            self._white = state.white
        elif is_auto:
            self._white = fit_white(self.viewed, state.span, made)
        if other is None:
            shown = display(made, state, self._white)
        else:
            shown = display_difference(made, other, self._white)
        if stage != "sample":
            self.last = made
        height, width, *channels = shown.levels.shape
        header = {
            "type": "image",
            "id": request.number,
            "stage": stage,
            "title": made.title,
            "start": state.start,
            "window": state.window,
            "height": height,
            "width": width,
            "channels": channels[0] if channels else 1,
            "tone": shown.tone,
            "is_auto": is_auto,
            "low": float(made.image.min()),
            "high": float(made.image.max()),
            "mean_reading": [made.counted.mean, made.mean_reading],
            "seconds": time.perf_counter() - start,
            "notes": notes or [],
        }
        return encode(header, shown.levels)


def is_quick(state: ViewState) -> bool:
    """Return whether the counts or maximum likelihood are all that a state asks for.

    Counts are neither aligned nor compared.

    Examples
    --------
    >>> is_quick(ViewState(method="mle")), is_quick(ViewState(method="mle", align=True))
    (True, False)
    >>> is_quick(ViewState(method="counts", align=True))
    True
    """
    if state.method == COUNTS:
        return True
    return state.method == "mle" and not state.align and state.compare is None
