"""The tool that trains the networks of the package: its images, and runs that continue."""

import argparse
import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.networks.pretrained import FOLDER

TOOLS = Path(__file__).parents[2] / "tools"
COUNTS = {
    "bsds300/train": 3,
    "bsds300/test": 2,
    "bsds500_extra": 21,
    "photographs/cid22": 10,
    "photographs/clic2025": 9,
    "photographs/gb82": 12,
}


@pytest.fixture
def tools(monkeypatch):
    """Return the modules of the tool, which import each other by name."""
    monkeypatch.syspath_prepend(str(TOOLS))
    names = ("training_data", "model_cards", "train")
    modules = {name: importlib.import_module(name) for name in names}
    yield argparse.Namespace(**modules)
    for name in names:
        del sys.modules[name]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = tmp_path_factory.mktemp("data")
    rng = np.random.default_rng(0)
    for folder, count in COUNTS.items():
        (root / folder).mkdir(parents=True)
        for number in range(count):
            image = rng.integers(0, 256, (66, 64, 3)).astype(np.uint8)
            Image.fromarray(image).save(root / folder / f"{number:02d}.png")
    return root


def test_no_image_trains_and_measures(tools, data):
    training = {
        folder: [path.name for path in tools.training_data.training_files(data, folder)]
        for folder in tools.training_data.WEIGHTS
    }
    assert {folder: len(names) for folder, names in training.items()} == {
        "bsds300/train": 3,
        "bsds500_extra": 19,
        "photographs/cid22": 9,
        "photographs/clic2025": 9,
        "photographs/gb82": 2,
    }
    assert training["photographs/gb82"] == ["10.png", "11.png"]
    validation = tools.training_data.validation_files(data)
    assert [path.name for path in validation] == ["09.png", "19.png", "09.png"]
    for path in validation:
        assert path.name not in training[str(path.parent.relative_to(data))]
    images = tools.training_data.validation_images(data)
    assert [image.shape for image in images] == [(66, 64)] * 3


def test_a_missing_folder_is_named(tools, data, tmp_path):
    (tmp_path / "bsds500_extra").mkdir()
    with pytest.raises(FileNotFoundError, match="bsds500_extra: expected photographs, found none"):
        tools.training_data.training_files(tmp_path, "bsds500_extra")


@pytest.mark.slow
def test_a_run_continues_from_weights_and_from_its_finished_stage(tools, data, tmp_path):
    pytest.importorskip("torch")
    options = argparse.Namespace(
        data=data,
        start=FOLDER / "small.safetensors",
        steps=2,
        learning_rate=None,
        seed=None,
        scratch=tmp_path,
        threads=1,
        precision=None,
    )
    network, recipe = tools.train.train_deep("small", options)
    assert re.search(r"then 2 steps at a learning rate of \S+ with 32 patches of 64 × 64", recipe)
    assert recipe.count("the network keeps") == 2  # of the stages before, not of this one
    assert network.history["stages"][-1]["run"]["precision"] in ("f32", "bf16")
    again, _ = tools.train.train_deep("small", options)
    for layer, other in zip(network.layers, again.layers, strict=True):
        np.testing.assert_array_equal(layer.filters, other.filters)
    # The next run has another start, so nothing in the folder of the first one stops it.
    number = len(tools.train.STAGES["small"]) + 1
    options.start = tmp_path / f"small.{number}.safetensors"
    options.seed, options.learning_rate = 6, 1e-4
    continued, recipe = tools.train.train_deep("small", options)
    assert continued.history["stages"][-1]["run"]["seed"] == 6
    assert "2 steps at a learning rate of 0.0001" in recipe
    card = tools.model_cards.render("small", network, recipe, "scores.")
    assert "CC BY-SA 4.0" in card
    assert "`python tools/train.py DATA --only small` ran" in " ".join(card.split())
    assert network.trials_range == jl.Network.load(options.start).trials_range


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--from", "x.safetensors"], "--from: expected --only with the name of one deep network"),
        (["--from", "x.safetensors", "--only", "two-layer-k16"], "one deep network"),
        (["--steps", "3"], "expected --from, whose run they describe"),
    ],
)
def test_options_that_do_not_fit_are_refused(tools, monkeypatch, capsys, arguments, message):
    monkeypatch.setattr(sys, "argv", ["train.py", "data", *arguments])
    with pytest.raises(SystemExit):
        tools.train.main()
    assert message in capsys.readouterr().err
