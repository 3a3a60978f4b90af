"""Facts about networks, as rows of tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from jotlight.cli.terminal.console import shape_text
from jotlight.errors import counted
from jotlight.networks.graph import flops_per_pixel
from jotlight.networks.layer import Layer
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork, FilmNetwork, PlanesNetwork
from jotlight.networks.stages import Stage, stages_of
from jotlight.training import History

_KINDS: dict[type, str] = {ColorNetwork: "color network", FilmNetwork: "film network"}
"""Kinds of networks. All others are plain networks."""

_VERBS = {"train": "trained", "fine-tune": "fine-tuned"}
"""What was done to a network, by the kind of a training run."""


def network_facts(file: Path, network: Network | PlanesNetwork) -> list[tuple[str, str]]:
    """Return the facts about the network in a file.

    Raises
    ------
    ValueError
        When the history of the network is damaged.
    """
    layers, history = network.layers, network.history
    if network.trials_range is None:
        sensor = repr(network.sensor)
    else:
        low, high = network.trials_range
        sensor = (
            f"any of {counted(low, 'trial')} per pixel or more, {network.sensor.kernel} kernel; "
            f"trained for {low} to {high}"
        )
    flops = network.rotations * flops_per_pixel(layers)
    facts = [
        ("kind", _KINDS.get(type(network), "network")),
        ("sensor", sensor),
        ("parameters", f"{sum(layer.parameter_count for layer in layers):,}"),
        ("work", f"{flops / 1000:.3g} kFLOP per pixel"),
        ("halo", f"{network.halo} pixels"),
    ]
    if "start" in history:
        facts.append(("start", str(history["start"])))
    return facts + _stage_facts(file, network)


def training_runs(file: Path, network: Network | PlanesNetwork) -> list[History]:
    """Return the steps of each training run in a network's history.

    Raises
    ------
    ValueError
        When the history is damaged.
    """
    return [records for stage, records in _read_stages(file, network) if records]


def _stage_facts(file: Path, network: Network | PlanesNetwork) -> list[tuple[str, str]]:
    """Return a row for each stage of a network's history."""
    return [
        (f"stage {number}", stage if isinstance(stage, str) else _describe_run(stage, records))
        for number, (stage, records) in enumerate(_read_stages(file, network), 1)
    ]


def _read_stages(file: Path, network: Network | PlanesNetwork) -> list[tuple[Stage, History]]:
    """Return the stages of a network's history, and the steps of each; texts have none."""
    try:
        stages = stages_of(network.history)
        return [
            (stage, History() if isinstance(stage, str) else _read_run(stage)) for stage in stages
        ]
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def _read_run(stage: object) -> History:
    """Return the steps of a training run, after checks of its record.

    Raises
    ------
    ValueError
        When the record is damaged.
    """
    if isinstance(stage, dict) and stage.get("kind") in [*_VERBS]:
        history = History.from_json(stage.get("records"))
        if isinstance(stage.get("run"), dict) and history.records:
            return history
    raise ValueError("history: expected the kind, the settings, and the records of a run")


def layers_table(layers: Sequence[Layer]) -> Table:
    """Return a table with a row for each layer. Values of a plain chain of layers stay empty."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("layer", "input", "skip", "stride", "up"):
        table.add_column(name, justify="right")
    for name in ("filters", "splines", "range"):
        table.add_column(name)
    for index, layer in enumerate(layers):
        wiring = [
            None if layer.input == index - 1 else layer.input,
            layer.skip,
            None if layer.stride == 1 else layer.stride,
            None if layer.upsampling == 1 else layer.upsampling,
        ]
        table.add_row(
            str(index),
            *("" if number is None else str(number) for number in wiring),
            shape_text(layer.filters.shape),
            *_splines(layer),
        )
    return table


def _splines(layer: Layer) -> tuple[str, str]:
    """Return the shape of the coefficients, and the range of the knots."""
    if layer.coefficients is None:
        return "none", ""
    end = layer.start + layer.spacing * (layer.coefficients.shape[-1] - 3)
    return shape_text(layer.coefficients.shape), f"{layer.start:.3g} to {end:.3g}"


def _describe_run(stage: dict[str, Any], history: History) -> str:
    """Return the kind, the data, the settings, and the result of a training run."""
    run, steps = stage["run"], int(history.steps[-1])
    on = f" on {stage['data']}" if "data" in stage else ""
    text = (
        f"{_VERBS[stage['kind']]}{on}: {counted(steps, 'step')} of {run.get('optimizer')}, seed "
        f"{run.get('seed')}; cost {history.loss[0]:.4g} to {history.loss[-1]:.4g}"
    )
    measured = history.test_psnr[np.isfinite(history.test_psnr)]
    if len(measured):
        text += f", test PSNR {measured[0]:.2f} to {measured[-1]:.2f} dB"
    held_out = history.held_out[np.isfinite(history.held_out)]
    if len(held_out):
        text += f", held out {held_out[0]:.5f} to {held_out[-1]:.5f} nats per bit"
    return text
