"""Fuzz the entry points of the engine's Rust crate with cargo-fuzz, which is based on libFuzzer.

    python fuzz/engine.py NAME|all [--runs N] [--jobs N] [--output FILE] [--target-dir DIR]
    python fuzz/engine.py NAME --replay FILE

Each entry point is called with hostile arguments: sizes of 0 and near the maximum, NaN and other
extreme floats, shapes that do not match, and reversed or strided arrays. It must return a result or
an error. A panic, an overflow, an input that takes too long, or a result that depends on the memory
layout or on the number of threads is a finding. A finding ends the run of that entry point, and its
input is saved in fuzz/found. NAME is a name that `all` prints.

The program needs `cargo install cargo-fuzz`.
"""

import argparse
import dataclasses
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
FOUND = HERE / "found"
"""Folder of the inputs that caused a finding."""
SECONDS_PER_INPUT = 10
"""Maximum time in seconds that one input may take."""
MAX_MIB = 2048
"""Maximum memory in MiB of the process that fuzzes."""
MAX_INPUT_BYTES = 96
"""Maximum length of inputs. They hold sizes and choices; a generator fills the arrays."""

sys.path.insert(0, str(HERE.parent / "tools" / "robustness"))

from damage.record import add_row, facts  # noqa: E402


@dataclasses.dataclass
class Result:
    """What fuzzing one entry point did."""

    name: str
    inputs: int
    seconds: float
    findings: int
    branches: int
    """Number of branches and comparisons that were reached."""

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.inputs} inputs in {self.seconds:.0f} s, {self.branches} branches, "
            f"{self.findings} findings"
        )


def main() -> None:
    """Parse the command line, and fuzz entry points or replay a saved input."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--runs", type=int, default=1000, help="inputs per entry point")
    parser.add_argument("--jobs", type=int, default=1, help="entry points at a time")
    parser.add_argument("--output", type=Path, help="file to which results are added, as JSON")
    parser.add_argument("--target-dir", type=Path, help="folder of cargo's files")
    parser.add_argument("--replay", type=Path, help="a saved input to run again")
    options = parser.parse_args()
    if shutil.which("cargo-fuzz") is None:
        sys.exit("cargo-fuzz is not installed, so NOTHING was fuzzed: cargo install cargo-fuzz")
    program = build(options.target_dir or HERE / "engine" / "target")
    known = run(program, "").stdout.split()
    if options.name not in ["all", *known]:
        sys.exit(f"NAME: expected all or one of {', '.join(known)}, got {options.name}")
    if options.replay:
        result = run(program, options.name, options.replay)
        sys.exit(f"{result.stderr}\nexit status {result.returncode}")
    names = known if options.name == "all" else [options.name]
    FOUND.mkdir(exist_ok=True)
    findings, begin = 0, time.monotonic()
    with ThreadPoolExecutor(options.jobs) as pool:
        for result in pool.map(lambda name: fuzz(program, name, options.runs), names):
            print(result, flush=True)
            findings += result.findings
            if options.output:
                add_row(options.output, {"part": "engine", **dataclasses.asdict(result)})
    if options.output and options.name == "all":
        run_facts = facts(f"python fuzz/engine.py {shlex.join(sys.argv[1:])}")
        add_row(options.output, {**run_facts, "of": "engine", "seconds": time.monotonic() - begin})
    print(f"{len(names)} entry points, {findings} findings")
    sys.exit(bool(findings))


def build(target: Path) -> Path:
    """Return the program that fuzzes, after building it with checks for overflows.

    The engine has no unsafe code of its own, so the program needs no sanitizer.
    """
    triple = call("rustc", "--print", "host-tuple").stdout.strip()
    folders = ["--fuzz-dir", HERE / "engine", "--target-dir", target, "--target", triple]
    call("cargo", "fuzz", "build", *folders, "--sanitizer", "none", "entry_point")
    return target / triple / "release" / "entry_point"


def call(*command: object) -> subprocess.CompletedProcess[str]:
    """Run a command, which must succeed. Its messages appear on the terminal."""
    return subprocess.run(  # noqa: S603
        [*map(str, command)], check=True, stdout=subprocess.PIPE, text=True, cwd=HERE.parent
    )


def run(program: Path, name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the program for an entry point, and return its status and its messages."""
    return subprocess.run(  # noqa: S603
        [program, *map(str, arguments)],
        env={**os.environ, "JOTLIGHT_ENTRY_POINT": name},
        capture_output=True,
        text=True,
        errors="replace",
    )


def fuzz(program: Path, name: str, runs: int) -> Result:
    """Return the result of fuzzing one entry point in a process of its own."""
    begin = time.monotonic()
    done = run(
        program,
        name,
        f"-runs={runs}",
        f"-max_len={MAX_INPUT_BYTES}",
        "-len_control=0",
        f"-timeout={SECONDS_PER_INPUT}",
        f"-rss_limit_mb={MAX_MIB}",
        f"-artifact_prefix={FOUND}/{name}-",
        "-print_final_stats=1",
    )
    if done.returncode:
        reason = re.search(r"panicked at .*\n.*|ERROR: libFuzzer: .*", done.stderr)
        artifact = re.search(r"Test unit written to .*", done.stderr)
        print(name, *(match[0] for match in (reason, artifact) if match), file=sys.stderr)
    inputs = re.findall(r"^#(\d+)|number_of_executed_units: (\d+)", done.stderr, re.MULTILINE)
    covered = re.findall(r" cov: (\d+)", done.stderr)
    return Result(
        name,
        inputs=max((int(a or b) for a, b in inputs), default=0),
        seconds=time.monotonic() - begin,
        findings=int(done.returncode != 0),
        branches=int(covered[-1]) if covered else 0,
    )


if __name__ == "__main__":
    main()
