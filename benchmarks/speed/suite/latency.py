"""Elapsed time of fresh processes."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import jotlight as jl
from suite.machine import cores
from suite.tasks.scene import bits
from suite.timing import Effort, race

HELP, RECONSTRUCT, NUMPY = "jotlight --help", "jotlight reconstruct", "Python, import numpy"


def measure(effort: Effort) -> dict[str, list[float]]:
    """Return the seconds of each process. The first run reads the disk and is not counted."""
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
                *("-o", str(Path(folder) / "estimate.npy")),
            ],
        }
        # Modules are compiled to bytecode first, as in an installed package.
        changes = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(Path(folder) / "pyc")}
        runs = {
            name: lambda _, arguments=arguments: subprocess.run(
                [sys.executable, *arguments],
                check=True,
                capture_output=True,
                env={**os.environ, **changes},
            )
            for name, arguments in commands.items()
        }
        all_cores = cores()
        return race(runs, [all_cores], effort)[str(all_cores)]
