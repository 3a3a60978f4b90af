"""The readers and the layers of the napari plugin."""

import sys
import types
import warnings

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("dask.array", reason="no dask: pip install 'jotlight[napari]'")
from jotlight.formats.registry import FORMATS, WRITERS
from jotlight.formats.writing import write_capture
from jotlight.napari import reader
from jotlight.napari.lazy import KEY, make_layer, source_of
from jotlight.napari.samples import moving_scene, static_scene
from jotlight.napari.work import align_window, apply_calibration, change_method
from jotlight.view.viewed import Viewed

RNG = np.random.default_rng(0)
BITS = jl.Bits.from_array(RNG.random((3, 6, 13)) < 0.4)
FULL = jl.Bits.from_array(RNG.random((2, 512, 512)) < 0.1)
RAW = {
    "swissspad2": jl.Bits.from_array(RNG.random((2, 256, 512)) < 0.1),
    **dict.fromkeys(("swissspad2-full", "spad512s", "spad512s-sparse"), FULL),
}
PHOTO = jl.datasets.photograph("camera")[100:140, 180:240]
SENSOR = jl.Sensor(frames=100, max_intensity=4.0, exposure_time=1e-5)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "capture.npy"
    jl.save(SENSOR.expose(PHOTO, rng=0), path)
    return path


@pytest.fixture(scope="module")
def moving():
    return moving_scene()


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
    if is_raw:
        [(images, _, _)] = reader.read(path, name)
    else:
        [(images, _, _)] = reader.get_reader(str(path))(str(path))
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


@pytest.mark.parametrize("name", ["a.bin", "a.RAW", "a.dat", "a.bin.gz"])
def test_raw_frames_without_a_format_say_where_to_choose_it(tmp_path, monkeypatch, name):
    monkeypatch.setitem(sys.modules, "napari", types.SimpleNamespace(current_viewer=lambda: None))
    for path in (tmp_path / "folder" / "a.bin", tmp_path / name):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(bytes(32768))
    for path in (tmp_path / "folder", tmp_path / name):
        with pytest.raises(ValueError, match=r"choose it in Plugins > jotlight > Open a capture"):
            reader.get_reader(str(path))(str(path))
    assert reader.get_reader(str(tmp_path / "missing.bin")) is None


def test_raw_frames_without_a_format_open_the_widget(tmp_path, monkeypatch):
    shown = []

    def dock(*names):
        return None, types.SimpleNamespace(show_path=lambda path: shown.append((*names, path)))

    viewer = types.SimpleNamespace(window=types.SimpleNamespace(add_plugin_dock_widget=dock))
    monkeypatch.setitem(sys.modules, "napari", types.SimpleNamespace(current_viewer=lambda: viewer))
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(32768))
    with pytest.raises(ValueError, match="does not identify its format"):
        reader.get_reader(str(path))(str(path))
    assert shown == [("jotlight", "Open a capture", path)]


def arrays_file(tmp_path, extension, **arrays):
    """Return the path of a file with several arrays."""
    path = tmp_path / f"capture{extension}"
    if extension == ".npz":
        np.savez(path, **arrays)
    elif extension == ".mat":
        pytest.importorskip("scipy.io").savemat(path, arrays)
    elif extension == ".nxs":
        with pytest.importorskip("h5py").File(path, "w") as file:
            for name, array in arrays.items():
                file[name] = array
    else:
        group = pytest.importorskip("zarr").open_group(path, mode="w")
        for name, array in arrays.items():
            group[name] = array
    return path


@pytest.mark.slow
@pytest.mark.parametrize("extension", [".npz", ".mat", ".nxs", ".zarr"])
def test_each_capture_of_a_file_with_several_becomes_a_layer(tmp_path, extension):
    dark, flat = (np.uint8(RNG.random((6, 8, 5)) < rate) for rate in (0.1, 0.7))
    path = arrays_file(tmp_path, extension, dark=dark, flat=flat, gain=np.full((6, 8), 0.5))
    with pytest.warns(jl.JotlightWarning, match="left out arrays that are no captures: gain"):
        layers = reader.get_reader(str(path))(str(path))
    assert [arguments["name"] for _, arguments, _ in layers] == [
        f"{path.name}: dark, mle",
        f"{path.name}: flat, mle",
    ]
    for key, (_, arguments, _) in zip(("dark", "flat"), layers, strict=True):
        viewed = arguments["metadata"][KEY].viewed
        total = viewed.data.sum() if hasattr(viewed.data, "sum") else viewed.data.counts(1)
        np.testing.assert_array_equal(total, opened_sum(path, key))
    [(_, arguments, _)] = reader.read(path, key="flat")
    assert arguments["name"] == f"{path.name}: flat, mle"


