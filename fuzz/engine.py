"""Fuzz the entry points of the engine's Rust crate with cargo-fuzz, which is based on libFuzzer.

    python fuzz/engine.py NAME|all [--runs N] [--output FILE] [--target-dir DIR]
    python fuzz/engine.py NAME --replay FILE

Each entry point is called with hostile arguments: sizes of 0 and near the maximum, NaN and other
extreme floats, shapes that do not match, and reversed or strided arrays. It must return a result or
an error. A panic, an overflow, an input that takes too long, or a result that depends on the memory
layout or on the number of threads is a finding. A finding ends the run of that entry point, and its
input is saved in fuzz/found. NAME is a name that `all` prints.

The program needs `cargo install cargo-fuzz`.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
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


def main() -> None:
    """Parse the command line, and fuzz entry points or replay a saved input."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--runs", type=int, default=1000, help="inputs per entry point")
    parser.add_argument("--output", type=Path, help="file to which results are appended as JSON")
    parser.add_argument("--target-dir", type=Path, help="folder of cargo's files")
    parser.add_argument("--replay", type=Path, help="a saved input to run again")
    options = parser.parse_args()
    if shutil.which("cargo-fuzz") is None:
        sys.exit("cargo-fuzz is not installed, so NOTHING was fuzzed: cargo install cargo-fuzz")
    program = build(options.target_dir or HERE / "engine" / "target")
    known = run(program, "", []).stdout.split()
    if options.name not in ["all", *known]:
        sys.exit(f"NAME: expected all or one of {', '.join(known)}, got {options.name}")
    if options.replay:
        result = run(program, options.name, [options.replay])
        sys.exit(f"{result.stderr}\nexit status {result.returncode}")
    names = known if options.name == "all" else [options.name]
    results = [fuzz(program, name, options.runs, options.output) for name in names]
    failed = [result["name"] for result in results if result["findings"]]
    print(f"{len(names) - len(failed)} of {len(names)} entry points without a finding", *failed)
    sys.exit(bool(failed))


def build(target: Path) -> Path:
    """Return the program that fuzzes, after building it with checks for overflows.

    The engine has no unsafe code of its own, so the program needs no sanitizer.
    """
    triple = call("rustc", "--print", "host-tuple").stdout.strip()
    folder = ["--fuzz-dir", HERE / "engine", "--target-dir", target, "--target", triple]
    call("cargo", "fuzz", "build", *folder, "--sanitizer", "none", "entry_point")
    return target / triple / "release" / "entry_point"


def call(*command: object) -> subprocess.CompletedProcess[str]:
    """Run a command, which must succeed. Its messages appear on the terminal."""
    return subprocess.run(  # noqa: S603
        [*map(str, command)], check=True, stdout=subprocess.PIPE, text=True, cwd=HERE.parent
    )


def run(program: Path, name: str, arguments: list[object]) -> subprocess.CompletedProcess[str]:
    """Run the program for an entry point, and return its status and its messages."""
    return subprocess.run(  # noqa: S603
        [program, *map(str, arguments)],
        env={**os.environ, "JOTLIGHT_ENTRY_POINT": name},
        capture_output=True,
        text=True,
        errors="replace",
    )


def fuzz(program: Path, name: str, runs: int, output: Path | None) -> dict[str, object]:
    """Fuzz an entry point, report and append the result, and return it."""
    FOUND.mkdir(exist_ok=True)
    arguments = [
        f"-runs={runs}",
        f"-max_len={MAX_INPUT_BYTES}",
        "-len_control=0",
        f"-timeout={SECONDS_PER_INPUT}",
        f"-rss_limit_mb={MAX_MIB}",
        f"-artifact_prefix={FOUND}/{name}-",
        "-print_final_stats=1",
    ]
    start = time.monotonic()
    process = run(program, name, arguments)
    seconds = time.monotonic() - start
    executed = re.search(r"stat::number_of_executed_units: (\d+)", process.stderr)
    result = {
        "part": "engine",
        "name": name,
        "inputs": int(executed[1]) if executed else 0,
        "seconds": round(seconds, 1),
        "findings": int(process.returncode != 0),
    }
    print(f"{name}: {result['inputs']} inputs in {seconds:.1f} s, {result['findings']} findings")
    if process.returncode:
        print(process.stderr[-3000:])
    if output is not None:
        with output.open("a") as file:
            print(json.dumps(result), file=file)
    return result


if __name__ == "__main__":
    main()
