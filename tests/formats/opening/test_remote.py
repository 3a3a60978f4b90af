import gc
import os
import pickle
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import ChangedFileError, SeveralArraysError, error_message
from jotlight.formats.files import remote_files
from jotlight.formats.opening.locations import expand, file_state, is_glob, is_url
from jotlight.formats.opening.remote import LocalCopy
from servers import http_server, s3_server

pytest.importorskip("fsspec")

# aiohttp and botocore issue warnings of their own.
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("remote")
    mask = np.zeros((32, 61), bool)
    mask[3, 5] = True
    rng = np.random.default_rng(0)
    frames = rng.random((3000, 32, 61)) < 0.3
    sensor = jl.Sensor(frames=3000, mask=mask)
    bits = jl.Bits.from_array(frames, sensor)
    jl.save(bits, folder / "capture.npy")
    jl.save(bits[:50], folder / "small.npy.gz")
    jl.save(bits[:50], folder / "array.zarr")
    raw = jl.Bits.from_array(rng.random((64, 256, 512)) < 0.3)
    jl.save(raw, folder / "raw.bin", format="swissspad2")
    return folder


@pytest.fixture
def server(folder):
    with http_server(folder) as server:
        yield server


def packed(bits):
    return np.asarray(bits.packed)


@pytest.mark.parametrize("name", ["capture.npy", "small.npy.gz"])
def test_captures_at_urls_are_those_of_files(folder, server, name):
    local, found = jl.open(folder / name), jl.open(f"{server.url}/{name}")
    assert found.shape == local.shape
    assert found.sensor == local.sensor
    assert found.provenance == local.provenance
    np.testing.assert_array_equal(packed(found), packed(local))


def test_errors_about_several_arrays_at_a_url_name_them(tmp_path):
    np.savez(tmp_path / "two.npz", dark=np.ones((4, 4), int), flat=np.ones((4, 4), int))
    with http_server(tmp_path) as server:
        url = f"{server.url}/two.npz"
        with pytest.raises(SeveralArraysError, match=f"^{url}: expected key=") as caught:
            jl.open(url)
    assert caught.value.names == ("dark", "flat")


def test_an_error_of_the_system_names_the_url(server):
    copy = LocalCopy(f"{server.url}/capture.npy")
    with pytest.raises(PermissionError) as caught, copy.named_in_errors():
        raise PermissionError(13, "Permission denied", str(copy.path))
    assert error_message(caught.value) == f"cannot access {copy.url}: Permission denied"


def test_only_the_frames_that_are_used_are_read(server):
    bits = jl.open(f"{server.url}/capture.npy")
    opened = sum(size or 0 for path, size in server.requests if path == "/capture.npy")
    assert opened <= 1 << 17
    server.requests.clear()
    bits[1000:1010].counts()
    assert [(path, size) for path, size in server.requests if size] == [
        ("/capture.npy", bits.packed[:10].nbytes)
    ]


def test_raw_frames_at_urls_are_read_in_ranges(folder, server):
    local = jl.open(folder / "raw.bin", format="swissspad2")
    found = jl.open(f"{server.url}/raw.bin", format="swissspad2")
    np.testing.assert_array_equal(packed(found), packed(local))
    assert all(size for path, size in server.requests if path == "/raw.bin" and size is not None)


def test_a_server_without_ranges_is_refused(folder):
    with http_server(folder, ranges=False) as server, pytest.raises(OSError, match=r"capture\.npy"):
        jl.open(f"{server.url}/capture.npy").counts()


def test_a_copy_of_the_bits_opens_the_url_again(server):
    bits = jl.open(f"{server.url}/capture.npy")
    data = pickle.dumps(bits)
    assert len(data) < 10_000
    np.testing.assert_array_equal(packed(pickle.loads(data)), packed(bits))


def test_lazy_arrays_read_ranges(folder, server):
    found = jl.dask.count(jl.open(f"{server.url}/capture.npy").to_dask("64KiB"), 100, width=61)
    local = jl.dask.count(jl.open(folder / "capture.npy"), 100)
    np.testing.assert_array_equal(found.compute(), local.compute())


def test_conversions_compare_checksums(server, tmp_path):
    bits = jl.open(f"{server.url}/capture.npy")
    jl.save(bits, tmp_path / "copy.npy")
    np.testing.assert_array_equal(packed(jl.open(tmp_path / "copy.npy")), packed(bits))


