"""How a run went, step by step."""

import dataclasses
from typing import Any, Self

import numpy as np
import numpy.typing as npt


@dataclasses.dataclass(frozen=True)
class Record:
    """What one step found before it walked on."""

    step: int
    """From 0."""
    loss: float
    """ε: ½‖ĉ - c‖² of a patch in the mean."""
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
            "loss": [record.loss for record in self.records],
            "gradient_norm": [record.gradient_norm for record in self.records],
            "test_psnr": [record.test_psnr for record in self.records],
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
            rows = zip(columns["loss"], columns["gradient_norm"], columns["test_psnr"], strict=True)
            return cls(
                [
                    Record(step, float(loss), float(norm), None if psnr is None else float(psnr))
                    for step, (loss, norm, psnr) in enumerate(rows)
                ]
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"history: expected the records of a run, got {columns!r}") from error

    def __len__(self) -> int:
        return len(self.records)
