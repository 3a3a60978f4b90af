"""A run's state between two steps, in a file that appears whole or not at all."""

import contextlib
import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.files import written_whole
from jotlight.training.history import History
from jotlight.training.optimisers import State
from jotlight.training.parameters import Vector

_FORMAT = "jotlight checkpoint"
_VERSION = "1"


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """What a run needs to go on as if it had not been stopped."""

    run: dict[str, Any]
    """What the run is: images, optimiser, seed and so on; JSON can hold it."""
    vector: Vector
    """The parameters before the next step."""
    state: State
    """What the optimiser remembers."""
    history: History
    """One record for each step that was taken."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the checkpoint."""
        from safetensors.numpy import save

        tensors = {"vector": self.vector}
        tensors |= {f"state.{name}": array for name, array in self.state.items()}
        metadata = {
            "format": _FORMAT,
            "version": _VERSION,
            "run": json.dumps(self.run),
            "history": json.dumps(self.history.to_json()),
        }
        with written_whole(path) as temporary:
            temporary.write_bytes(save(tensors, metadata))

    @staticmethod
    def spare_others(path: str | os.PathLike[str]) -> None:
        """Raise ValueError when a file stands at the path that is not a checkpoint."""
        from safetensors import SafetensorError, safe_open

        path = Path(path)
        if not path.exists():
            return
        metadata: dict[str, str] = {}
        with contextlib.suppress(SafetensorError, OSError), safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
        if metadata.get("format") != _FORMAT:
            raise ValueError(
                f"{path}: this file is no checkpoint, so it is not overwritten; give another name"
            )

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
        from safetensors import SafetensorError, safe_open

        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no checkpoint {path} to resume from")
        try:
            with safe_open(path, framework="numpy") as file:
                metadata = file.metadata() or {}
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, TypeError, AttributeError) as error:
            raise ValueError(f"{path}: damaged checkpoint: {error}") from error
        if metadata.get("format") != _FORMAT or metadata.get("version") != _VERSION:
            raise ValueError(
                f"{path}: expected a checkpoint of version {_VERSION}, got "
                f"{metadata.get('format', 'a file of another kind')}"
            )
        try:
            its = dict(json.loads(metadata["run"]).items())
            differences = [
                f"the {name} is another one"
                if name in ("images", "test", "network")
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
