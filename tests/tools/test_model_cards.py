"""The cards of networks that are written with their files."""

import dataclasses
import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

from jotlight.networks.planes_network import FilmNetwork
from jotlight.networks.pretrained import FILM_FILE

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.fixture
def model_cards(monkeypatch):
    """Return the module, which imports another one by name."""
    monkeypatch.syspath_prepend(str(TOOLS))
    yield importlib.import_module("model_cards")
    for name in ("model_cards", "rounding"):
        del sys.modules[name]


def test_a_shipped_network_is_rounded_and_described(model_cards, tmp_path, capsys):
    network = FilmNetwork.load(FILM_FILE)
    layers = [*network.layers]
    layers[2] = dataclasses.replace(layers[2], filters=layers[2].filters * np.float32(1 + 1e-5))
    history = {"start": "large", "stages": [], "steps": 7}
    changed = FilmNetwork(layers, history, trials_range=network.trials_range)
    file = tmp_path / "film.safetensors"
    texts = {"scenes": 2, "of_gray": 30.0, "own": 30.5}
    measured = []

    def measure(rounded):
        measured.append((rounded, file.exists()))
        return texts

    shipped = model_cards.ship(
        changed, ["5 steps", "6 steps"], file, TOOLS / "film_card.md", measure
    )
    assert measured == [(shipped, True)]
    reopened = FilmNetwork.load(file)
    assert reopened.history == {"start": "large", "stages": ["5 steps", "6 steps"]}
    for layer, before in zip(reopened.layers, network.layers, strict=True):
        np.testing.assert_array_equal(layer.filters, before.filters)
    card = file.with_suffix(".md").read_text(encoding="utf-8")
    assert card in capsys.readouterr().out
    assert "from the gray network medium, 5 steps, then 6 steps." in " ".join(card.split())
    assert "30.50 dB" in card
    # The sizes are those of the card that comes with the network.
    heading = card.partition("- **For**")[0]
    assert FILM_FILE.with_suffix(".md").read_text(encoding="utf-8").startswith(heading)
