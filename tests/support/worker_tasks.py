"""Tasks for workers, which cannot import the modules of tests."""

from pathlib import Path

from jotlight.runs.reporting import naming_worker


@naming_worker()
def read_file(path: Path) -> bytes:
    return path.read_bytes()
