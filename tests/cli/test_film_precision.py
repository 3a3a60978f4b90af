"""`jotlight film --precision`."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.films.estimates import estimate_film
from jotlight.motion.films.film import film
from moving import record


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:window. the film network")
def test_the_film_network_has_both_precisions(run, tmp_path):
    _, moving = record("shake", shape=(48, 64))
    jl.save(moving, tmp_path / "moving.npy")
    arguments = ["film", "moving.npy", "--motion", "--recurrent", "--causal", "--window", 24]
    arguments += ["--step", 8, "-o", "film.npy", "--motion-model", "affine", "--precision"]
    assert run(*arguments, "bf16")[0] == 0
    images = film(moving, window=24, step=8, model="affine", causal=True)
    network = jl.networks.pretrained.pretrained_film().with_precision("bf16")
    expected = list(estimate_film(images, network))
    np.testing.assert_array_equal(np.load(tmp_path / "film.npy"), expected)
    assert run(*arguments, "f32")[0] == 0
    assert (np.load(tmp_path / "film.npy") != np.array(expected)).any()


def test_the_precision_of_the_products_of_a_film_is_an_option(run, tmp_path):
    capture = jl.Sensor(frames=40).expose(np.linspace(0, 1, 24 * 30).reshape(24, 30), rng=0)
    jl.save(capture, tmp_path / "known.npy")
    arguments = ["film", "known.npy", "--window", 20, "-o", "film.npy", "--precision", "bf16"]
    assert run(*arguments, "--quality", "small")[0] == 0
    for number, found in enumerate(np.load(tmp_path / "film.npy")):
        part = capture[20 * number : 20 * number + 20]
        expected = jl.reconstruct(part, quality="small", precision="bf16")
        np.testing.assert_array_equal(found, expected)
    status, output = run(*arguments, "-m", "mle")
    assert (status, "precision: expected f32 for mle, got bf16" in output) == (1, True)
