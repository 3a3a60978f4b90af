"""Files of networks: they load unchanged, and damaged ones are refused."""

import dataclasses
import json
import pickle

import numpy as np
import pytest
from safetensors.numpy import save

import jotlight as jl
from reference.networks import random_network

SPACE = jl.Sensor(oversampling=4)
TIED = jl.Network.initial(SPACE)
MAPPED = jl.Sensor(
    oversampling=2,
    frames=3,
    threshold=2,
    gain=7.0,
    dark_counts=np.linspace(0, 1, 48).reshape(6, 8),
    mask=np.eye(6, 8, dtype=bool),
    max_intensity=3.0,
)


@pytest.mark.parametrize("sensor", [jl.Sensor(oversampling=3, kernel="linear"), MAPPED], ids=repr)
@pytest.mark.parametrize("tied", [True, False])
def test_a_saved_network_loads_unchanged(tmp_path, sensor, tied):
    rng = np.random.default_rng(13)
    made = random_network(rng, sensor, [2, 3, 1], [(3, 4), (5, 1)], tied=tied)
    network = jl.Network(made.layers, sensor, {"steps": 7, "start": "σ", "costs": [1.5, None]})
    path = tmp_path / "model.safetensors"
    network.save(path)
    loaded = jl.Network.load(path)
    assert (loaded.sensor, loaded.history) == (sensor, network.history)
    for mine, theirs in zip(network.layers, loaded.layers, strict=True):
        np.testing.assert_array_equal(mine.filters, theirs.filters)
        np.testing.assert_array_equal(mine.coefficients, theirs.coefficients)
        assert (mine.start, mine.spacing) == (theirs.start, theirs.spacing)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_a_history_that_json_cannot_hold_leaves_the_old_file(tmp_path):
    path = tmp_path / "model.safetensors"
    TIED.save(path)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        jl.Network(TIED.layers, SPACE, {"array": np.ones(3)}).save(path)
    assert path.read_bytes() == before


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Header and body of a saved network, which the tests damage."""
    path = tmp_path_factory.mktemp("network") / "model.safetensors"
    TIED.save(path)
    content = path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    return json.loads(content[8 : 8 + length]), content[8 + length :]


def join(header, body):
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + body


def assert_refused(path, content, message):
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message) as caught:
        jl.Network.load(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("length", [0, 7, 8, 100, -4, -1])
def test_truncated_files_are_refused(tmp_path, parts, length):
    assert_refused(tmp_path / "net", join(*parts)[:length], "expected a safetensors file")


@pytest.mark.parametrize(
    "content",
    [b"\xff" * 64, pickle.dumps([1, 2]), b"\x93NUMPY\x01\x00", b"PK\x03\x04" + b"\0" * 99],
)
def test_files_of_another_kind_are_refused(tmp_path, content):
    assert_refused(tmp_path / "net", content, "expected a safetensors file")


def test_a_zip_archive_is_refused_with_the_call_that_saves_a_network(tmp_path):
    message = r"a zip archive, such as torch\.save writes; .* module\.to_network\(\)\.save\(path\)"
    assert_refused(tmp_path / "net.pt", b"PK\x03\x04" + bytes(100), message)


@pytest.mark.parametrize("metadata", [None, {"format": "pt"}])
def test_safetensors_files_of_other_programs_are_refused(tmp_path, metadata):
    content = save({"layers.0.filters": np.ones(3)}, metadata)
    assert_refused(tmp_path / "net", content, "a safetensors file of another kind")


DEEP = "[" * 100_000
TWO = '[{{"start": {0}, "spacing": {1}}}, {{"start": 0, "spacing": 1}}]'


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("layers", "[]"),
        ("layers", "null"),
        ("layers", "[1, 2]"),
        ("layers", '{"start": 1}'),
        ("layers", '[{"start": 0}, {"start": "a"}]'),
        ("layers", TWO.format('"a"', 1)),
        ("layers", TWO.format("null", 1)),
        ("layers", TWO.format("NaN", 1)),
        ("layers", TWO.format("1e999", 1)),
        ("layers", TWO.format("1" + "0" * 400, 1)),
        ("layers", TWO.format(0, -1)),
        ("layers", TWO.format(0, 1e-60)),
        ("layers", '[{"start": 0, "spacing": 1}]' * 2),
        ("layers", TWO.format(0, 1)[:-1] + ', {"start": 0, "spacing": 1}]'),
        ("layers", TWO.format(0, '1, "stride": 0')),
        ("layers", TWO.format(0, '1, "stride": 1e9')),
        ("layers", TWO.format(0, '1, "stride": 2')),
        ("layers", TWO.format(0, '1, "upsampling": "a"')),
        ("layers", TWO.format(0, '1, "input": 5')),
        ("layers", TWO.format(0, '1, "skip": [0]')),
        ("layers", TWO.format(0, '1, "trainable": "much"')),
        ("layers", TWO.format(0, '1, "filters": 1')),
        ("layers", TWO.format(0, '1, "color": 1')),
        ("layers", DEEP),
        ("trials_range", "[]"),
        ("trials_range", "[1]"),
        ("trials_range", "[0, 4]"),
        ("trials_range", "[9, 4]"),
        ("trials_range", "[1.5, 4]"),
        ("trials_range", '"ab"'),
        ("trials_range", "{"),
        ("sensor", "null"),
        ("sensor", "{"),
        ("sensor", '{"oversampling": 0}'),
        ("sensor", '{"oversampling": 1e400}'),
        ("sensor", '{"gain": "much"}'),
        ("sensor", '{"frames": [3]}'),
        ("sensor", '{"__class__": 3}'),
        ("sensor", DEEP),
        ("history", "[1]"),
        ("history", '"x"'),
        ("history", "{"),
        ("history", DEEP),
    ],
    ids=lambda text: text[:40],
)
def test_damaged_metadata_is_refused(tmp_path, parts, name, text):
    header, body = parts
    metadata = header["__metadata__"] | {name: text}
    content = join(header | {"__metadata__": metadata}, body)
    assert_refused(tmp_path / "net", content, "damaged network file")


@pytest.mark.parametrize("name", ["layers", "sensor", "trials_range", "history"])
def test_missing_metadata_is_refused(tmp_path, parts, name):
    header, body = parts
    metadata = {key: value for key, value in header["__metadata__"].items() if key != name}
    content = join(header | {"__metadata__": metadata}, body)
    assert_refused(tmp_path / "net", content, f"damaged network file: '{name}'")


@pytest.mark.parametrize("version", ["1", "2", "", None])
def test_other_versions_are_refused(tmp_path, parts, version):
    header, body = parts
    metadata = {key: value for key, value in header["__metadata__"].items() if key != "version"}
    if version is not None:
        metadata["version"] = version
    content = join(header | {"__metadata__": metadata}, body)
    assert_refused(tmp_path / "net", content, "expected format version 3")


GOOD = {
    "layers.0.filters": np.ones((1, 1, 1, 1), np.float32),
    "layers.0.coefficients": np.ones((1, 150), np.float32),
    "layers.1.filters": np.ones((1, 1, 15, 15), np.float32),
    "layers.1.coefficients": np.ones((1, 150), np.float32),
}


@pytest.mark.parametrize(
    ("name", "tensor"),
    [
        ("layers.0.filters", None),
        ("layers.1.coefficients", None),
        ("layers.0.filters", np.ones((1, 1, 3, 3), np.float32)),
        ("layers.1.filters", np.ones((1, 2, 15, 15), np.float32)),
        ("layers.1.filters", np.ones((2, 1, 15, 15), np.float32)),
        ("layers.1.filters", np.ones((15, 15), np.float32)),
        ("layers.1.filters", np.ones((1, 1, 0, 15), np.float32)),
        ("layers.1.filters", np.full((1, 1, 15, 15), np.nan, np.float32)),
        ("layers.1.filters", np.full((1, 1, 15, 15), 1e300)),
        ("layers.1.filters", np.ones((1, 1, 15, 15), np.int32)),
        ("layers.1.coefficients", np.ones((1, 3), np.float32)),
        ("layers.1.coefficients", np.full((1, 150), np.inf, np.float32)),
        ("sensor.mask", np.ones((4, 4), np.float32)),
        ("sensor.mask", np.ones(4, bool)),
        ("sensor.dark_counts", np.full((4, 4), -1, np.float32)),
        ("sensor.color", np.ones((4, 4), np.float32)),
        ("sensor.gain", np.ones((4, 4), np.float32)),
    ],
)
def test_tensors_that_are_missing_or_do_not_fit_are_refused(tmp_path, parts, name, tensor):
    tensors = GOOD | {name: tensor}
    if tensor is None:
        del tensors[name]
    content = save(tensors, parts[0]["__metadata__"])
    assert_refused(tmp_path / "net", content, "damaged network file")


def test_the_undamaged_files_of_these_tests_are_networks(tmp_path, parts):
    for content in join(*parts), save(GOOD, parts[0]["__metadata__"]):
        (tmp_path / "net").write_bytes(content)
        assert jl.Network.load(tmp_path / "net").sensor == SPACE


@pytest.mark.parametrize(("kind", "size"), [("BF16", 2), ("F8_E4M3", 1)])
def test_tensors_of_types_unknown_to_numpy_are_refused(tmp_path, parts, kind, size):
    header, offset = {"__metadata__": parts[0]["__metadata__"]}, 0
    for name, tensor in GOOD.items():
        end = offset + size * tensor.size
        header[name] = {"dtype": kind, "shape": tensor.shape, "data_offsets": [offset, end]}
        offset = end
    assert_refused(tmp_path / "net", join(header, bytes(offset)), "expected a safetensors file")


def test_half_precision_is_accepted(tmp_path, parts):
    half = {name: tensor.astype(np.float16) for name, tensor in GOOD.items()}
    (tmp_path / "net").write_bytes(save(half, parts[0]["__metadata__"]))
    assert jl.Network.load(tmp_path / "net").layers[0].filters.dtype == np.float32


def test_a_missing_file_is_named(tmp_path):
    for path in tmp_path, tmp_path / "missing.safetensors":
        with pytest.raises(FileNotFoundError, match="there is no network file"):
            jl.Network.load(path)


def test_files_of_equal_networks_have_equal_bytes(tmp_path):
    network = jl.Network.initial(jl.Sensor(oversampling=3, mask=np.eye(6, dtype=bool)))
    written = set()
    for number in range(8):
        path = tmp_path / f"{number}.safetensors"
        network.save(path)
        written.add(path.read_bytes())
        network = jl.Network.load(path)
    assert len(written) == 1


def test_numbers_that_float16_holds_are_stored_in_it(tmp_path):
    network = jl.Network.conditional("small", rng=0)
    rounded = jl.Network(
        [
            dataclasses.replace(layer, filters=layer.filters.astype(np.float16).astype(np.float32))
            for layer in network.layers
        ],
        network.sensor,
        trials_range=network.trials_range,
    )
    sizes = []
    for name, each in (("whole", network), ("rounded", rounded)):
        path = tmp_path / f"{name}.safetensors"
        each.save(path)
        again = jl.Network.load(path)
        for layer, expected in zip(again.layers, each.layers, strict=True):
            assert layer.filters.dtype == np.float32
            np.testing.assert_array_equal(layer.filters, expected.filters)
            np.testing.assert_array_equal(layer.coefficients, expected.coefficients)
        sizes.append(path.stat().st_size)
    assert sizes[1] < 0.7 * sizes[0]


def test_an_onnx_model_is_named_as_one(tmp_path):
    path = tmp_path / "own.onnx"
    with pytest.raises(FileNotFoundError):
        jl.Network.load(path)
    path.write_bytes(b"\x08\x08\x12\x08jotlight")
    message = r"own\.onnx: this is an ONNX model, .* onnxruntime\.InferenceSession\('own\.onnx'\); "
    with pytest.raises(ValueError, match=message):
        jl.Network.load(path)
