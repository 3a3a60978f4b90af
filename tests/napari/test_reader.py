"""The readers and the layers of the napari plugin."""

import importlib
import warnings
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("dask.array", reason="no dask: pip install 'jotlight[napari]'")
from jotlight.formats.registry import FORMATS, WRITERS
from jotlight.formats.writing import write_capture
from jotlight.napari import reader
from jotlight.napari.lazy import KEY, make_layer, source_of
from jotlight.napari.samples import moving_scene, static_scene
from jotlight.napari.work import align_window, apply_calibration, change_method, measure
from jotlight.view.viewed import Viewed

RNG = np.random.default_rng(0)
BITS = jl.Bits.from_array(RNG.random((3, 6, 13)) < 0.4)
FULL = jl.Bits.from_array(RNG.random((2, 512, 512)) < 0.1)
RAW = {
    "swissspad2": jl.Bits.from_array(RNG.random((2, 256, 512)) < 0.1),
    **dict.fromkeys(("swissspad2-full", "spad512s", "spad512s-sparse"), FULL),
}
RAW_READERS = {
    "swissspad2": reader.get_swissspad2_reader,
    "swissspad2-full": reader.get_swissspad2_full_reader,
    "spad512s": reader.get_spad512s_reader,
    "spad512s-sparse": reader.get_spad512s_sparse_reader,
}
PHOTO = jl.datasets.photograph("camera")[100:140, 180:240]
SENSOR = jl.Sensor(frames=100, max_intensity=4.0, exposure_time=1e-5)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "capture.npy"
    jl.save(SENSOR.expose(PHOTO, rng=0), path)
    return path


def test_a_layer_has_an_image_of_each_window(path):
    [(data, arguments, kind)] = reader.get_reader(str(path))(str(path))
    assert kind == "image"
    assert data.shape == (1, 40, 60)
    assert data.dtype == np.float32
    assert arguments["name"] == "capture.npy, mle"
    source = arguments["metadata"][KEY]
    data, _, _ = change_method(source, "network-medium", 30, 10)
    assert data.shape == (8, 40, 60)
    expected = jl.reconstruct(jl.open(path)[20:50], quality="medium")
    np.testing.assert_array_equal(np.asarray(data[2]), expected)


def test_only_the_viewed_image_is_computed(path, monkeypatch):
    from jotlight.napari.lazy import LayerSource

    [(_, arguments, _)] = reader.read(path)
    computed = []
    original = LayerSource.image

    def image(self, index):
        computed.append(index)
        return original(self, index)

    monkeypatch.setattr(LayerSource, "image", image)
    data, _, _ = change_method(arguments["metadata"][KEY], "mle", 10, 10)
    assert computed == [0]  # for the contrast
    np.asarray(data[7])
    assert computed == [0, 7]


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_every_format_is_read(name, tmp_path):
    for package in {"hdf5": ["h5py"], "zarr": ["zarr"]}.get(name, []):
        pytest.importorskip(package)
    if name not in WRITERS:
        pytest.skip("jotlight does not write this format")
    data, writer = RAW.get(name, BITS), WRITERS[name]
    path = tmp_path / f"capture{writer.extensions[0] if writer.extensions else ''}"
    write_capture(data, path, name=name)
    is_raw = FORMATS[name].is_raw
    get = RAW_READERS[name] if is_raw else reader.get_reader
    [(images, _, _)] = get(str(path))(str(path))
    opened = jl.open(path, format=name if is_raw else None)
    counts = opened.counts(1) if isinstance(opened, jl.Bits) else opened
    assert images.shape[1:] == counts.shape
    # Estimates increase with the counts.
    image = np.asarray(images[0])
    assert (np.diff(image.ravel()[np.argsort(counts, axis=None)]) >= 0).all()


@pytest.mark.parametrize("value", [None, 3, ["a.npy", "b.npy"], "no.such.npy"])
def test_other_paths_have_no_reader(value):
    assert reader.get_reader(value) is None


def test_files_that_are_no_captures_have_no_reader(tmp_path):
    (tmp_path / "a.txt").write_text("text")
    assert reader.get_reader(str(tmp_path / "a.txt")) is None


