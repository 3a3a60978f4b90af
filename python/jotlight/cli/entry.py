"""The entry point of the command, which Ctrl-C also ends while jotlight is still being imported."""

import io
import os
import signal
import sys


def main() -> None:
    """Run the command line of this process."""
    # A shell lets its background jobs ignore SIGINT, and they must keep ignoring it.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # An exception would print a traceback, or some import would take it for a missing package.
        signal.signal(signal.SIGINT, _end)
    # Printing must not fail where the encoding lacks a character, such as α in cp1252. It never
    # fails on the standard error.
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="replace")
    from jotlight.cli.app import main as run

    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


def _end(*_: object) -> None:
    """End the process, which has written nothing yet."""
    os.write(2, b"error: stopped\n")
    os._exit(130)
