"""What the workers of a local cluster do when they start."""

import signal
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore Ctrl-C, which a terminal also sends to the command. The command ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
