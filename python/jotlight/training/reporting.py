"""The progress of a training run, step by step."""

import contextlib
from collections.abc import Callable, Iterator

from jotlight.progress import Progress, shown_progress
from jotlight.training.history import Record, RecordCallback

StepReport = Callable[[Record], bool]
"""A function that takes the record of a step, and returns whether the run goes on."""


class StepDescriber:
    """A function that describes each step in one line, with the newest measurement on tests.

    Examples
    --------
    >>> describe = StepDescriber(10)
    >>> describe(Record(0, 2.0, 0.5, 20.0))
    'step 0/10  cost 2  gradient 0.5  test 20.00 dB'
    >>> describe(Record(1, 1.0, 0.25, None))
    'step 1/10  cost 1  gradient 0.25  test 20.00 dB'
    """

    def __init__(self, steps: int) -> None:
        self._steps, self._test = steps, ""

    def __call__(self, record: Record) -> str:
        """Return the description of a step."""
        if record.test_psnr is not None:
            self._test = f"  test {record.test_psnr:.2f} dB"
        if record.held_out is not None:
            self._test = f"  held out {record.held_out:.5f} nats per bit"
        return (
            f"step {record.step}/{self._steps}  cost {record.loss:.4g}  gradient "
            f"{record.gradient_norm:.3g}{self._test}"
        )


@contextlib.contextmanager
def shown_steps(
    progress: Progress, steps: int, callback: RecordCallback | None
) -> Iterator[StepReport]:
    """Show the progress of a run while the block runs, and yield the function to call each step.

    Parameters
    ----------
    progress : bool or callable, optional
        As in :func:`jotlight.train`.
    steps : int
        Number of steps.
    callback : callable, optional
        The callback of the caller, which is called with the record of each step. By raising
        StopIteration it ends the run.
    """
    describe = StepDescriber(steps)
    with shown_progress(progress, "training") as update:

        def report(record: Record) -> bool:
            update(record.step / max(1, steps), describe(record))
            try:
                if callback is not None:
                    callback(record)
            except StopIteration:
                return False
            return True

        yield report
