"""A full disk for every writer: each command writes to a small disk with too little space.

The command ends with status 1 and one line that names the file and the reason. The old output stays
intact, and nothing is left behind.
"""

import errno
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from damage.commands import COMMANDS, Command
from damage.outputs import CHECKPOINT, read_outputs
from damage.processes import is_hidden, read_tree, run
from damage.record import Row, report
from damage.workplace import Expected, Workplace

FRAMES = 8
DISK_BYTES = 64 << 20
PAGE_BYTES = 4096
SHARES = (0.25, 0.5, 0.75)
"""Free space of the disk, as fractions of the size of the output."""

FILLER = "filler"
"""Name of the file that fills the disk."""

REASON = os.strerror(errno.ENOSPC)
NAMESPACE = "JOTLIGHT_ROBUSTNESS_NAMESPACE"
"""Environment variable that is set if the mounts of this process are its own."""

QUICK = ("convert to hdf5: .h5 of counts", "convert to visionsim", "reconstruct: .exr")
"""First words of the names of the commands that a quick run tests."""


def measure(*, quick: bool = False, only: str = "") -> list[Row]:
    """Return a row for each command that wrote to full disks.

    Raises
    ------
    RuntimeError
        When this system does not let the script make small disks.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        place = Workplace.make(Path(folder, "work"), FRAMES)
        for number, each in enumerate(COMMANDS):
            if only not in each.name or (quick and not each.name.startswith(QUICK)):
                continue
            if not each.is_available:
                violations, free, fits = [f"{each.needs} is not installed"], [], 0
            else:
                expected = Expected.of(each, place, Path(folder, f"before-{number}"))
                levels = list(_levels(place.out))
                levels = levels[:1] + levels[-1:] if quick else levels
                fits, violations = _fill(each, place, expected, levels)
                free = levels
            row = {"part": "disks", "name": each.name, "free": free, "fits": fits}
            rows.append({**row, "violations": violations})
            report(f"{each.name}: {len(free)} disks, {len(violations)} violations")
            for violation in violations:
                report(f"  {violation}")
    return rows


def enter_namespace() -> None:
    """Restart this program where its mounts are invisible to others and vanish with it."""
    if NAMESPACE in os.environ:
        return
    environment = {**os.environ, NAMESPACE: "1"}
    for options in (["--mount"], ["--user", "--map-root-user", "--mount"]):
        unshare = ["unshare", *options]
        if subprocess.run([*unshare, "true"], capture_output=True).returncode == 0:
            os.execvpe("unshare", [*unshare, sys.executable, *sys.argv], environment)
    raise RuntimeError("this system does not let the script make small disks with unshare")


def _levels(out: Path) -> Iterator[int]:
    """Yield the free bytes of disks that are too small for the output in a folder."""
    pages = sum(-(-path.stat().st_size // PAGE_BYTES) for path in out.rglob("*") if path.is_file())
    found = {0, 1, *(int(share * pages) for share in SHARES), pages - 1}
    yield from (PAGE_BYTES * level for level in sorted(found) if level < pages)


def _fill(
    command: Command, place: Workplace, expected: Expected, levels: list[int]
) -> tuple[int, list[str]]:
    """Return how often the output fit on the disk, and what was wrong."""
    fits, violations = 0, []
    for free in levels:
        shutil.rmtree(place.out, ignore_errors=True)
        place.out.mkdir()
        disk = ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "none", str(place.out)]
        subprocess.run(disk, check=True)
        try:
            found = _run_on_disk(command, place, expected, free)
        finally:
            subprocess.run(["umount", "--lazy", str(place.out)], check=True)
        if found is None:
            fits += 1
        else:
            violations += [f"{free} bytes free: {text}" for text in found]
    if fits == len(levels):
        violations.append("no disk was too small")
    return fits, violations


def _run_on_disk(
    command: Command, place: Workplace, expected: Expected, free: int
) -> list[str] | None:
    """Return what was wrong on a disk with little space, or None if the output fit."""
    shutil.copytree(expected.before, place.out, dirs_exist_ok=True)
    with (place.out / FILLER).open("wb") as file:
        space = os.statvfs(place.out)
        os.posix_fallocate(file.fileno(), 0, space.f_bavail * space.f_frsize - free)
    before = read_tree(place.out)
    launcher, arguments = command.launch()
    done = run(arguments, place.folder, place.scratch, launcher)
    (place.out / FILLER).unlink()
    before = {name: sha for name, sha in before.items() if name != FILLER}
    if done.returncode == 0:
        content = read_outputs(place.out)
        return None if content == expected.new else ["status 0, but the output is incomplete"]
    violations = check_message(command, done.returncode, done.stderr, expected)
    after = read_tree(place.out)
    if command.resumes:
        finished = read_outputs(place.out).items() <= expected.new.items()
        intact = finished and not any(map(is_hidden, after))
    else:
        intact = after == before
    if not intact:
        changed = sorted(
            name for name in {**before, **after} if before.get(name) != after.get(name)
        )
        violations.append(f"changed or left behind: {', '.join(changed)}")
    return violations + place.damage()


def check_message(command: Command, status: int, text: str, expected: Expected) -> list[str]:
    """Return what is wrong with the status and the message of a command whose disk is full."""
    violations = [] if status == 1 else [f"ended with status {status}"]
    lines = text.strip().splitlines()
    if command.shows_progress:
        lines = [line for line in lines[:-1] if "rror" in line] + lines[-1:]
    if len(lines) != 1:
        return [*violations, f"{len(lines)} lines, of which the last is: {''.join(lines[-1:])}"]
    names = [*expected.new, f"a{CHECKPOINT}"]
    if REASON not in lines[0]:
        violations.append(f"the message does not contain {REASON!r}: {lines[0]}")
    if not any(f"out/{name}" in lines[0] for name in names):
        violations.append(f"the message names no output: {lines[0]}")
    return violations
