"""Film networks: their start, their files, and their errors."""

import json

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.files.network_files import count_planes
from jotlight.networks.planes.film_planes import Counts, film_planes
from jotlight.networks.planes_network import FilmNetwork
from jotlight.networks.pretrained import FILM_FILE, MOSAIC_FILE, pretrained_film


def planes_of(shape, trials=64.0):
    rng = np.random.default_rng(0)
    counts = [
        Counts(rng.random(shape, np.float32), np.full(shape, trials / part, np.float32))
        for part in (1, 4, *[16] * 5)
    ]
    start, last = rng.random((2, *shape), np.float32)
    return film_planes(start, counts, trials, last)


@pytest.mark.parametrize("size", ["small", "medium", "large"])
@pytest.mark.parametrize("shape", [(16, 24), (9, 7)])
def test_an_untrained_network_returns_its_start(size, shape):
    network, planes = FilmNetwork.initial(size, rng=0), planes_of(shape)
    found = network.estimate_probability(planes, 64)
    assert found.shape == (1, *shape)
    np.testing.assert_allclose(found[0], np.sin(planes[8] + np.pi / 4) ** 2, atol=1e-5)


def test_files_keep_a_network(tmp_path):
    network = FilmNetwork.initial("small", trials_range=(8, 32), rng=0)
    network.save(tmp_path / "f.safetensors")
    loaded = FilmNetwork.load(tmp_path / "f.safetensors")
    assert loaded.trials_range == (8, 32)
    assert count_planes(tmp_path / "f.safetensors") == 14
    planes = planes_of((8, 8))
    found, expected = (
        each.estimate_probability(planes, 1000)  # the nearest K is used
        for each in (loaded, network)
    )
    np.testing.assert_array_equal(found, expected)


def test_other_kinds_of_networks_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"got a film network, .*FilmNetwork\.load reads"):
        jl.Network.load(FILM_FILE)
    with pytest.raises(ValueError, match=r"expected a film network, got a color network"):
        FilmNetwork.load(MOSAIC_FILE)
    with pytest.raises(ValueError, match="expected 14 channels of the first layer and 1 of"):
        FilmNetwork(jl.Network.conditional("small", rng=0).layers, trials_range=(1, 4))
    with pytest.raises(ValueError, match="expected the box kernel, got cubic"):
        FilmNetwork.initial("small", rng=0).check_sensor(jl.Sensor(kernel="cubic"))
    with pytest.raises(FileNotFoundError, match="there is no network file"):
        count_planes(tmp_path / "none.safetensors")


@pytest.mark.parametrize(("planes", "message"), [('"x"', "damaged"), ("5", "of another kind")])
def test_files_with_other_numbers_of_planes_are_refused(tmp_path, planes, message):
    content = FILM_FILE.read_bytes()
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:end])
    header["__metadata__"]["planes"] = planes
    text = json.dumps(header).encode()
    path = tmp_path / "other.safetensors"
    path.write_bytes(len(text).to_bytes(8, "little") + text + content[end:])
    with pytest.raises(ValueError, match=message):
        FilmNetwork.load(path)


def test_the_pretrained_network_reads_the_last_image():
    network, planes = pretrained_film(), planes_of((32, 32))
    found = network.estimate_probability(planes, 64)
    planes[6] += 0.1
    assert abs(network.estimate_probability(planes, 64) - found).max() > 1e-3
