"""Downloads from a local server. No test here needs a network."""

import functools
import hashlib
import http.server
import importlib
import io
import tarfile
import threading
import unittest

import numpy as np
import pytest
from PIL import Image

from jotlight import JotlightWarning, datasets
from jotlight.datasets import cifar10_files, fetch

# The names in the package are those of the functions.
bsds300 = importlib.import_module("jotlight.datasets.bsds300")
cifar10 = importlib.import_module("jotlight.datasets.cifar10")


class Server(http.server.ThreadingHTTPServer):
    asked: list[str]


class Handler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass

    def do_GET(self):
        self.server.asked.append(self.path)
        if "stops-halfway" in self.path:
            self.send_response(200)
            self.send_header("Content-Length", "1000")
            self.end_headers()
            self.wfile.write(bytes(500))
        else:
            super().do_GET()


@pytest.fixture
def site(tmp_path):
    """A folder that a local server serves."""
    folder = tmp_path / "site"
    folder.mkdir()
    return folder


@pytest.fixture
def server(site):
    with Server(("127.0.0.1", 0), functools.partial(Handler, directory=site)) as server:
        server.asked = []
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def url(server):
    return f"http://127.0.0.1:{server.server_port}"


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch):
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.setenv(name, "127.0.0.1")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache that replaces the user's own folder."""
    monkeypatch.setattr(fetch, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def files_in(folder):
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def source(site, url, *names, sha256=None):
    found = {
        name: sha256 or hashlib.sha256((site / name).read_bytes()).hexdigest() for name in names
    }
    return fetch.RemoteFiles(
        name="Some data",
        site=url,
        urls={name: f"{url}/{name}" for name in names},
        hashes=found,
        hashes_in="here",
        size=2_500_000,
        cite="Somebody, 1999",
    )


def test_a_download_is_announced_and_stored(site, url, server, cache):
    (site / "some.bin").write_bytes(bytes(200_000))
    some, shares = source(site, url, "some.bin"), []
    no_logs = unittest.TestCase().assertNoLogs(level="INFO")
    with pytest.warns(JotlightWarning) as caught, no_logs:
        assert fetch.fetch(some, ["some.bin"], shares.append) == cache
    assert (cache / "some.bin").read_bytes() == bytes(200_000)
    message = str(caught.pop().message)
    for part in (url, "1 file, about 2.5 MB", "SHA-256: here", "no license stated", "Somebody"):
        assert part in message
    assert str(cache) in message
    assert shares == sorted(shares)
    assert len(shares) > 3
    assert shares[-1] == 1
    # The second call neither warns nor asks the server.
    fetch.fetch(some, ["some.bin"])
    assert server.asked == ["/some.bin"]


def test_a_damaged_file_is_fetched_again(site, url, cache):
    (site / "some.bin").write_bytes(b"right")
    cache.mkdir()
    (cache / "some.bin").write_bytes(b"wrong")
    with pytest.warns(JotlightWarning, match="fetching Some data"):
        fetch.fetch(source(site, url, "some.bin"), ["some.bin"])
    assert (cache / "some.bin").read_bytes() == b"right"


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
class TestFailure:
    def test_another_file_than_expected_is_not_kept(self, site, url, cache):
        (site / "some.bin").write_bytes(b"another")
        some = source(site, url, "some.bin", sha256="0" * 64)
        with pytest.raises(
            ValueError, match=r"some\.bin with the SHA-256 0{64}, but got another"
        ) as e:
            fetch.fetch(some, ["some.bin"])
        assert "--data DIR" in str(e.value)
        assert not files_in(cache)

    def test_a_file_that_is_not_there_is_named(self, site, url, cache):
        some = source(site, url, "none.bin", sha256="0" * 64)
        with pytest.raises(ConnectionError, match=rf"fetch {url}/none.bin \(.* 404 .*\); try"):
            fetch.fetch(some, ["none.bin"])
        assert not files_in(cache)

    def test_a_server_that_is_down_is_reported_in_one_line(self, site, cache):
        some = source(site, "http://127.0.0.1:9", "some.bin", sha256="0" * 64)
        with pytest.raises(ConnectionError) as error:
            fetch.fetch(some, ["some.bin"])
        message = str(error.value)
        assert message.startswith("Some data: could not fetch http://127.0.0.1:9/some.bin (")
        assert "refused" in message
        assert "folder= in Python, --data DIR on the command line" in message
        assert len(message) < 250
        assert not files_in(cache)

    def test_a_connection_that_breaks_leaves_nothing(self, site, url, cache):
        some = source(site, url, "stops-halfway", sha256="0" * 64)
        with pytest.raises(
            ConnectionError, match=r"stops-halfway \(IncompleteRead\(500 bytes .*; try"
        ):
            fetch.fetch(some, ["stops-halfway"])
        assert not files_in(cache)

    def test_an_interruption_leaves_what_is_whole_and_continues_from_there(
        self, site, url, server, cache
    ):
        names = ["a.bin", "b.bin"]
        for name in names:
            (site / name).write_bytes(bytes(200_000))
        some = source(site, url, *names)

        def interrupt(share):
            if share > 0.6:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            fetch.fetch(some, names, interrupt)
        assert files_in(cache) == ["a.bin"]
        fetch.fetch(some, names)
        assert files_in(cache) == names
        assert server.asked == ["/a.bin", "/b.bin", "/b.bin"]

    def test_a_folder_that_cannot_be_made_is_named(self, site, url, cache):
        (site / "some.bin").write_bytes(b"right")
        cache.write_bytes(b"a file where the folder would be")
        with pytest.raises(OSError, match=r"cannot write .*some\.bin: .*exists; free some space"):
            fetch.fetch(source(site, url, "some.bin"), ["some.bin"])


def test_bsds300_is_fetched_as_bsds500_has_it(site, url, server, tmp_path, monkeypatch):
    lines = []
    for split, number in (("train", 1), ("val", 1), ("val", 2), ("val", 3)):
        path = site / split / f"{number}.jpg"
        path.parent.mkdir(exist_ok=True)
        Image.new("RGB", (8, 8), (50 * number,) * 3).save(path)
        name = f"{'test' if split == 'val' else 'train'}/{path.name}"
        lines.append(f"{name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n")
    (tmp_path / "registry.txt").write_text("".join(lines))
    monkeypatch.setattr(bsds300, "SITE", url)
    monkeypatch.setattr(bsds300, "REGISTRY", tmp_path / "registry.txt")
    shares = []
    with pytest.warns(JotlightWarning, match=r"BSDS300: 2 files, .*registry\.txt; terms"):
        names, images = datasets.bsds300("test", first=2, progress=shares.append)
    assert names == ["1.jpg", "2.jpg"]
    assert [round(float(image.mean() * 255)) for image in images] == [50, 100]
    assert server.asked == ["/val/1.jpg", "/val/2.jpg"]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    with pytest.warns(JotlightWarning, match="BSDS300: 1 file, "):
        assert len(datasets.bsds300("test")[0]) == 3
    with pytest.warns(JotlightWarning, match="BSDS300: 1 file, "):
        assert datasets.bsds300("train")[0] == ["1.jpg"]
    assert datasets.bsds300("test", first=1)[0] == ["1.jpg"]


def test_cifar10_is_fetched_as_an_archive_and_stays_one(site, url, server, cache, monkeypatch):
    path = site / cifar10_files.ARCHIVE
    with tarfile.open(path, "w:gz") as archive:
        member = tarfile.TarInfo("cifar-10-batches-bin/test_batch.bin")
        content = b"\x07" + b"\xff" * 3072
        member.size = 2 * len(content)
        archive.addfile(member, io.BytesIO(2 * content))
    monkeypatch.setattr(cifar10, "SITE", url)
    monkeypatch.setattr(cifar10, "SHA256", hashlib.sha256(path.read_bytes()).hexdigest())
    shares = []
    with pytest.warns(JotlightWarning, match=r"CIFAR-10: 1 file, about 170 MB, from .*\.tar\.gz"):
        images = datasets.cifar10("test", progress=shares.append)
    np.testing.assert_array_equal(images, np.ones((2, 32, 32)))
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert datasets.cifar10("test", first=1).shape == (1, 32, 32)
    assert files_in(cache) == [cifar10_files.ARCHIVE]
    assert server.asked == [f"/{cifar10_files.ARCHIVE}"]


def test_the_user_s_own_cache_is_the_default(monkeypatch):
    import pooch

    monkeypatch.undo()
    assert fetch.cache_folder() == pooch.os_cache("jotlight")
