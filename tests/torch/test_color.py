"""Color networks in PyTorch: agreement with the engine, patches behind mosaics, and training."""

import numpy as np
import pytest

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.networks.planes.color_planes import Filtered, color_planes  # noqa: E402
from jotlight.networks.planes_network import ColorNetwork  # noqa: E402
from jotlight.torch import color_patches, train  # noqa: E402
from jotlight.torch.color_patches import ColorPatchLoader  # noqa: E402
from jotlight.torch.planes_network import PlanesNetwork  # noqa: E402
from jotlight.training import ColorPatches, ImagePatches, random_mosaic  # noqa: E402

START = ColorNetwork.initial("small", rng=0)
PHOTOGRAPH = (jl.datasets.photograph("astronaut")[::4, ::4] * 255).astype(np.uint8)
SOURCE = ColorPatches([PHOTOGRAPH])
LONGER = {"steps": 150, "patch": 24, "batch": 8, "learning_rate": 6e-3}
OPTIONS = {"steps": 4, "batch": 4, "patch": 16, "rng": 3, "threads": 1, "device": "cpu"}


def test_the_module_agrees_with_the_engine():
    trained, _ = train(START, SOURCE, **{**OPTIONS, "steps": 6})
    rng = np.random.default_rng(1)
    every, start = np.ones((16, 24)), rng.random((3, 16, 24))
    seen = [Filtered(share, rng.random((16, 24)), every) for share in np.eye(3)]

    def response(intensity):
        return np.clip(intensity, 0, 1)

    planes = color_planes(seen, start, response)
    found = trained.estimate_probability(planes, 9)
    with torch.no_grad():
        expected = PlanesNetwork(trained)(torch.from_numpy(planes)[None], 9)[0]
    assert [stage["kind"] for stage in trained.history["stages"]] == ["train"]
    assert (trained.layers[-1].filters != START.layers[-1].filters).any()
    np.testing.assert_allclose(found, expected, atol=1e-5)
    rebuilt = PlanesNetwork(trained).to_network()
    assert rebuilt.history == trained.history
    np.testing.assert_array_equal(rebuilt.estimate_probability(planes, 9), found)
    rounded = PlanesNetwork(trained.with_precision("bf16")).to_network()
    assert (rounded.precision, rebuilt.precision) == ("bf16", "f32")


def test_a_batch_holds_different_mosaics_and_the_true_colors():
    loader = ColorPatchLoader(SOURCE, START, jl.Sensor(), seed=0, batch_size=24, side=16)
    batch = loader.batch(0, slice(None), 1)
    assert batch.data.shape == (24, 11, 16, 16)
    assert batch.truth.shape == (24, 3, 16, 16)
    shares = batch.data[:, 4:8]
    assert len({tuple(each[:, :2, :2].flatten().tolist()) for each in shares}) > 3
    # Most patches have ideal filters, so that each pixel has one.
    assert ((shares.sum(1) == 1).all((1, 2))).sum() > 18
    part = loader.batch(0, slice(1, 3), 1)
    torch.testing.assert_close(part.data, batch.data[1:3])
    by_threads = loader.batch(0, slice(None), 3)
    torch.testing.assert_close(by_threads.data, batch.data, rtol=0, atol=0)


def test_the_pixels_of_channels_have_all_filters():
    source = ColorPatches([PHOTOGRAPH], mosaics=None)
    loader = ColorPatchLoader(source, START, jl.Sensor(), seed=0, batch_size=3, side=16)
    shares = loader.batch(0, slice(None), 1).data[:, 4:8]
    expected = torch.tensor([1.0, 1.0, 1.0, 0.0]).view(1, 4, 1, 1).expand(3, 4, 16, 16)
    torch.testing.assert_close(shares, expected)


@pytest.mark.parametrize("mosaics", [random_mosaic, None])
def test_training_lowers_the_error(mosaics, monkeypatch):
    # A few steps hardly improve the usual start.
    monkeypatch.setattr(color_patches, "COLOR_START", "two-layer")
    # They hardly improve patches that are far too bright or too dark.
    monkeypatch.setattr(ColorPatchLoader, "extreme_fraction", 1 / 16)
    color_patches._gray.cache_clear()
    source = ColorPatches([PHOTOGRAPH], mosaics=mosaics)
    loader = ColorPatchLoader(source, START, jl.Sensor(), seed=5, batch_size=16, side=24)
    batch = loader.batch(0, slice(None), 1)
    trained, _ = train(START, source, **{**OPTIONS, **LONGER})
    color_patches._gray.cache_clear()

    def error(network):
        with torch.no_grad():
            return float(batch.squared_errors(PlanesNetwork(network)).mean())

    assert error(trained) < 0.95 * error(START)


def test_gray_patches_and_tests_are_refused():
    gray = ImagePatches(np.random.default_rng(0).random((2, 20, 20), np.float32))
    with pytest.raises(ValueError, match="images: expected color patches"):
        train(START, gray, **OPTIONS)
    with pytest.raises(ValueError, match="test: expected none for a ColorNetwork"):
        train(START, SOURCE, test=[np.ones((20, 20))], **OPTIONS)
