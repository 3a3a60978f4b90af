"""Reading HDF5 in a child process: crashes become errors, and no process is left behind."""

import concurrent.futures
import dataclasses
import gc
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_bits
from examples.captures import BITS_WITH_MAPS
from jotlight.formats.hdf5 import isolated
from jotlight.formats.hdf5.captures import list_data_sets
from jotlight.formats.hdf5.isolated import IsolatedLibrary
from jotlight.formats.hdf5.library import receive, send

pytestmark = pytest.mark.slow

h5py = pytest.importorskip("h5py")
needs_posix = pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")

COUNTS_3D = np.random.default_rng(0).integers(0, 300, (20, 6, 4), np.uint16)


def write_example(path):
    """Write an HDF5 file with one data set, `a`."""
    with h5py.File(path, "w") as file:
        file["a"] = COUNTS_3D
    return str(path)


def write_damaged_index(path, byte):
    """Write an HDF5 file with one changed byte in the index of its chunks, a B-tree."""
    with h5py.File(path, "w", libver="latest") as file:
        file.create_dataset("a", data=COUNTS_3D, chunks=(1, 6, 4), maxshape=(None, None, 4))
    content = bytearray(path.read_bytes())
    content[content.index(b"BTHD") + byte] ^= 2
    path.write_bytes(content)


def start(folder):
    """Return a library in a child process, and the data set of an example."""
    library = IsolatedLibrary()
    (data_set,) = library.list_data_sets(write_example(folder / "a.h5"), "jotlight")
    return library, data_set


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """Return what :func:`start` returns, for tests after which the child process still runs."""
    return start(tmp_path_factory.mktemp("started"))


def wait_for_end(process_id):
    """Wait until a process, which is not a child of this one, has ended."""
    for _ in range(6000):
        try:
            os.kill(process_id, 0)
        except ProcessLookupError:
            return
        time.sleep(0.01)
    raise AssertionError(f"process {process_id} has not ended")


def test_captures_are_the_same_in_a_child_process(tmp_path):
    jl.save(BITS_WITH_MAPS, tmp_path / "bits.h5")
    bits = jl.open(tmp_path / "bits.h5", isolate=True)
    np.testing.assert_array_equal(bits.to_array(), BITS_WITH_MAPS.to_array())
    assert bits.sensor == BITS_WITH_MAPS.sensor
    folder = tmp_path / "parts"
    folder.mkdir()
    for number in range(20):  # more than the files that stay open
        with h5py.File(folder / f"part_{number + 1}.mat", "w", userblock_size=512) as file:
            file["OUTPUT"] = np.full((2, 7, 6), number, ">i2")
    counts = jl.open(folder, counts=True, isolate=True, frames=slice(None))
    np.testing.assert_array_equal(counts, np.full((6, 7), 2 * sum(range(20))))


@pytest.mark.parametrize("byte", [5, 20])
def test_a_crash_of_the_library_is_an_error(tmp_path, byte):
    write_damaged_index(tmp_path / "a.h5", byte)
    with pytest.raises(ValueError, match=r"a\.h5: the HDF5 .*(crashed|damaged)"):
        jl.open(tmp_path / "a.h5", isolate=True)


@pytest.mark.parametrize("byte", [0, 5, 20, 34])
def test_what_crashes_the_library_is_called_a_crash(tmp_path, byte):
    # Later versions of the library may report the damage instead.
    path = tmp_path / "a.h5"
    write_damaged_index(path, byte)
    script = "import sys, jotlight; jotlight.open(sys.argv[1])"
    here = subprocess.run([sys.executable, "-c", script, path], capture_output=True, check=False)
    assert here.returncode != 0
    expected = "crashed while reading it" if here.returncode < 0 else "damaged"
    with pytest.raises(ValueError, match=rf"a\.h5: the HDF5 .*{expected}"):
        jl.open(path, isolate=True)


@needs_posix
@pytest.mark.parametrize(
    ("end", "message"),
    [
        (signal.SIGKILL, r"a\.h5: the HDF5 library crashed while reading it \(SIGKILL\)"),
        (
            getattr(signal, "SIGXCPU", 0),
            r"a\.h5: the HDF5 library computed for 60 s or more",
        ),
    ],
)
def test_every_call_fails_after_a_crash(tmp_path, end, message):
    library, data_set = start(tmp_path)
    os.kill(library.process_id, end)
    for _ in range(2):
        with pytest.raises(ValueError, match=message):
            library.read(data_set, 0, 20)
    with pytest.raises(ValueError, match=message):
        library.list_data_sets(data_set.path, "jotlight")
    assert library.process_id is None


@needs_posix
def test_the_child_process_ends_with_the_capture(tmp_path):
    library, data_set = start(tmp_path)
    process_id = library.process_id
    del library, data_set
    gc.collect()
    wait_for_end(process_id)


@needs_posix
def test_the_child_process_ends_with_its_parent(tmp_path):
    path = write_example(tmp_path / "a.h5")
    script = (
        "import os, sys; from jotlight.formats.hdf5.isolated import IsolatedLibrary\n"
        "library = IsolatedLibrary(); library.list_data_sets(sys.argv[1], 'jotlight')\n"
        "print(library.process_id, flush=True); os.kill(os.getpid(), 9)"
    )
    ended = subprocess.run([sys.executable, "-c", script, path], capture_output=True, check=False)
    wait_for_end(int(ended.stdout))