@pytest.mark.slow
def test_temporary_files_are_deleted_with_the_bits(server):
    of_others = set(remote_files._remote)  # other tests may have left some
    bits = jl.open(f"{server.url}/capture.npy")
    paths = set(remote_files._remote) - of_others
    assert {Path(path).name for path in paths} == {"capture.npy", "capture.mask.npy"}
    assert all(Path(path).exists() for path in paths)
    del bits
    gc.collect()
    assert not paths & set(remote_files._remote)
    assert not any(Path(path).exists() for path in paths)


def test_missing_files_and_servers(server):
    with pytest.raises(FileNotFoundError, match="there is no file http"):
        jl.open(f"{server.url}/missing.npy")
    with pytest.raises(OSError, match=r"http://127.0.0.1:9/a\.npy"):
        jl.open("http://127.0.0.1:9/a.npy")
    with pytest.raises(ValueError, match="cannot be opened"):
        jl.open("nosuch://host/a.npy")


@pytest.mark.parametrize(
    ("status", "error", "text"),
    [
        (401, PermissionError, "access was denied .* check the credentials"),
        (403, PermissionError, "access was denied .* check the credentials"),
        (404, FileNotFoundError, "there is no file http"),
        (500, OSError, r"a\.npy: cannot be read"),
    ],
)
def test_errors_of_web_servers(tmp_path, status, error, text):
    with http_server(tmp_path, status=status) as server, pytest.raises(OSError, match=text) as info:
        jl.open(f"{server.url}/a.npy")
    assert type(info.value) is error


@pytest.mark.parametrize(
    ("cause", "error", "message"),
    [
        (
            ModuleNotFoundError("No module named 's3fs'", name="s3fs"),
            jl.MissingExtraError,
            r"^s3://b/a\.npy: needs s3fs: pip install 'jotlight\[s3\]'$",
        ),
        (
            ModuleNotFoundError("No module named 'gcsfs'", name="gcsfs"),
            jl.MissingExtraError,
            r"^s3://b/a\.npy: needs the module gcsfs \(install it\)$",
        ),
        (
            ImportError("libs3.so.1: not found"),
            ImportError,
            r"^s3://b/a\.npy: an import failed \(libs3\.so\.1: not found\); repair",
        ),
    ],
)
def test_a_package_that_a_url_needs(monkeypatch, cause, error, message):
    def fail(url, **options):
        raise ImportError("install it") from cause

    monkeypatch.setattr("fsspec.core.url_to_fs", fail)
    with pytest.raises(ImportError, match=message) as info:
        jl.open("s3://b/a.npy")
    assert type(info.value) is error


def test_options_of_urls_are_refused_for_files(folder):
    with pytest.raises(ValueError, match="storage_options: are for URLs"):
        jl.open(folder / "capture.npy", storage_options={"anon": True})


def test_globs_open_many_captures(folder, tmp_path):
    for name in ("b", "a"):
        jl.save(jl.Bits.from_array(np.ones((2, 4, 8), bool)), tmp_path / f"{name}.npy")
    found = jl.open(f"{tmp_path}/*.npy")
    assert [bits.provenance.name for bits in found] == ["a.npy", "b.npy"]
    with pytest.raises(FileNotFoundError, match="matches nothing"):
        jl.open(f"{tmp_path}/*.bin")


@pytest.mark.parametrize(
    ("path", "url", "glob"),
    [
        ("s3://bucket/*.npy", True, True),
        ("s3://bucket/a.npy", True, False),
        ("simplecache::s3://bucket/a.npy", True, False),
        ("https://host/a.npy?x=1", True, False),
        ("captures/a?.npy", False, True),
        ("C:\\data\\a.npy", False, False),
    ],
)
def test_urls_and_globs_are_recognized(path, url, glob):
    assert (is_url(path), is_glob(path)) == (url, glob)


def test_a_file_at_a_url_that_changed_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((9000, 4, 8), np.uint8))
    with http_server(tmp_path) as server:
        data = pickle.dumps(jl.open(f"{server.url}/a.npy", counts=False))
        np.save(tmp_path / "a.npy", np.zeros((8000, 4, 8), np.uint8))
        with pytest.raises(ValueError, match="has changed"):
            pickle.loads(data)


