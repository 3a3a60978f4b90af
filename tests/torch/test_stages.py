"""The stages in the history of networks that are trained again and again."""

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("torch")

SENSOR = jl.Sensor(frames=8)
BITS = SENSOR.expose(np.full((24, 24), 0.4), rng=0)
START = jl.Network.conditional("small", rng=0)


def tune(network, seed):
    options = {"steps": 1, "batch": 1, "patch": 16, "threads": 1, "device": "cpu"}
    return jl.torch.fine_tune(network, BITS, rng=seed, **options)[0]


def train(network, seed):
    options = {"steps": 1, "batch": 1, "threads": 1, "device": "cpu"}
    return jl.torch.train(network, [np.full((24, 24), 0.5)], rng=seed, **options)[0]


def test_stages_of_all_kinds_stay_in_order():
    tuned = tune(START, 3)
    stages = tune(train(tuned, 5), 6).history["stages"]
    kinds = [("fine-tune", 3), ("train", 5), ("fine-tune", 6)]
    assert [(stage["kind"], stage["run"]["seed"]) for stage in stages] == kinds
    assert stages[0] == tuned.history["stages"][0]


@pytest.mark.parametrize("again", [tune, train])
def test_training_keeps_the_history_of_a_pretrained_network(again):
    start = jl.pretrained(SENSOR, "small")
    history = again(start, 3).history
    assert history["stages"][:-1] == start.history["stages"]
    assert history["start"] == start.history["start"]
