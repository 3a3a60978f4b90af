"""Processes that are killed at random moments, and before each change to the output folder.

After each kill the old output is intact or the new one is complete, and no other visible file has
changed. Then the same command runs to its end, and no temporary file remains.
"""

import random
import shutil
import signal
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from damage.commands import COMMANDS, Command
from damage.outputs import CHECKPOINT, Content, read_outputs
from damage.processes import run, start
from damage.record import Row, report
from damage.workplace import Expected, Workplace

SEED = 20
FRAMES = 256
QUICK_STRIDE = 5
"""A quick run kills only before every 5th change."""

BETWEEN = "some files of the output are old, and some are new"
"""The finding after a kill between the renames of two files, which no system can do at once."""

SHARES = {
    "simulate": 14,
    "convert": 46,
    "reconstruct": 8,
    "film": 4,
    "train": 12,
    "fine-tune": 6,
    "reproduce": 10,
}
"""Number of kills of each command. They add up to 100."""


def measure(*, quick: bool = False, only: str = "") -> list[Row]:
    """Return two rows for each command: its kills at random moments, and before each change.

    Parameters
    ----------
    quick : bool
        Whether to kill only one command, a few times.
    only : str
        Part of the names of the commands to kill; "" selects all.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        place = Workplace.make(Path(folder, "work"), 8 if quick else FRAMES)
        for number, (each, kills) in enumerate(_plan(quick)):
            if only not in each.name:
                continue
            if not each.is_available:
                rows.append(_row(each, 0, [f"{each.needs} is not installed"]))
                continue
            expected = Expected.of(each, place, Path(folder, f"before-{number}"))
            rows.append(kill_at_random(each, place, expected, kills))
            if not each.resumes:
                rows.append(kill_at_changes(each, place, expected, QUICK_STRIDE if quick else 1))
            shutil.rmtree(expected.before)
    return rows


def _plan(quick: bool) -> list[tuple[Command, int]]:
    """Return the commands, and how many kills each gets."""
    plan = []
    for word, share in SHARES.items():
        found = [
            each for each in COMMANDS if each.arguments[0] == word and "figure" not in each.name
        ]
        if word == "reconstruct":  # A few kinds of its output represent all of them.
            found = [each for each in found if "png" in each.name or "maps" in each.name]
        if quick:
            found = found[:1] if word == "simulate" else []
            share = 2
        for index, each in enumerate(found):
            kills = len(range(index, share, len(found)))
            if kills:
                plan.append((each, kills))
    return plan


def _row(command: Command, kills: int, violations: Sequence[str], **more: int | float) -> Row:
    row = {"part": "kills", "name": command.name, "kills": kills, **more}
    row["violations"] = list(violations)
    report(f"{command.name}: {kills} kills, {len(row['violations'])} violations")
    for violation in row["violations"]:
        report(f"  {violation}")
    return row


def kill_at_random(command: Command, place: Workplace, expected: Expected, kills: int) -> Row:
    """Return the row of kills at moments that are uniform over the duration of a command."""
    rng = random.Random(f"{SEED} {command.name}")
    duration = _duration(command, place, expected)
    done, intact, violations = 0, 0, []
    while done < kills:
        place.reset(expected.before)
        launcher, arguments = command.launch()
        process = start(arguments, place.folder, place.scratch, launcher)
        moment = rng.uniform(0, duration)
        time.sleep(moment)
        process.kill()
        process.communicate()
        if process.returncode != -signal.SIGKILL:
            continue  # It ended before, so this was no kill.
        done += 1
        state, found = _check(command, place, expected)
        intact += state == "old"
        violations += [f"killed after {moment:.3f} s: {text}" for text in found]
    return _row(command, kills, violations, seconds=round(duration, 2), old=intact)


def kill_at_changes(command: Command, place: Workplace, expected: Expected, stride: int = 1) -> Row:
    """Return the row of kills right before every `stride`-th change to the output folder."""
    killer = str(Path(__file__).with_name("killed.py"))
    place.reset(expected.before)
    done = run(command.arguments, place.folder, place.scratch, [killer, "-1"])
    steps = int(done.stdout.split()[-1])
    chosen = range(steps - 1, -1, -stride)
    intact, between, violations = 0, 0, []
    for step in chosen:
        place.reset(expected.before)
        done = run(command.arguments, place.folder, place.scratch, [killer, str(step)])
        if done.returncode != -signal.SIGKILL:
            violations.append(f"step {step}: ended with status {done.returncode}")
            continue
        state, found = _check(command, place, expected)
        intact += state == "old"
        if found[:1] == [BETWEEN]:
            between += 1
            del found[0]
        violations += [f"killed before change {step} of {steps}: {text}" for text in found]
    row = _row(command, len(chosen), violations, old=intact, between=between)
    return {**row, "part": "kills at changes"}


def _duration(command: Command, place: Workplace, expected: Expected) -> float:
    """Return the duration of the faster of two runs, because the first one may fill caches."""
    seconds = []
    for _ in range(2):
        place.reset(expected.before)
        launcher, arguments = command.launch()
        begin = time.perf_counter()
        run(arguments, place.folder, place.scratch, launcher)
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


def _check(command: Command, place: Workplace, expected: Expected) -> tuple[str, list[str]]:
    """Return whether the output is the old or the new one, and what is wrong after a kill."""
    try:
        found = read_outputs(place.out)
    except Exception as error:  # any type: the readers of outputs do not expect damage
        return "", [f"an output is damaged: {error}"]
    rest = {name: digest for name, digest in found.items() if not name.endswith(CHECKPOINT)}
    # Experiments continue by themselves, while training asks for an option.
    resume = ["--resume"] * (len(rest) < len(found) and not command.resumes)
    state = _state(command, rest, expected)
    violations = [] if state else [_difference(rest, expected)]
    violations += place.damage()
    if state == "new" and not command.replaces and not command.resumes:
        shutil.rmtree(place.out)  # It is complete, and the command would refuse to replace it.
        place.out.mkdir()
    launcher, arguments = command.launch()
    again = run(arguments + resume, place.folder, place.scratch, launcher)
    if again.returncode:
        return state, [*violations, f"the next run failed: {again.stderr.strip()}"]
    if read_outputs(place.out) != expected.new:
        violations.append("the next run wrote another output")
    return state, violations + [f"remains: {name}" for name in place.leftovers()]


def _state(command: Command, found: Content, expected: Expected) -> str:
    """Return "old" or "new" for an intact output, or ""."""
    if found == expected.old:
        return "old"
    if found == expected.new:
        return "new"
    # A run that can be resumed leaves some of the files, which are complete.
    parts = command.resumes and found.items() <= expected.new.items()
    return "old" if parts else ""


def _difference(found: Content, expected: Expected) -> str:
    """Return what is wrong with an output that is neither the old nor the new one."""
    damaged = [
        name
        for name in sorted({*found, *expected.old, *expected.new})
        if found.get(name) not in (expected.old.get(name), expected.new.get(name))
    ]
    return f"damaged: {', '.join(damaged)}" if damaged else BETWEEN
