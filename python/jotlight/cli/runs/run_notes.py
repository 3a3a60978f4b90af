"""What a run over captures or windows assumes, and whether the scenes of its captures move."""

from collections import Counter
from collections.abc import Sequence

from jotlight.cli.reports.advice import caution_about_motion, representatives
from jotlight.cli.terminal.console import report
from jotlight.errors import counted
from jotlight.runs.jobs import ImageJob, Job, VideoJob
from jotlight.sensing.bits.frames import frames_within
from jotlight.sensing.data.alike_frames import repeat_exposures

_MAX_NOTES = 20
"""Number of different notes that are printed."""

_MAX_BYTES = 1 << 30
"""Maximum size of the frames in which motion is searched. Such a size is read in seconds."""


def summarize_notes(notes: Sequence[Sequence[str]]) -> list[str]:
    """Return each different note of some captures once, with the number of its captures.

    Examples
    --------
    >>> summarize_notes([["npy: one bit in each number", "sensor: A"], ["sensor: A"]])
    ['npy: one bit in each number (1 of 2 captures)', 'sensor: A']
    """
    numbers = Counter(note for each in notes for note in dict.fromkeys(each))
    total = len(notes)
    lines = [
        note if number == total else f"{note} ({number} of {total} captures)"
        for note, number in numbers.items()
    ]
    more = len(lines) - _MAX_NOTES
    return lines if more <= 0 else [*lines[:_MAX_NOTES], f"and {counted(more, 'other note')}"]


def report_notes(notes: Sequence[Sequence[str]]) -> None:
    """Print each different note of the captures of a run once."""
    report(*summarize_notes(notes))


def caution_about_moving_scenes(jobs: Sequence[Job], threads: int | None) -> None:
    """Print a remark if the scene of the first, the middle, or the last capture moves.

    Of a video, the first, the middle, and the last window are compared.
    """
    images = [job for job in jobs if isinstance(job, ImageJob | VideoJob)]
    for job in representatives(images):
        if job.estimator is None:  # counts of windows, which have no motion to correct
            continue
        bits, sensor = job.capture.open(), job.estimator.sensor
        if isinstance(job, VideoJob):
            starts = [number * job.spans.step for number in range(job.spans.number)]
            parts = [bits[a : a + job.spans.window] for a in representatives(starts)]
            advice = "`jotlight film --motion` aligns the frames of each window"
        else:
            parts = [bits[: frames_within(bits.packed, _MAX_BYTES)]]
            sensor = repeat_exposures(sensor, len(parts[0]))
            advice = "`jotlight reconstruct --motion` of this capture by itself aligns its frames"
        name = job.name if len(jobs) > 1 else None
        if caution_about_motion(parts, sensor, threads, advice=advice, name=name):
            return
