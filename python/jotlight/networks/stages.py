"""The history of a network: where its parameters came from, and the stages that changed them.

`network.history` contains what JSON can hold:

- `start`: a text that names the parameters before the first stage;
- `stages`: all that changed the parameters, in order. A stage is a record of a training run, or a
  text that describes another change.

The record of a run is a dictionary:

- `kind`: "train" or "fine-tune";
- `data`: a text that names the images or the capture, if it is known;
- `run`: the settings; `records`: the steps.
"""

from collections.abc import Mapping
from typing import Any, Literal

Stage = str | dict[str, Any]
"""A text, or the record of a training run."""


def stages_of(history: Mapping[str, Any]) -> list[Stage]:
    """Return the stages of a history, in order.

    Raises
    ------
    ValueError
        When they are no list.

    Examples
    --------
    >>> stages_of(jl.Network.initial(jl.Sensor()).history)
    []
    """
    stages = history.get("stages", [])
    if not isinstance(stages, list):
        raise ValueError(f"history: expected a list of stages, got {stages!r:.60}")
    return list(stages)


def with_stage(history: Mapping[str, Any], stage: Stage) -> dict[str, Any]:
    """Return a history with one more stage at its end.

    Examples
    --------
    >>> with_stage({"start": "random"}, "changed")
    {'start': 'random', 'stages': ['changed']}
    """
    return {**history, "stages": [*stages_of(history), stage]}


def with_run(
    history: Mapping[str, Any], kind: Literal["train", "fine-tune"], run: Any, records: Any
) -> dict[str, Any]:
    """Return a history with a training run at its end, from its settings and its steps."""
    return with_stage(history, {"kind": kind, "run": run, "records": records})


def last_run(history: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of the last training run.

    Raises
    ------
    ValueError
        When no stage is one.
    """
    for stage in reversed(stages_of(history)):
        if isinstance(stage, dict):
            return stage
    raise ValueError("history: expected a stage that is a training run")