def write_at_url(folder, kind, value):
    """Write a capture of bytes of one value, and return its URL."""
    import fsspec

    file = folder / "a.npy"
    np.save(file, np.full((64, 8, 8), value, np.uint8))
    url = file.as_uri() if kind == "file" else f"memory://{folder.name}/a.npy"
    fsspec.filesystem(kind).pipe(url, file.read_bytes())
    return url


@pytest.mark.parametrize("kind", ["file", "memory"])
@pytest.mark.parametrize("lazy", [False, True])
def test_data_that_are_replaced_at_a_url_are_errors(tmp_path, kind, lazy):
    bits = jl.open(write_at_url(tmp_path, kind, 0), counts=False)
    parts = bits.windows(32)
    assert next(parts).counts().max() == 0
    counts = jl.dask.count(bits, 32) if lazy else None
    write_at_url(tmp_path, kind, 255)
    with pytest.raises((OSError, ValueError), match=r"a\.npy: .*has changed since it was opened"):
        counts.compute(scheduler="sync") if lazy else next(parts).counts()


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_damage_that_is_found_when_frames_are_read_names_the_url(tmp_path, isolate):
    h5py = pytest.importorskip("h5py")
    jl.save(jl.Bits.from_array(np.ones((9, 8, 8), bool)), tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5") as file:
        place = file["bits"].id.get_chunk_info(0).byte_offset
    content = bytearray((tmp_path / "a.h5").read_bytes())
    content[place + 9] ^= 4  # in the compressed frames
    (tmp_path / "a.h5").write_bytes(content)
    url = (tmp_path / "a.h5").as_uri()
    with pytest.raises(ValueError, match=f"^{re.escape(url)}: the HDF5 file is damaged"):
        jl.open(url, isolate=isolate).counts()


def test_a_web_server_states_when_a_file_was_changed(tmp_path):
    name = tmp_path / "a.npy"
    np.save(name, np.zeros((64, 8, 8), np.uint8))
    with http_server(tmp_path) as server:
        parts = jl.open(f"{server.url}/a.npy", counts=False).windows(32)
        assert next(parts).counts().max() == 0
        os.utime(name, (7, 7))
        with pytest.raises(ChangedFileError, match=r"a\.npy: the file has changed since"):
            next(parts).counts()


@pytest.fixture(scope="module")
def bucket(folder):
    """Return the storage options of a bucket with the files of the folder."""
    pytest.importorskip("moto")
    s3fs = pytest.importorskip("s3fs")
    with s3_server() as endpoint, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options = {"key": "test", "secret": "test", "endpoint_url": endpoint}
        fs = s3fs.S3FileSystem(**options)
        fs.mkdir("bucket")
        fs.put(str(folder), "bucket/day", recursive=True)
        yield options


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["capture.npy", "small.npy.gz", "array.zarr"])
def test_captures_on_s3(folder, bucket, name):
    local = jl.open(folder / name)
    found = jl.open(f"s3://bucket/day/{name}", storage_options=bucket)
    assert found.sensor == local.sensor
    np.testing.assert_array_equal(packed(found), packed(local))
    np.testing.assert_array_equal(packed(pickle.loads(pickle.dumps(found))), packed(local))


@pytest.mark.exhaustive
def test_globs_on_s3(bucket):
    assert expand("s3://bucket/day/cap*.npy", bucket) == [
        "s3://bucket/day/capture.mask.npy",
        "s3://bucket/day/capture.npy",
    ]
    size, _ = file_state("s3://bucket/day/capture.npy", bucket)
    assert size == 3000 * 32 * 8 + 128


@pytest.mark.exhaustive
def test_a_run_over_a_glob_on_s3(run, tmp_path, bucket):
    options = [f"--storage-option={name}={value}" for name, value in bucket.items()]
    arguments = ["s3://bucket/day/capture.n*", "-o", tmp_path / "{name}.zarr", "--window", 1000]
    status, output = run("reconstruct", *arguments, "-m", "mle", *options)
    assert (status, "1 made" in output) == (0, True)


@pytest.mark.exhaustive
def test_credentials_that_fail(bucket, monkeypatch):
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/nonexistent")
    options = {"endpoint_url": bucket["endpoint_url"], "skip_instance_cache": True}
    with pytest.raises(PermissionError, match=r"access was denied .* check the credentials"):
        jl.open("s3://bucket/day/capture.npy", storage_options=options)
