"""`jotlight film` of color mosaics and of color bits."""

import json

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.captures.applied_calibration import record_path
from jotlight.formats.files.checksums import file_checksum
from jotlight.motion.films.film import film
from jotlight.networks.pretrained import CHANNELS_FILE, MOSAIC_FILE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "frames", "model"),
    [
        ("shake", 36, "affine"),
        ("shake", 48, "auto"),
        ("static", 48, "auto"),
    ],
)
def test_a_film_behind_a_mosaic_has_colors(run, tmp_path, motion, frames, model):
    step = frames // 3
    window = 2 * step
    scene = jl.datasets.moving(
        jl.datasets.photograph("astronaut").astype(np.float64),
        motion,
        sensor=jl.Sensor(frames=frames, mosaic="RGGB"),
        shape=(48, 64),
        photons=0.5,
        rng=0,
    )
    jl.save(scene.bits, tmp_path / "mosaic.npy")
    bits = jl.open(tmp_path / "mosaic.npy")
    images = list(film(bits, window=window, step=step, model=model))
    arguments = ["film", "mosaic.npy", "--window", window, "--step", step]
    aligned = [*arguments, "--motion", "--motion-model", model]
    status, output = run(*aligned, "-o", "aligned.npy")
    assert status == 0, output
    assert f"2 images of 48 x 64 x 3 from {window} frames each, " in output
    assert "by network, color in" in output
    expected = [jl.reconstruct(image.data) for image in images]
    np.testing.assert_allclose(np.load(tmp_path / "aligned.npy"), expected, atol=1e-5)
    origin = json.loads(record_path(tmp_path / "aligned.npy").read_text())["origin"]
    own = file_checksum(CHANNELS_FILE if motion == "shake" else MOSAIC_FILE)
    assert own in origin["weights_sha256"]
    assert len(origin["weights_sha256"]) == 2
    assert ("bits agree" in output) == (motion == "shake")
    status, output = run(*arguments, "-o", "plain.npy")
    assert status == 0, output
    assert ("--motion aligns its frames" in output) == (motion == "shake")
    windows = [jl.reconstruct(bits[start : start + window]) for start in (0, step)]
    np.testing.assert_allclose(np.load(tmp_path / "plain.npy"), windows, atol=1e-5)
    options = ["--demosaicing", "differences", "-o", "differences.npy"]
    status, output = run(*arguments, *options)
    assert status == 0, output
    first = jl.reconstruct(bits[:window], demosaicing="differences")
    np.testing.assert_allclose(np.load(tmp_path / "differences.npy")[0], first, atol=1e-5)
    status, output = run(*aligned, "--demosaicing", "differences", "-o", "both.npy")
    assert status == 0, output
    # Only bits have planes: those of a scene that stands still.
    assert ("not used for 2 merged images" in output) == (motion == "shake")
    expected = [
        jl.reconstruct(image.data, method="network-medium", **options_of(image.data))
        for image in images
    ]
    np.testing.assert_allclose(np.load(tmp_path / "both.npy"), expected, atol=1e-5)


def options_of(data):
    """Return how planes become colors, for data that have planes."""
    return {"demosaicing": "differences"} if isinstance(data, jl.Bits) else {}


def test_a_film_of_color_bits_has_the_colors_of_reconstruct(run, tmp_path):
    image = jl.datasets.photograph("astronaut")[:64:2, :80:2].astype(np.float64)
    bits = jl.Sensor(frames=32).expose(image, rng=0, channel_axis=-1)
    jl.save(bits, tmp_path / "colors.npy")
    status, output = run("film", "colors.npy", "--window", 16, "-o", "out.npy")
    assert status == 0, output
    assert "by network, color in" in output
    opened = jl.open(tmp_path / "colors.npy")
    expected = [jl.reconstruct(opened[start : start + 16]) for start in (0, 16)]
    np.testing.assert_allclose(np.load(tmp_path / "out.npy"), expected, atol=1e-5)
