"""Names of parameters in other libraries, and values that are names in a list."""

import importlib
import inspect

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets.scenes import uniform_scene
from jotlight.evaluation.methods import METHODS
from jotlight.formats import FORMATS
from jotlight.networks.pretrained import QUALITIES
from jotlight.parameter_names import check_choice, nearest_names

IMAGE = np.full((4, 6), 0.5)
SENSOR = jl.Sensor(frames=2)
NETWORK = jl.Network.initial(SENSOR)

CALLS = {
    "expose": lambda **seed: SENSOR.expose(IMAGE, **seed),
    "moving": lambda **seed: jl.datasets.moving(sensor=SENSOR, **seed),
    "uniform_scene": uniform_scene,
    "draw": lambda **seed: jl.FreeRunning(dead_time=0.01).draw(IMAGE, **seed),
    "compare": lambda **seed: jl.compare("mle", IMAGE, SENSOR, **seed),
    "evaluate": lambda **seed: jl.evaluate("mle", [IMAGE], SENSOR, **seed),
    "train": lambda **seed: jl.train(NETWORK, [IMAGE], **seed),
    "residual": lambda **seed: jl.Network.residual(SENSOR, **seed),
    "conditional": jl.Network.conditional,
    "initial": jl.FilmNetwork.initial,
}


@pytest.mark.parametrize("name", ["seed", "random_state"])
@pytest.mark.parametrize("call", CALLS)
def test_another_name_of_a_seed_gets_the_name_here(call, name):
    message = f"{call}: expected rng= for a seed or a random generator, got {name}=; write rng="
    with pytest.raises(TypeError, match=message):
        CALLS[call](**{name: 1})


@pytest.mark.parametrize(("module", "call"), [("training", "train"), ("fine_tuning", "fine_tune")])
def test_trainings_with_pytorch_have_the_same_message(module, call):
    pytest.importorskip("torch")
    train = getattr(importlib.import_module(f"jotlight.torch.{module}"), call)
    with pytest.raises(TypeError, match=f"{call}: expected rng= for a seed"):
        train(NETWORK, [IMAGE], seed=1)


BITS = SENSOR.expose(IMAGE, 0)

OTHER_NAMES = [
    ("level", "confidence_level", lambda **other: jl.uncertainty(BITS, **other)),
    ("model", "method", lambda **other: jl.uncertainty(BITS, **other)),
    ("epochs", "steps", lambda **other: jl.train(NETWORK, [IMAGE], **other)),
    ("lr", "optimizer", lambda **other: jl.train(NETWORK, [IMAGE], **other)),
    ("validation", "test", lambda **other: jl.train(NETWORK, [IMAGE], **other)),
    ("batch_size", "batch", lambda **other: jl.train(NETWORK, [IMAGE], **other)),
]


@pytest.mark.parametrize(("other", "own", "call"), OTHER_NAMES)
def test_names_of_parameters_in_other_libraries_get_the_name_here(other, own, call):
    with pytest.raises(TypeError, match=f"expected {own}= for .*, got {other}=; write {own}= inst"):
        call(**{other: 1})


@pytest.mark.parametrize(("module", "call"), [("training", "train"), ("fine_tuning", "fine_tune")])
@pytest.mark.parametrize(("other", "own"), [("epochs", "steps"), ("lr", "learning_rate")])
def test_trainings_with_pytorch_know_other_names(module, call, other, own):
    pytest.importorskip("torch")
    train = getattr(importlib.import_module(f"jotlight.torch.{module}"), call)
    with pytest.raises(TypeError, match=f"{call}: expected {own}= for .*, got {other}="):
        train(NETWORK, [IMAGE], **{other: 1})


@pytest.mark.parametrize("method", [None, "mle"])
@pytest.mark.parametrize("name", ["model", "network"])
def test_a_network_of_the_caller_is_the_method(name, method):
    with pytest.raises(TypeError, match=f"{name}: .*network of your own, pass method=net"):
        jl.reconstruct(BITS, method=method, **{name: NETWORK})


def test_one_method_is_evaluated_and_several_are_compared():
    message = r"expected one method, got \['mle', 'admm-tv'\]; jotlight.compare takes several"
    with pytest.raises(TypeError, match=message):
        jl.evaluate(["mle", "admm-tv"], [IMAGE], SENSOR)


def test_signatures_and_other_errors_stay():
    assert list(inspect.signature(jl.Sensor.expose).parameters)[:3] == ["self", "image", "rng"]
    with pytest.raises(TypeError, match="unexpected keyword argument 'tiles'"):
        SENSOR.expose(IMAGE, tiles=3)


@pytest.mark.parametrize(
    ("name", "known", "nearest"),
    [
        ("swisspad2", FORMATS, ["swissspad2"]),
        ("tif", FORMATS, ["tiff"]),
        ("Large", QUALITIES, ["large"]),
        ("network-mediun", METHODS, ["network-medium"]),
        ("tv", METHODS, ["noniterative-tv", "admm-tv"]),
        ("all", METHODS, []),
        ("", METHODS, []),
        ("gig", ["GIF"], ["GIF"]),
    ],
)
def test_the_nearest_names_are_proposed(name, known, nearest):
    assert nearest_names(name, known) == nearest


@pytest.mark.parametrize("value", [None, 3, ["png"], "PNG "])
def test_other_values_are_refused(value):
    with pytest.raises(ValueError, match=r"x: expected one of png, tiff or a function, got"):
        check_choice("x", value, ["png", "tiff"], " or a function")


def test_arguments_of_the_package_have_proposals(tmp_path):
    path = tmp_path / "a.npy"
    for call, name in (
        (lambda: jl.open(path, format="swisspad2"), "swissspad2"),
        (lambda: jl.save(jl.Bits.from_array([[1]]), path, format="tif"), "tiff"),
        (lambda: jl.pretrained(jl.Sensor(frames=4), "Large"), "large"),
        (lambda: jl.Sensor(kernel="boxes"), "box"),
    ):
        with pytest.raises(ValueError, match=rf"expected one of .*; did you mean {name}\?"):
            call()
