"""The cluster of a run: a running scheduler, or workers on this machine."""

import contextlib
import gc
import logging
import signal
import threading
from collections.abc import Iterator
from multiprocessing import resource_tracker
from typing import Any

from jotlight._engine import __version__
from jotlight.errors import import_extra
from jotlight.interrupts import hold_signals

_TIMEOUT = "10s"
"""Time after which a scheduler that does not answer is reported."""

_MAX_DEATHS = 20
"""Number of workers that may die while they compute a unit, before its capture fails."""


_WATCH_SECONDS = 2.0
"""Seconds between two checks of the number of workers."""

_KEPT_BYTES = 1 << 26
"""Number of free bytes that the allocator of a worker keeps for the next images."""


def import_distributed() -> Any:
    """Return the library distributed."""
    return import_extra("distributed", "dask", "clusters")


@contextlib.contextmanager
def connected(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """Yield a ``dask.distributed.Client`` for a scheduler, or for workers on this machine.

    Parameters
    ----------
    scheduler : str or None
        Address of a running scheduler, such as ``tcp://10.0.0.1:8786``.
    workers : int or None
        Number of worker processes, of one thread each, on this machine.

    Raises
    ------
    MissingExtraError
        When dask is not installed.
    OSError
        When nothing listens at the address, or a worker ends while it starts.
    ValueError
        When a worker has another version of jotlight, or the number of workers is below 1.
    """
    distributed = import_distributed()
    if scheduler is not None:
        with _client(distributed, scheduler) as client:
            check_workers(client)
            yield client
        return
    if workers is None or workers < 1:
        raise ValueError(f"workers: expected 1 or more, got {workers}")
    with _local_cluster(distributed, workers) as client:
        check_workers(client)
        yield client


@contextlib.contextmanager
def _local_cluster(distributed: Any, workers: int) -> Iterator[Any]:
    """Yield a client for workers on this machine."""
    import dask

    settings = {
        "distributed.scheduler.allowed-failures": _MAX_DEATHS,
        "distributed.worker.preload": ["jotlight.runs.preload"],
        # The profile interrupts each worker a hundred times per second, and ticks interrupt each
        # process fifty times.
        "distributed.worker.profile.enabled": False,
        "distributed.admin.tick.interval": "1s",
        # By default, dask's workers return memory to the system after each image, and get it again.
        "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": _KEPT_BYTES,
        "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": _KEPT_BYTES // 4,
    }
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with dask.config.set(settings), contextlib.ExitStack() as stack:
        # If the process ended at once, Python would report the semaphores of its workers as lost.
        stack.callback(gc.collect)
        # A cluster that is half started, or half closed, could not be closed.
        with hold_signals(), _ctrl_c_kept_from_children():
            cluster = stack.enter_context(_start(distributed, workers))
        client = stack.enter_context(distributed.Client(cluster))
        stack.enter_context(_replaced(cluster, workers))
        try:
            yield client
        finally:
            with hold_signals():
                stack.close()


def _start(distributed: Any, workers: int) -> Any:
    """Return a cluster of workers on this machine.

    Raises
    ------
    OSError
        When a worker ends while it starts.
    """
    try:
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        )
    except RuntimeError as error:
        raise OSError(
            f"workers: one of {workers} ended while it started, for example because the system "
            "killed it when memory was short; repeat the command, or use fewer workers"
        ) from error


@contextlib.contextmanager
def _ctrl_c_kept_from_children() -> Iterator[None]:
    """Start processes to which Ctrl-C means nothing, also later from the threads of the block.

    A terminal sends Ctrl-C to all processes of a command. The command ends its workers.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where the preload ignores it
        yield
        return
    resource_tracker.ensure_running()  # which lets the signal through again in Python 3.11
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _replaced(cluster: Any, workers: int) -> Iterator[None]:
    """Replace workers that dask gives up while the block runs.

    dask starts a worker again that dies, but not one that dies while it starts.
    """
    stopped = threading.Event()
    ended = ("closed", "failed")

    def replace() -> None:
        for name, nanny in list(cluster.workers.items()):
            if nanny.status.name in ended:
                del cluster.workers[name]
        cluster.scale(workers)

    def watch() -> None:
        while not stopped.wait(_WATCH_SECONDS):
            if len(cluster.scheduler.workers) < workers:
                cluster.loop.add_callback(replace)

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


def _client(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=_TIMEOUT)
    except (OSError, ValueError) as error:
        raise OSError(
            f"scheduler: no scheduler of dask answers at {address}; check the address, and start "
            "one with `dask scheduler`"
        ) from error


def check_workers(client: Any) -> None:
    """Raise ValueError unless each worker can run this version of jotlight.

    Raises
    ------
    ValueError
        When there is no worker, a worker has no jotlight or another version, or its dask is not
        compatible.
    """
    if not client.nthreads():
        try:
            client.wait_for_workers(1, timeout=_TIMEOUT)
        except TimeoutError as error:
            raise ValueError(
                "scheduler: has no workers; start some with `dask worker ADDRESS`"
            ) from error
    found = client.run(_installed, on_error="return")
    answers = {
        address: each if isinstance(each, tuple) else ("none that can be imported", [])
        for address, each in found.items()
    }
    others = {
        address: version for address, (version, _) in answers.items() if version != __version__
    }
    if others:
        address, version = next(iter(others.items()))
        raise ValueError(
            f"workers: expected jotlight {__version__} on all {len(found)}, but {len(others)} have "
            f"another one, such as {version} on {address}; install the same version everywhere"
        )
    incomplete = {address: missing for address, (_, missing) in answers.items() if missing}
    if incomplete:
        address, missing = next(iter(incomplete.items()))
        raise ValueError(
            f"workers: expected the packages of jotlight[dask] on all {len(found)}, but "
            f"{len(incomplete)} have not all of them; {', '.join(missing)} cannot be imported on "
            f"{address}; pip install 'jotlight[dask]' there"
        )


def _installed() -> tuple[str, list[str]]:
    """Return the version of jotlight, and the packages of units that cannot be imported."""
    # Imported here, so that a worker without jotlight reports that it is missing.
    import importlib

    from jotlight._engine import __version__

    missing = []
    for name in ("fsspec", "google_crc32c", "isal", "zarr"):
        try:
            importlib.import_module(name)
        except ImportError as error:
            missing.append(f"{name} ({error})")
    return __version__, missing


def check_version(version: str) -> None:
    """Raise RuntimeError in a worker with another version of jotlight than the caller's."""
    if version != __version__:
        raise RuntimeError(
            f"expected jotlight {version} on each worker, got {__version__}; install the same "
            "version on all machines"
        )
