"""Run jotlight, and kill its process right before one of its changes to the output folder.

    python killed.py NUMBER ARGUMENT...

NUMBER counts the changes, from 0 on. With NUMBER -1 nothing is killed, and the last line on stdout
is the number of changes. `kills` runs this script in the folder that contains `out`.
"""

import os
import signal
import sys
from pathlib import Path

CHANGES = {"open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.chmod", "os.link"}
"""Audit events that Python raises right before it changes a folder or opens a file."""


def main() -> None:
    """Install the hook and run jotlight."""
    last, out = int(sys.argv[1]), str(Path("out").resolve())
    pid, seen = os.getpid(), 0

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal seen
        if event not in CHANGES or not isinstance(arguments[0], str | os.PathLike):
            return
        if event == "open" and not int(arguments[2]) & (os.O_WRONLY | os.O_RDWR):  # type: ignore[call-overload]
            return
        if os.getpid() == pid and os.path.abspath(arguments[0]).startswith(out):  # noqa: PTH100
            if seen == last:
                os.kill(pid, signal.SIGKILL)
            seen += 1

    sys.addaudithook(hook)
    from jotlight.cli.app import main as jotlight

    sys.argv = ["jotlight", *sys.argv[2:]]
    try:
        jotlight()
    finally:
        if last < 0:
            print(f"\n{seen}")


if __name__ == "__main__":
    main()