@needs_posix
def test_an_interrupt_ends_a_child_process_that_hangs(tmp_path):
    library, data_set = start(tmp_path)
    process_id = library.process_id
    os.kill(process_id, signal.SIGSTOP)
    previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            library.read(data_set, 0, 20)
    finally:
        signal.signal(signal.SIGALRM, previous)
    wait_for_end(process_id)
    np.testing.assert_array_equal(library.read(data_set, 2, 5), COUNTS_3D[2:5])


@needs_posix
def test_the_child_process_ignores_ctrl_c(started):
    library, data_set = started
    os.kill(library.process_id, signal.SIGINT)
    np.testing.assert_array_equal(library.read(data_set, 2, 5), COUNTS_3D[2:5])


def test_the_memory_and_the_time_of_the_child_process_are_limited(started):
    limits = Path("/proc/self/limits")
    if not limits.is_file():
        pytest.skip("only Linux shows the limits of a process")
    library, data_set = started
    library.read(data_set, 0, 20)
    text = Path(f"/proc/{library.process_id}/limits").read_text()
    soft = {line[:25].strip(): line[26:47].strip() for line in text.splitlines()}
    expected = (1 << 28) + 2 * COUNTS_3D.nbytes + 4 * data_set.chunk_bytes
    assert int(soft["Max data size"]) == expected
    assert 60 <= int(soft["Max cpu time"]) <= 70
    assert int(soft["Max core file size"]) == 0


def test_threads_share_a_child_process(started):
    library, data_set = started
    starts = [number % 19 for number in range(200)]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        parts = list(pool.map(lambda number: library.read(data_set, number, number + 2), starts))
    for number, part in zip(starts, parts, strict=True):
        np.testing.assert_array_equal(part, COUNTS_3D[number : number + 2])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
@pytest.mark.filterwarnings("ignore:This process")
def test_a_fork_starts_a_child_process_of_its_own(started):
    library, data_set = started
    process_id = os.fork()
    if process_id == 0:
        before = library.process_id
        right = (library.read(data_set, 2, 5) == COUNTS_3D[2:5]).all()
        library.close()
        os._exit(0 if right and before is None else 1)
    assert os.waitpid(process_id, 0)[1] == 0
    np.testing.assert_array_equal(library.read(data_set, 2, 5), COUNTS_3D[2:5])


def test_errors_of_the_child_process_keep_their_type(tmp_path, started):
    library, data_set = started
    with pytest.raises(FileNotFoundError):
        library.list_data_sets(str(tmp_path / "none.h5"), "jotlight")
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99))
    with pytest.raises(ValueError, match=r"a\.h5: the HDF5 file is damaged"):
        list_data_sets(tmp_path / "a.h5", library)
    np.testing.assert_array_equal(library.read(data_set, 2, 5), COUNTS_3D[2:5])


@pytest.mark.parametrize(
    "statement",
    [{"chunk_frames": -1}, {"chunk_frames": 1.5}, {"chunk_frames": None}, {"shape": [-1, 6, 4]}],
)
def test_what_the_child_process_states_about_a_data_set_is_checked(
    tmp_path, monkeypatch, statement
):
    library, data_set = start(tmp_path)
    stated = dataclasses.asdict(data_set) | statement
    monkeypatch.setattr(isolated, "receive", lambda stream: {"data_sets": [stated]})
    with pytest.raises(ValueError, match=r"expected data sets, got a shape and chunks of"):
        library.list_data_sets(data_set.path, "jotlight")


def test_messages_are_read_completely_or_not_at_all():
    stream = io.BytesIO()
    send(stream, {"name": "ü"}, memoryview(b"raw"))
    stream.seek(0)
    assert receive(stream) == {"name": "ü"}
    assert stream.read() == b"raw"
    for content in (b"", b"\1\0", b"\xff\xff\xff\xff", b"\x09\0\0\0{}", b"\2\0\0\0[]"):
        with pytest.raises(EOFError):
            receive(io.BytesIO(content))


@pytest.mark.parametrize("option", ["--isolate", "--no-isolate"])
def test_the_command_line_reads_with_and_without_a_child_process(tmp_path, run, option):
    jl.save(BITS_WITH_MAPS, tmp_path / "a.h5")
    code, printed = run("convert", "a.h5", "-o", "b.npy", option)
    assert code == 0, printed
    np.testing.assert_array_equal(jl.open(tmp_path / "b.npy").packed, BITS_WITH_MAPS.packed)


def test_the_command_line_survives_a_crash_by_default(tmp_path, run):
    write_damaged_index(tmp_path / "a.h5", 5)
    for command in (["info", "a.h5"], ["convert", "a.h5", "-o", "b.npz"]):
        code, printed = run(*command)
        assert code == 1
        assert "a.h5: the HDF5" in printed
        assert "Traceback" not in printed
    assert not (tmp_path / "b.npz").exists()


@pytest.mark.parametrize("program", ["/nowhere/python", None])
def test_a_child_process_that_cannot_start_does_not_blame_the_file(tmp_path, monkeypatch, program):
    jl.save(random_bits((2, 3, 8)), tmp_path / "a.h5")
    monkeypatch.setattr("sys.executable", program)
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ChildProcessError, match=r"a\.h5: cannot start .*--no-isolate"):
        jl.open(tmp_path / "a.h5", isolate=True)
