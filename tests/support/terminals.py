"""Commands whose output goes to a pseudo-terminal."""

import contextlib
import os
import subprocess
import sys


@contextlib.contextmanager
def on_a_terminal(folder, *arguments):
    """Start a command with a pseudo-terminal as stderr; yield the process and its output."""
    # A shell lets its background jobs ignore SIGINT, and these tests may be one.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    code += "from jotlight.cli.app import main; main()"
    leader, follower = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
        stdout=subprocess.DEVNULL,
        stderr=follower,
    ) as child:
        os.close(follower)
        try:
            yield child, read_terminal(leader)
        finally:
            child.kill()
            os.close(leader)


def read_terminal(leader):
    """Yield the whole output so far after each read, until the other end is closed."""
    text = b""
    # Reading from a pseudo-terminal fails when its other end is closed.
    with contextlib.suppress(OSError):
        while part := os.read(leader, 4096):
            text += part
            yield text.decode(errors="replace")
