"""Film networks in PyTorch: agreement with the engine, batches, and training."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.planes.film_planes import Counts, film_planes
from jotlight.networks.planes_network import FilmNetwork
from jotlight.training import ImagePatches
from jotlight.training.film_patches import FilmExample, FilmPatches

torch = pytest.importorskip("torch")
from jotlight.torch import train  # noqa: E402
from jotlight.torch.film_patches import FilmPatchLoader  # noqa: E402
from jotlight.torch.planes_network import PlanesNetwork  # noqa: E402

START = FilmNetwork.initial("small", rng=0)
OPTIONS = {"steps": 4, "batch": 4, "patch": 16, "rng": 3, "threads": 1, "device": "cpu"}


def example(seed, trials=64):
    """Return a photograph as a film network sees it, whose last image was perfect."""
    rng = np.random.default_rng(seed)
    truth = jl.datasets.photograph("camera")[seed * 50 : seed * 50 + 64, 100:164].astype(np.float32)
    p = 1 - np.exp(-truth)
    counts = [
        Counts((rng.binomial(n, p) / n).astype(np.float32), np.full(p.shape, n, np.float32))
        for n in (trials, trials // 4, *[trials // 16] * 5)
    ]
    return FilmExample(
        film_planes(counts[0].fraction, counts, float(trials), np.arcsin(np.sqrt(p))),
        truth,
        float(trials),
        1.0,
    )


SOURCE = FilmPatches([example(seed) for seed in range(4)])


def test_the_module_agrees_with_the_engine():
    trained, _ = train(START, SOURCE, **{**OPTIONS, "steps": 6, "learning_rate": 1e-3})
    planes = example(5).planes
    found = trained.estimate_probability(planes, 50)
    with torch.no_grad():
        expected = PlanesNetwork(trained)(torch.from_numpy(planes)[None], 50)[0]
    assert isinstance(trained, FilmNetwork)
    assert (trained.layers[-1].filters != START.layers[-1].filters).any()
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_batches_depend_on_the_step_alone_and_have_the_trials_of_their_images():
    source = FilmPatches([example(seed, trials) for seed, trials in enumerate([16, 64, 256, 256])])
    loader = FilmPatchLoader(source, START, jl.Sensor(), seed=0, batch_size=3, side=16)
    batch = loader.batch(0, slice(None), 1)
    assert batch.data.shape == (3, 14, 16, 16)
    assert batch.truth.shape == (3, 1, 16, 16)
    assert 16 <= batch.trials <= 256
    part = loader.batch(0, slice(1, 3), 1)
    torch.testing.assert_close(part.data, batch.data[1:3])
    assert part.trials == batch.trials
    assert not torch.equal(loader.batch(1, slice(None), 1).data, batch.data)


@pytest.mark.parametrize(("optimizer", "most"), [("muon", 0.95), ("adam", 0.85)])
def test_training_lowers_the_error(optimizer, most):
    loader = FilmPatchLoader(SOURCE, START, jl.Sensor(), seed=5, batch_size=8, side=32)
    batch = loader.batch(0, slice(None), 1)
    trained, _ = train(
        START, SOURCE, **{**OPTIONS, "steps": 150, "patch": 32, "optimizer": optimizer}
    )

    def error(network):
        with torch.no_grad():
            return float(batch.squared_errors(PlanesNetwork(network)).mean())

    assert error(trained) < most * error(START)


@pytest.mark.parametrize(("trials", "expected"), [(2, 4), (5000, 1024)])
def test_trials_beyond_the_range_of_the_network_count_as_its_ends(trials, expected):
    images = [dataclasses.replace(example(0), trials=float(trials))]
    loader = FilmPatchLoader(FilmPatches(images), START, jl.Sensor(), seed=0, batch_size=2, side=16)
    assert loader.batch(0, slice(None), 1).trials == expected


def test_other_sources_and_tests_are_refused():
    gray = ImagePatches([np.full((32, 32), 0.5)])
    with pytest.raises(ValueError, match=r"expected jotlight\.training\.FilmPatches"):
        train(START, gray, **OPTIONS)
    with pytest.raises(ValueError, match="test: expected none for a FilmNetwork"):
        train(START, SOURCE, test=[np.full((32, 32), 0.5)], **OPTIONS)


def test_errors_are_relative_to_those_of_the_start():
    loader = FilmPatchLoader(SOURCE, START, jl.Sensor(), seed=1, batch_size=4, side=32)
    batch = loader.batch(0, slice(None), 1)
    # An untrained network returns its start, so its errors are those to which they are relative.
    with torch.no_grad():
        found = batch.squared_errors(PlanesNetwork(START))
    torch.testing.assert_close(found, torch.ones(4), atol=1e-4, rtol=0)
    perfect = batch.truth.mul(-1).expm1().neg().sqrt().asin()
    assert float(batch.errors_of(perfect).max()) < 1e-10
