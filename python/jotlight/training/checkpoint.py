"""The state of a run between two steps, and its file, which is written atomically."""

import dataclasses
import json
import math
import os
import secrets
import time
from typing import Any

import numpy as np

from jotlight.array_types import Array
from jotlight.checks import whole_number
from jotlight.paths import as_path
from jotlight.tensors import read_tensors, write_tensors
from jotlight.training.history import History
from jotlight.training.optimizer_protocol import State

_FORMAT = "jotlight checkpoint"
_VERSION = "1"

_CALL = 'checkpoint="run.checkpoint.safetensors"'
"""An example of the argument, for messages."""

_OPAQUE = "images", "test", "network", "capture"
"""Settings whose values are digests. Messages omit these values."""


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """The state of a run, from which it continues as if it had not stopped."""

    run: dict[str, Any]
    """Settings that identify the run, such as optimizer, seed, and a digest of the images."""
    vector: Array
    """Parameters before the next step."""
    state: State
    """State of the optimizer."""
    history: History
    """One record per finished step."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the checkpoint to a file."""
        tensors = {"vector": self.vector}
        tensors |= {f"state.{name}": array for name, array in self.state.items()}
        metadata = {
            "format": _FORMAT,
            "version": _VERSION,
            "run": json.dumps(self.run),
            "history": json.dumps(self.history.to_json()),
        }
        write_tensors(as_path(path, _CALL), tensors, metadata)

    @staticmethod
    def refuse_overwrite(path: str | os.PathLike[str]) -> None:
        """Raise ValueError when the path is a file that is not a checkpoint."""
        path = as_path(path, _CALL)
        if not path.exists():
            return
        try:
            read_tensors(path, _FORMAT, _VERSION)
        except (ValueError, OSError) as error:
            raise ValueError(
                f"{path}: this file is no checkpoint, so it is not overwritten; choose another name"
            ) from error

    @classmethod
    def load(cls, path: str | os.PathLike[str] | None, run: dict[str, Any]) -> "Checkpoint":
        """Return the checkpoint of a run.

        Raises
        ------
        OSError
            When the file does not exist.
        ValueError
            When there is no path, or when the file is damaged or belongs to another run.
        """
        checkpoint = cls._read(path)
        differences = _differences(checkpoint.run, run)
        if differences:
            raise ValueError(
                f"{path}: this checkpoint belongs to another run: {'; '.join(differences)}. Start "
                "again with resume=False (--restart), or use the settings of the checkpoint"
            )
        return checkpoint

    @classmethod
    def choose_seed(cls, rng: int | None, path: str | os.PathLike[str] | None, resume: bool) -> int:
        """Return the seed of a run: `rng`, else that of the run to resume, else a fresh one.

        Raises
        ------
        TypeError
            When `rng` is not a whole number.
        OSError, ValueError
            When `rng` is negative, or when the checkpoint of a run to resume cannot be read.
        """
        if rng is not None:
            return whole_number("rng", rng, 0)
        if not resume:
            return secrets.randbits(32)
        seed = cls._read(path).run.get("seed")
        if type(seed) is not int or seed < 0:
            raise ValueError(f"{path}: damaged checkpoint: expected a seed, got {seed!r}")
        return seed

    @classmethod
    def _read(cls, path: str | os.PathLike[str] | None) -> "Checkpoint":
        """Return the checkpoint in a file."""
        if path is None:
            raise ValueError("resume: expected a checkpoint to resume from, got none")
        path = as_path(path, _CALL)
        if not path.is_file():
            raise FileNotFoundError(f"there is no checkpoint {path} to resume from")
        tensors, metadata = read_tensors(path, _FORMAT, _VERSION)
        try:
            run = dict(json.loads(metadata["run"]).items())
            history = History.from_json(json.loads(metadata["history"]))
            vector = tensors["vector"]
            if not all(x.dtype == np.float64 and np.isfinite(x).all() for x in tensors.values()):
                raise ValueError("expected finite float64 numbers")
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise ValueError(f"{path}: damaged checkpoint: {error}") from error
        state = {
            name.removeprefix("state."): tensor
            for name, tensor in tensors.items()
            if name.startswith("state.")
        }
        return cls(run, vector, state, history)


def _differences(saved: dict[str, Any], run: dict[str, Any]) -> list[str]:
    """Return a phrase for each setting that differs between a file and a run."""
    return [
        f"different {name}"
        if name in _OPAQUE
        else f"{name} is {saved.get(name)!r} in the file and {run.get(name)!r} in this run"
        for name in {**run, **saved}
        if saved.get(name) != run.get(name)
    ]


class CheckpointWriter:
    """A writer of checkpoints: after the first step of a run, at intervals, and at its end.

    Parameters
    ----------
    path : path or None
        File to write. None: nothing is written.
    steps : int
        Number of finished steps that the file already contains.
    """

    INTERVAL = 20.0
    """Minimum number of seconds between two writes."""

    def __init__(self, path: str | os.PathLike[str] | None, steps: int) -> None:
        self._path = path
        self._saved_steps = steps
        self._saved_at = -math.inf

    def update(self, state: Checkpoint) -> None:
        """Write the state if the last write is longer ago than the interval."""
        if self._path is not None and time.monotonic() - self._saved_at > self.INTERVAL:
            state.save(self._path)
            self._saved_steps, self._saved_at = len(state.history), time.monotonic()

    def close(self, state: Checkpoint) -> None:
        """Write the state if it has more steps than the file."""
        if self._path is not None and len(state.history) > self._saved_steps:
            state.save(self._path)