@pytest.mark.parametrize(
    ("get", "shape"),
    [
        (reader.get_swissspad2_reader, (256, 512)),
        (reader.get_swissspad2_full_reader, (512, 512)),
        (reader.get_spad512s_reader, (512, 512)),
    ],
)
def test_raw_frames_have_a_reader_of_each_camera(tmp_path, get, shape):
    path = tmp_path / "a.bin"
    path.write_bytes(RNG.bytes(2 * shape[0] * shape[1] // 8))
    [(data, _, _)] = get(str(path))(str(path))
    assert data.shape == (1, *shape)
    assert float(np.asarray(data[0]).mean()) > 0
    assert get(str(tmp_path / "a.npy")) is None


def test_images_of_counts_are_read(tmp_path):
    counts = SENSOR.expose(PHOTO, rng=0).counts()
    write_capture(counts, tmp_path / "counts.npy", "npy", trials=100)
    [(data, _, _)] = reader.read(tmp_path / "counts.npy")
    expected = jl.mle(counts, jl.Sensor(frames=100, max_intensity=np.log(200)))
    np.testing.assert_allclose(np.asarray(data[0]), expected, rtol=1e-5)


def test_color_bits_become_a_layer_of_colors():
    bits = jl.Sensor(frames=16).expose(
        jl.datasets.photograph("coffee")[:32, :40], rng=0, channel_axis=-1
    )
    data, arguments, _ = make_layer(Viewed.from_bits(bits), 8)
    assert data.shape == (2, 32, 40, 3)
    assert arguments["rgb"]
    assert 0 <= float(data.min()) <= float(data.max()) <= 1


@pytest.mark.slow
def test_sample_data_are_simulated():
    for [(data, arguments, _)], shape in (
        (static_scene(), (512, 512)),
        (moving_scene(), (256, 256)),
    ):
        assert data.shape == (4, *shape)
        bits = arguments["metadata"][KEY].viewed.data
        assert bits.shape == (256, *shape)


@pytest.mark.slow
def test_a_window_is_aligned():
    [(_, arguments, _)] = moving_scene()
    source = arguments["metadata"][KEY]
    with pytest.raises(ValueError, match=r"expected one of the .* windows of this layer"):
        align_window(source, len(source.spans))
    image, facts, _ = align_window(source, 1)
    bits = source.viewed.data[64:128]
    np.testing.assert_array_equal(image, jl.mle(jl.merge(bits, motion=jl.align(bits))))
    assert "frames 64 to 127, aligned" in facts["name"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")  # a dead pixel is inpainted
def test_a_calibration_changes_the_sensor(path, tmp_path):
    dark_map = np.full(PHOTO.shape, 0.01, np.float32)
    dark_map[5, 6] = 0.5
    camera = jl.Sensor(frames=2000, dark_counts=dark_map)
    jl.save(camera.expose(np.zeros(PHOTO.shape), rng=1), tmp_path / "dark.npy")
    [(_, arguments, _)] = reader.read(path)
    source = arguments["metadata"][KEY]
    (_, changed, _), text = apply_calibration(source, tmp_path / "dark.npy", None, None)
    assert changed["metadata"][KEY].viewed.sensor_of_all.mask[5, 6]
    assert "masked jots: 1 of 2400" in text
    with pytest.raises(ValueError, match="dark capture"):
        apply_calibration(source, None, None, None)


def test_a_rectangle_is_measured():
    image = np.arange(100.0).reshape(10, 10)
    text = measure(None, image, np.array([[2, 3], [2, 5], [4, 5], [4, 3]]))
    assert "pixels: 4" in text
    assert f"mean: {image[2:4, 3:5].mean():.4g}" in text
    with pytest.raises(ValueError, match="rectangle"):
        measure(None, image, np.array([[20, 20], [30, 30]]))


def test_photons_are_measured_in_both_units(path):
    [(data, arguments, _)] = reader.read(path)
    text = measure(arguments["metadata"][KEY], np.asarray(data[0]))
    mean = float(np.asarray(data[0], np.float64).mean())
    assert f"photons per pixel and frame: {mean:.4g}" in text
    assert f"photons per second: {mean * 1e5:.4g}" in text


def test_layers_of_others_are_refused():
    with pytest.raises(ValueError, match="layer: expected one that jotlight made"):
        source_of(None)


def test_the_manifest_names_functions_that_exist():
    with warnings.catch_warnings():  # npe2 uses features of pydantic that will change
        warnings.simplefilter("ignore")
        npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(str(Path(reader.__file__).with_name("napari.yaml")))
    assert manifest.name == "jotlight"
    for command in manifest.contributions.commands:
        module, _, name = command.python_name.partition(":")
        if not module.endswith("widget"):  # it needs Qt
            assert callable(getattr(importlib.import_module(module), name))
    commands = {command.id for command in manifest.contributions.commands}
    used = {each.command for each in manifest.contributions.readers}
    assert used <= commands