def opened_sum(path, key):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        opened = jl.open(path, key=key)
    return opened.counts(1) if isinstance(opened, jl.Bits) else opened


@pytest.mark.slow
def test_a_labeled_array_is_the_only_layer(tmp_path):
    pytest.importorskip("h5py")
    sensor = jl.Sensor(frames=3, dark_counts=np.full((6, 13), 0.01))
    jl.save(jl.Bits.from_array(RNG.random((3, 6, 13)) < 0.4, sensor), tmp_path / "a.h5")
    assert len(reader.read(tmp_path / "a.h5")) == 1


@pytest.mark.parametrize(
    ("arrays", "key", "message"),
    [
        ({"a": np.ones(3), "b": np.ones(4)}, None, "none of its arrays is a capture"),
        ({f"a{i}": np.ones((2, 2), int) for i in range(17)}, None, "Open a capture"),
        (
            {"a": np.ones((2, 2), int), "b": np.ones((2, 2), int)},
            "c",
            "to name one of its arrays: a, b; got 'c'",
        ),
    ],
)
def test_files_without_a_choice_are_refused(tmp_path, arrays, key, message):
    with pytest.raises(ValueError, match=message):
        reader.read(arrays_file(tmp_path, ".npz", **arrays), key=key)


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
    data, arguments, _ = make_layer(Viewed.from_data(bits), 8)
    assert data.shape == (2, 32, 40, 3)
    assert arguments["rgb"]
    assert 0 <= float(data.min()) <= float(data.max()) <= 1


def test_channels_that_are_no_colors_get_a_slider():
    bits = jl.Bits.from_array(RNG.random((16, 6, 8, 2)) < 0.4)
    data, arguments, _ = make_layer(Viewed.from_data(bits), 8)
    assert data.shape == (2, 2, 6, 8)
    assert "rgb" not in arguments
    expected = arguments["metadata"][KEY].image(1)[..., 1]
    np.testing.assert_array_equal(np.asarray(data[1, 1]), expected)


@pytest.mark.slow
def test_sample_data_are_simulated(moving):
    for [(data, arguments, _)], shape in ((static_scene(), (512, 512)), (moving, (256, 256))):
        assert data.shape == (4, *shape)
        bits = arguments["metadata"][KEY].viewed.data
        assert bits.shape == (256, *shape)


@pytest.mark.slow
def test_a_window_is_aligned(moving):
    [(_, arguments, _)] = moving
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


@pytest.mark.parametrize("is_labeled", [True, False])
def test_readings_of_several_bits_become_a_layer(tmp_path, is_labeled):
    readings = jl.Sensor(frames=20, bit_depth=4, gain=60.0).expose(PHOTO, rng=0)
    if is_labeled:
        jl.save(readings, tmp_path / "a.npy")
        [(data, arguments, _)] = reader.read(tmp_path / "a.npy")
    else:
        np.save(tmp_path / "a.npy", readings.to_array())
        [(data, arguments, _)] = reader.read(tmp_path / "a.npy", bit_depth=4)
        readings = jl.open(tmp_path / "a.npy", bit_depth=4)
    source = arguments["metadata"][KEY]
    shown = source.viewed.sensor(20).replace(max_intensity=estimated_range(source))
    assert (shown.max_intensity == 1) == is_labeled
    np.testing.assert_array_equal(np.asarray(data[0]), jl.mle(readings, shown))
    sums, _, _ = change_method(source, "counts", 10, 10)
    expected = readings.to_array()[10:].sum(axis=0) / 150
    np.testing.assert_allclose(np.asarray(sums[1]), expected, rtol=1e-6)


def estimated_range(source):
    from jotlight.view.estimate import choose

    return choose(source.viewed, source.window, "mle").max_intensity


def test_the_windows_of_a_bracket_are_whole_cycles():
    bits = jl.Sensor(frames=100, gain=np.resize([0.25, 1.0, 4.0], 100)).expose(PHOTO, rng=0)
    data, arguments, _ = make_layer(Viewed.from_data(bits))
    source = arguments["metadata"][KEY]
    assert (source.window, len(data)) == (63, 1)
    data, _, _ = change_method(source, "mle", 30, 15)
    np.testing.assert_array_equal(np.asarray(data[1]), jl.mle(bits[15:45]))
    for window, step, name in ((20, 3, "window"), (30, 10, "step")):
        with pytest.raises(ValueError, match=f"{name}: expected a multiple of 3, because"):
            change_method(source, "mle", window, step)


def test_layers_of_others_are_refused():
    with pytest.raises(ValueError, match="layer: expected one that jotlight made"):
        source_of(None)
