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
from jotlight.training import History

_KINDS: dict[type, str] = {ColorNetwork: "color network", FilmNetwork: "film network"}
"""Kinds of networks. All others are plain networks."""


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
    origins = [name for name in ("start", "trained on", "fine-tuned on") if name in history]
    facts += [(name, str(history[name])) for name in origins]
    facts += [
        (name, _describe_run(run, records)) for name, run, records in training_runs(file, network)
    ]
    return facts


def training_runs(
    file: Path, network: Network | PlanesNetwork
) -> list[tuple[str, dict[str, Any], History]]:
    """Return the verb, the settings, and the records of each training run in a network's history.

    Raises
    ------
    ValueError
        When the entries of a run are damaged.
    """
    history = network.history
    runs = []
    for verb, part in (("trained", history), ("fine-tuned", history.get("fine tuning"))):
        if not (isinstance(part, dict) and {"run", "records"} <= part.keys()):
            continue
        try:
            records = History.from_json(part["records"])
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from error
        if not (isinstance(part["run"], dict) and records.records):
            raise ValueError(f"{file}: history: expected the settings and the records of a run")
        runs.append((verb, part["run"], records))
    return runs


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


def _describe_run(run: dict[str, Any], history: History) -> str:
    text = (
        f"{history.steps[-1]} steps of {run.get('optimizer')}, seed {run.get('seed')}; cost "
        f"{history.loss[0]:.4g} to {history.loss[-1]:.4g}"
    )
    measured = history.test_psnr[np.isfinite(history.test_psnr)]
    if len(measured):
        text += f", test PSNR {measured[0]:.2f} to {measured[-1]:.2f} dB"
    held_out = history.held_out[np.isfinite(history.held_out)]
    if len(held_out):
        text += f", held out {held_out[0]:.5f} to {held_out[-1]:.5f} nats per bit"
    return text
