"""Fuzz the entry points of the engine's Rust crate with cargo-fuzz, which is based on libFuzzer.

    python fuzz/engine.py NAME|all [--runs N | --seconds N] [--jobs N] [--output FILE]
    python fuzz/engine.py NAME --replay FILE...

Each entry point is called with hostile arguments: sizes of 0 and near the maximum, NaN and other
extreme floats, shapes that do not match, and reversed or strided arrays. It must return a result or
an error. A panic, an overflow, an input that takes too much time or memory, or a result that
depends on the memory layout or on the number of threads is a finding. A finding ends the run of
that entry point, and its input is saved in fuzz/found. NAME is a name that `all` prints.

The program needs `cargo install cargo-fuzz`.
"""

import argparse
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from campaign import (
    HERE,
    Result,
    interesting_lines,
    libfuzzer_options,
    parse_options,
    run_targets,
)

MAX_INPUT_BYTES = 96
"""Maximum length of inputs. They hold sizes and choices; a generator fills the arrays."""


def main() -> None:
    """Parse the command line, and fuzz entry points or replay saved inputs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--target-dir", type=Path, help="folder of cargo's files")
    options = parse_options(parser, "entry point")
    if shutil.which("cargo-fuzz") is None:
        sys.exit("cargo-fuzz is not installed, so NOTHING was fuzzed: cargo install cargo-fuzz")
    program = build(options.target_dir or HERE / "engine" / "target")
    known = run(program, "").stdout.split()
    if options.name not in ["all", *known]:
        sys.exit(f"NAME: expected all or one of {', '.join(known)}, got {options.name}")
    if options.replay:
        done = run(program, options.name, *options.replay)
        print(interesting_lines(done.stderr))
        sys.exit(done.returncode)
    names = known if options.name == "all" else [options.name]
    # The engine uses none of the Python libraries.
    software = {"rustc": call("rustc", "--version").split()[1]}
    run_targets(
        "engine", names, lambda name: fuzz(program, name, options), options, {"libraries": software}
    )


def build(target: Path) -> Path:
    """Return the program that fuzzes, after building it with checks for overflows.

    The engine has no unsafe code of its own but the instructions of AMX, whose lengths are checked
    (decision 52), so the program needs no sanitizer.
    """
    triple = call("rustc", "--print", "host-tuple").strip()
    folders = ["--fuzz-dir", HERE / "engine", "--target-dir", target, "--target", triple]
    call("cargo", "fuzz", "build", *folders, "--sanitizer", "none", "entry_point")
    return target / triple / "release" / "entry_point"


def call(*command: object) -> str:
    """Run a command, which must succeed, and return its output. Its messages are shown."""
    return subprocess.run(  # noqa: S603
        [*map(str, command)], check=True, stdout=subprocess.PIPE, text=True, cwd=HERE.parent
    ).stdout


def run(program: Path, name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run the program for an entry point, and return its status, output, and messages."""
    return subprocess.run(  # noqa: S603
        [program, *map(str, arguments)],
        env={**os.environ, "JOTLIGHT_ENTRY_POINT": name},
        capture_output=True,
        text=True,
        errors="replace",
    )


def fuzz(program: Path, name: str, options: argparse.Namespace) -> Result:
    """Return the result of fuzzing one entry point in a process of its own."""
    result = Result(name)
    lengths = [f"-max_len={MAX_INPUT_BYTES}", "-len_control=0"]
    begin = time.monotonic()
    done = run(program, name, *lengths, *libfuzzer_options(result, options))
    result.seconds = time.monotonic() - begin
    result.add_statistics(done.stderr)
    if done.returncode:
        result.add_finding(done.stderr)
    return result


if __name__ == "__main__":
    main()
