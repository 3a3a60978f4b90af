"""The record of a training run, step by step."""

import dataclasses
import operator
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number
from jotlight.notebook import card, table_of
from jotlight.training.figure import draw_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from jotlight.figures import Figure


@dataclasses.dataclass(frozen=True)
class Record:
    """The measurements at the start of one step.

    Attributes
    ----------
    step : int
        Number of the step, from 0.
    loss : float
        Cost ε: ½‖ĉ - c‖², averaged over patches. For K-conditioned, color, and film networks, the
        errors are compressed and relative, as :func:`jotlight.torch.train` states. In fine-tuning
        on bits: their negative log-likelihood in nats per bit.
    gradient_norm : float
        ‖∇ε‖.
    test_psnr : float, optional
        Mean PSNR of the test images in dB, or None where it was not measured.
    held_out : float, optional
        Negative log-likelihood of the held-out bits in nats per bit, or None.
    """

    step: int
    loss: float
    gradient_norm: float
    test_psnr: float | None
    held_out: float | None = None


RecordCallback = Callable[[Record], object]
"""A function that is called with the record of every step.

By raising StopIteration it ends the run."""

_COLUMNS = tuple(field.name for field in dataclasses.fields(Record))


class History:
    """The records of a run, and their fields as arrays.

    Parameters
    ----------
    records : list of Record, optional
        Default: none.

    Examples
    --------
    >>> history = History([Record(0, 2.0, 0.5, 20.0), Record(1, 1.0, 0.25, None)])
    >>> history.loss
    array([2., 1.])
    """

    def __init__(self, records: list[Record] | None = None) -> None:
        self.records = list(records or [])

    @property
    def steps(self) -> npt.NDArray[np.int64]:
        """Number of each step."""
        return np.array([record.step for record in self.records], np.int64)

    @property
    def loss(self) -> npt.NDArray[np.float64]:
        """ε of each step."""
        return np.array([record.loss for record in self.records])

    @property
    def gradient_norm(self) -> npt.NDArray[np.float64]:
        """‖∇ε‖ of each step."""
        return np.array([record.gradient_norm for record in self.records])

    @property
    def test_psnr(self) -> npt.NDArray[np.float64]:
        """Mean PSNR of the test images in dB, NaN where it was not measured."""
        return np.array([record.test_psnr for record in self.records], np.float64)

    @property
    def held_out(self) -> npt.NDArray[np.float64]:
        """Negative log-likelihood of the held-out bits in nats per bit, NaN where not measured."""
        return np.array([record.held_out for record in self.records], np.float64)

    def to_json(self) -> dict[str, list[Any]]:
        """Return a list per field of :class:`Record`, for JSON."""
        return {name: [getattr(record, name) for record in self.records] for name in _COLUMNS}

    @classmethod
    def from_json(cls, columns: Any) -> Self:
        """Return the history that :meth:`to_json` described.

        Raises
        ------
        ValueError
            When these are not the columns of a history.
        """
        try:
            rows = zip(*(columns[name] for name in _COLUMNS), strict=True)
            return cls(
                [
                    Record(
                        operator.index(step),
                        float(loss),
                        float(norm),
                        *(None if value is None else float(value) for value in optional),
                    )
                    for step, loss, norm, *optional in rows
                ]
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            names = ", ".join(_COLUMNS)
            raise ValueError(f"history: expected lists of {names} of a run: {error!r}") from error

    def subsample(self, max_records: int = 500) -> Self:
        """Return a history of about `max_records` records at equal distances.

        Records with measurements on tests or held-out bits, and the last record, always stay.

        Examples
        --------
        >>> History([Record(step, 1.0, 1.0, None) for step in range(1001)]).subsample(3).steps
        array([   0,  334,  668, 1000])
        """
        every = -(-len(self) // whole_number("max_records", max_records, 1))
        return type(self)(
            [
                record
                for number, record in enumerate(self.records)
                if number % every == 0
                or record.test_psnr is not None
                or record.held_out is not None
                or number == len(self) - 1
            ]
        )

    def plot(self) -> "Figure":
        """Return a figure of the cost, the gradient norm, and the tests over the steps."""
        from jotlight.figures import Figure

        figure = Figure(11, 3.1)
        self.draw(figure.subplots(1, 3))
        return figure

    def draw(self, all_axes: "Sequence[Axes]") -> None:
        """Draw the curves of :meth:`plot` into three matplotlib axes."""
        draw_curves(
            all_axes, self.steps, self.loss, self.gradient_norm, self.test_psnr, self.held_out
        )

    def _repr_html_(self) -> str:
        shown = {
            "cost": ("{:.4g}", self.loss),
            "gradient norm": ("{:.3g}", self.gradient_norm),
            "test PSNR, dB": ("{:.2f}", self.test_psnr),
            "held out, nats per bit": ("{:.5f}", self.held_out),
        }
        rows = []
        for name, (pattern, values) in shown.items():
            measured = values[np.isfinite(values)]
            if len(measured):
                rows.append((name, *(pattern.format(measured[place]) for place in (0, -1))))
        steps = max(0, len(self) - 1)
        drawing = self.plot().thumbnail() if self.records else None
        return card("History", {"steps": steps}, drawing) + table_of(("", "first", "last"), rows)

    def __len__(self) -> int:
        return len(self.records)

    def __repr__(self) -> str:
        if not self.records:
            return "<History: no records>"
        first, last = self.records[0], self.records[-1]
        texts = [f"steps {first.step} to {last.step}, cost {first.loss:.4g} to {last.loss:.4g}"]
        if first.test_psnr is not None and last.test_psnr is not None:
            texts.append(f"test PSNR {first.test_psnr:.2f} to {last.test_psnr:.2f} dB")
        return f"<History: {', '.join(texts)}>"
