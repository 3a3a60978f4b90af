"""Wall time of fresh processes."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import jotlight as jl
from suite.machine import cores
from suite.paths.scene import bits
from suite.timing import Effort, race

HELP, RECONSTRUCT, NUMPY = "jotlight --help", "jotlight reconstruct", "Python, import numpy"


def measure(effort: Effort) -> dict[str, list[float]]:
    """Seconds of each process; the first of each has to read the disk and is not counted."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "bits.npy"
        jl.save(bits(), file)
        commands = {
            "Python, nothing else": ["-c", "pass"],
            NUMPY: ["-c", "import numpy"],
            "Python, import jotlight": ["-c", "import jotlight"],
            HELP: ["-m", "jotlight", "--help"],
            RECONSTRUCT: [
                *("-m", "jotlight", "reconstruct", str(file)),
                *("-o", str(Path(folder) / "picture.npy")),
            ],
        }
        # As in an installed package, whose modules are compiled already.
        changes = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(Path(folder) / "pyc")}
        runs = {
            name: lambda _, words=words: subprocess.run(
                [sys.executable, *words],
                check=True,
                capture_output=True,
                env={**os.environ, **changes},
            )
            for name, words in commands.items()
        }
        all_cores = cores()
        return race(runs, [all_cores], effort)[str(all_cores)]
