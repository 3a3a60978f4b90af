"""Files of the image that the page shows, and what they state about it."""

import io
import json
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.cli.view import _open
from jotlight.evaluation.methods import COLOR_NETWORK
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.io import read_note
from jotlight.networks.pretrained import CHANNELS_FILE
from jotlight.view.saving import save_view
from jotlight.view.state import ViewState
from jotlight.view.viewed import Viewed


@pytest.fixture(scope="module")
def moving():
    sensor = jl.Sensor(frames=64, max_intensity=4.0)
    return jl.datasets.moving(motion="shake", sensor=sensor, shape=(48, 64), rng=0).bits


def note_of(viewed, state, ending, folder):
    path = folder / f"saved.{ending}"
    path.write_bytes(save_view(viewed, state, ending))
    return read_note(path)


def opened(path, **options):
    return _open(str(path), CaptureOptions(**options), CapturedSensorOptions())


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "tif", "exr"])
def test_the_record_is_that_of_reconstruct(run, moving, tmp_path, ending):
    if ending == "exr":
        pytest.importorskip("OpenEXR")
    jl.save(moving, tmp_path / "a.npy")
    state = ViewState(8, 32, "network-medium", align=True, curve="gamma", white=0.5)
    note = note_of(opened(tmp_path / "a.npy", rotate=90), state, ending, tmp_path)
    options = ["--frame-range", "8:40", "--rotate", "90", "--motion", "-m", "network-medium"]
    shown = ["--curve", "gamma", "--white", "0.5"] if ending == "png" else []
    code, out = run("reconstruct", "a.npy", "-o", f"b.{ending}", *options, *shown)
    assert code == 0, out
    expected = read_note(tmp_path / f"b.{ending}")
    assert expected["motion"]["found"] == "affine"
    notes = [sorted(each.pop("provenance")["notes"]) for each in (note, expected)]
    assert notes[0] == notes[1]
    assert (note.pop("frames"), note.pop("difference_to")) == ("8:40", None)
    # The page has no calibration and no network of the user.
    assert (expected.pop("calibration_sha256"), expected.pop("model")) == (None, None)
    assert note == expected
    code, out = run("info", f"saved.{ending}")
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert {"capture a.npy", "frames 8:40", "method network-medium"} <= set(lines)
    assert any(line.startswith("motion model=auto") for line in lines)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_an_aligned_mosaic_states_the_network_for_three_channels(tmp_path):
    scene = jl.datasets.moving(
        jl.datasets.photograph("astronaut").astype(np.float64),
        "shake",
        sensor=jl.Sensor(frames=32, mosaic="RGGB"),
        shape=(48, 64),
        photons=0.5,
        rng=0,
    )
    state = ViewState(0, 32, COLOR_NETWORK, align=True)
    note = note_of(Viewed.from_data(scene.bits), state, "tif", tmp_path)
    assert file_checksum(CHANNELS_FILE) in note["weights_sha256"]


def test_counts_and_differences_are_called_so(moving, tmp_path):
    viewed = Viewed.from_data(moving, "bits")
    note = note_of(viewed, ViewState(0, 8, "counts"), "tif", tmp_path)
    assert (note["method"], note["units"]) == ("counts", "fraction of ones")
    assert (note["weights_sha256"], note["motion"], note["bytes"]) == (None, None, None)
    state = ViewState(0, 8, "network-small", compare="mle")
    note = note_of(viewed, state, "png", tmp_path)
    assert (note["method"], note["difference_to"]) == ("network-small", "mle")
    assert note["curve"] == "difference"
    assert "curve" not in note_of(viewed, state, "tif", tmp_path)


def test_the_curve_and_the_white_make_the_same_image(moving, tmp_path):
    viewed, state = Viewed.from_data(moving), ViewState(0, 16, "mle")
    content = save_view(viewed, state, "png")
    note = json.loads(Image.open(io.BytesIO(content)).text["Description"])
    assert note["curve"] == "gamma"
    tone = jl.mle(moving[:16]) / np.float32(note["white"])
    expected = np.clip(tone, 0, 1) ** (1 / 2.2)
    shown = np.asarray(Image.open(io.BytesIO(content))) / 65535
    np.testing.assert_allclose(shown, expected, atol=1e-4)


def test_readings_of_several_bits_state_their_frames(tmp_path):
    sensor = jl.Sensor(frames=8, bit_depth=2)
    readings = sensor.expose(np.full((6, 7), 0.7), rng=0)
    note = note_of(Viewed.from_data(readings), ViewState(2, 4, "mle"), "tif", tmp_path)
    content = np.asarray(readings[2:6].frames).tobytes()
    assert note["counts_bytes"] == len(content)
    assert note["counts_crc32"] == f"{zlib.crc32(content):08x}"


def test_a_calibration_and_hot_jots_are_recorded(tmp_path):
    dark = jl.Bits.from_array(np.random.default_rng(0).random((400, 12, 16)) < 0.05)
    jl.calibrate(dark.counts(1), frames=400).save(tmp_path / "c.safetensors")
    jl.save(dark, tmp_path / "a.npy")
    options = CapturedSensorOptions(calibration=tmp_path / "c.safetensors", find_hot_jots=True)
    viewed = _open(str(tmp_path / "a.npy"), CaptureOptions(), options)
    note = note_of(viewed, ViewState(0, 8, "mle"), "tif", tmp_path)
    assert len(note["calibration_sha256"]) == 64
    assert note["hot_jots"] == 0
    assert set(note["maps_sha256"]) >= {"dark_counts"}


def test_a_capture_that_is_gone_is_an_error(moving, tmp_path):
    jl.save(moving, tmp_path / "a.npy")
    viewed = opened(tmp_path / "a.npy")
    Path(tmp_path / "a.npy").unlink()
    with pytest.raises(OSError, match=r"a\.npy"):
        save_view(viewed, ViewState(0, 8, "mle"), "tif")
