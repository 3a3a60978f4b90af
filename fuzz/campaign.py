"""What both parts of the fuzzing campaign share: options, limits, and results.

``fuzz/readers.py`` and ``fuzz/engine.py`` run programs that are based on libFuzzer. Each program
fuzzes one target, which is a reader or an entry point of the engine.
"""

import argparse
import dataclasses
import re
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
FOUND = HERE / "found"
"""Folder of the inputs that caused a finding."""
SECONDS_PER_INPUT = 10
"""Maximum time in seconds that one input may take."""
MAX_MIB = 2048
"""Maximum memory in MiB of the process that fuzzes."""

sys.path.append(str(HERE.parent / "tools" / "robustness"))

from damage.record import add_row, facts  # noqa: E402


@dataclasses.dataclass
class Result:
    """What was measured while one target was fuzzed: a row of the results."""

    name: str
    inputs: int = 0
    """Number of inputs that the target was tested with."""
    seconds: float = 0.0
    findings: int = 0
    """Number of findings: 0, or 1 because a finding ends the run of a target."""
    branches: int = 0
    """Number of branches that the inputs reached. atheris also counts comparisons."""

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.inputs} inputs in {self.seconds:.0f} s, {self.branches} branches, "
            f"{self.findings} findings"
        )

    def add_statistics(self, output: str) -> None:
        """Add the numbers of inputs and branches at the end of libFuzzer's output."""
        self.inputs += last_number(r"stat::number_of_executed_units: (\d+)", output)
        self.branches = last_number(r" cov: (\d+)", output) or self.branches

    def add_finding(self, output: str) -> None:
        """Count a finding, and print what libFuzzer says about it."""
        self.findings += 1
        print(f"== {self.name}", interesting_lines(output), sep="\n", flush=True)


def parse_options(parser: argparse.ArgumentParser, target: str) -> argparse.Namespace:
    """Return the options, after adding those that both parts share to the parser."""
    parser.add_argument("--runs", type=int, help=f"inputs per {target}")
    parser.add_argument("--seconds", type=int, help=f"seconds per {target} (default 60)")
    parser.add_argument("--jobs", type=int, default=1, help=f"number of {target}s at a time")
    parser.add_argument("--output", type=Path, help="file to which results are added, as JSON")
    parser.add_argument("--replay", type=Path, nargs="+", help="saved inputs to try again")
    options = parser.parse_args()
    if options.runs is None and options.seconds is None:
        options.seconds = 60
    return options


def libfuzzer_options(result: Result, options: argparse.Namespace) -> list[str]:
    """Return libFuzzer's options for a target, for the inputs that remain."""
    words = [
        f"-timeout={SECONDS_PER_INPUT}",
        f"-rss_limit_mb={MAX_MIB}",
        f"-artifact_prefix={FOUND}/{result.name}-",
        "-print_final_stats=1",
    ]
    if options.runs is not None:
        words.append(f"-runs={options.runs - result.inputs}")
    if options.seconds is not None:
        words.append(f"-max_total_time={options.seconds}")
    return words


def run_targets(
    part: str,
    names: Sequence[str],
    fuzz: Callable[[str], Result],
    options: argparse.Namespace,
    own_facts: Mapping[str, Any],
) -> None:
    """Fuzz targets, add rows to the results, and exit with status 1 if there are findings.

    The last row is about the whole run, if it fuzzes all targets. ``own_facts`` replace some of its
    values.
    """
    FOUND.mkdir(exist_ok=True)
    # The commit is that of the beginning: it is what the programs are built from.
    run = {**facts(f"python fuzz/{part}.py {shlex.join(sys.argv[1:])}"), **own_facts, "of": part}
    findings, begin = 0, time.monotonic()
    with ThreadPoolExecutor(options.jobs) as pool:
        for result in pool.map(fuzz, names):
            print(result, flush=True)
            findings += result.findings
            if options.output:
                row = {"part": part, "commit": run["commit"], **dataclasses.asdict(result)}
                add_row(options.output, row)
    if options.output and options.name == "all":
        add_row(options.output, {**run, "seconds": time.monotonic() - begin})
    print(f"{part}: {len(names)} fuzzed, {findings} findings")
    sys.exit(bool(findings))


def last_number(pattern: str, output: str) -> int:
    """Return the last number that a pattern finds in libFuzzer's output, or 0."""
    numbers = re.findall(pattern, output)
    return int(numbers[-1]) if numbers else 0


def interesting_lines(output: str) -> str:
    """Return libFuzzer's output without the lines of progress."""
    progress = ("#", "\tNEW_FUNC", "INFO:", "WARNING: Failed to find function", "stat::")
    return "\n".join(line for line in output.splitlines() if not line.startswith(progress))
