"""A run's state between two steps, in a file that appears whole or not at all."""

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.tensors import read_tensors, write_tensors
from jotlight.training.history import History
from jotlight.training.optimizers import State
from jotlight.training.parameters import Vector

_FORMAT = "jotlight checkpoint"
_VERSION = "1"


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """What a run needs to go on as if it had not been stopped."""

    run: dict[str, Any]
    """What the run is: images, optimizer, seed and so on; JSON can hold it."""
    vector: Vector
    """The parameters before the next step."""
    state: State
    """What the optimizer remembers."""
    history: History
    """One record for each step that was taken."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the checkpoint."""
        tensors = {"vector": self.vector}
        tensors |= {f"state.{name}": array for name, array in self.state.items()}
        metadata = {
            "format": _FORMAT,
            "version": _VERSION,
            "run": json.dumps(self.run),
            "history": json.dumps(self.history.to_json()),
        }
        write_tensors(path, tensors, metadata)

    @staticmethod
    def refuse_overwrite(path: str | os.PathLike[str]) -> None:
        """Raise ValueError when a file stands at the path that is not a checkpoint."""
        path = Path(path)
        if not path.exists():
            return
        try:
            read_tensors(path, _FORMAT, _VERSION)
        except (ValueError, OSError) as error:
            raise ValueError(
                f"{path}: this file is no checkpoint, so it is not overwritten; give another name"
            ) from error

    @classmethod
    def load(cls, path: str | os.PathLike[str], run: dict[str, Any]) -> "Checkpoint":
        """Read the checkpoint of a run.

        Raises
        ------
        OSError
            When there is no such file.
        ValueError
            When it is damaged, or of another run.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no checkpoint {path} to resume from")
        tensors, metadata = read_tensors(path, _FORMAT, _VERSION)
        try:
            its = dict(json.loads(metadata["run"]).items())
            differences = [
                f"the {name} is another one"
                if name in ("images", "test", "network", "capture")
                else f"{name} is {its.get(name)!r} there and {run.get(name)!r} here"
                for name in {**run, **its}
                if its.get(name) != run.get(name)
            ]
            history = History.from_json(json.loads(metadata["history"]))
            vector = tensors["vector"]
            if not all(x.dtype == np.float64 and np.isfinite(x).all() for x in tensors.values()):
                raise ValueError("expected finite numbers of 64 bits")
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise ValueError(f"{path}: damaged checkpoint: {error}") from error
        if differences:
            raise ValueError(
                f"{path}: this checkpoint is of another run: {'; '.join(differences)}. Start anew "
                "without resuming (--restart), or give what the run began with"
            )
        state = {
            name.removeprefix("state."): tensor
            for name, tensor in tensors.items()
            if name.startswith("state.")
        }
        return cls(run, vector, state, history)
