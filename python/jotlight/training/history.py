"""How a run went, step by step."""

import dataclasses
import operator
from typing import Any, Self

import numpy as np
import numpy.typing as npt


@dataclasses.dataclass(frozen=True)
class Record:
    """What one step found before it walked on."""

    step: int
    """From 0."""
    loss: float
    """ε: ½‖ĉ - c‖² of a patch in the mean; where bits are told, their negative log likelihood in
    nats per bit."""
    gradient_norm: float
    """‖∇ε‖."""
    test_psnr: float | None
    """Mean PSNR of the test images in dB at the start of the step, where it was measured."""
    held_out: float | None = None
    """Negative log likelihood of the bits held out, in nats per bit, where it was measured."""


class History:
    """The records of a run in arrays, with NaN where there was no test.

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
        """The number of each step."""
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
        """Mean PSNR of the test images in dB, NaN at steps without a test."""
        return np.array([record.test_psnr for record in self.records], np.float64)

    @property
    def held_out(self) -> npt.NDArray[np.float64]:
        """Negative log likelihood of the bits held out, in nats per bit, NaN where not measured."""
        return np.array([record.held_out for record in self.records], np.float64)

    def to_json(self) -> dict[str, list[Any]]:
        """Give columns that JSON can hold."""
        return {
            "step": [record.step for record in self.records],
            "loss": [record.loss for record in self.records],
            "gradient_norm": [record.gradient_norm for record in self.records],
            "test_psnr": [record.test_psnr for record in self.records],
            "held_out": [record.held_out for record in self.records],
        }

    @classmethod
    def from_json(cls, columns: Any) -> Self:
        """Undo :meth:`to_json`.

        Raises
        ------
        ValueError
            When these are not such columns.
        """
        try:
            # Older files have a record of every step and do not number them, and held no bits out.
            number = len(columns["loss"])
            steps = columns.get("step", range(number))
            held_out = columns.get("held_out", [None] * number)
            values = columns["loss"], columns["gradient_norm"], columns["test_psnr"], held_out
            return cls(
                [
                    Record(
                        operator.index(step),
                        float(loss),
                        float(norm),
                        *(None if found is None else float(found) for found in tests),
                    )
                    for step, loss, norm, *tests in zip(steps, *values, strict=True)
                ]
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"history: expected the records of a run, got {columns!r}") from error

    def subsample(self, most: int = 500) -> Self:
        """Give about so many records: of every so many steps one, the tested ones and the last.

        Examples
        --------
        >>> History([Record(step, 1.0, 1.0, None) for step in range(1001)]).subsample(3).steps
        array([   0,  334,  668, 1000])
        """
        every = -(-len(self) // most)
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

    def __len__(self) -> int:
        return len(self.records)
