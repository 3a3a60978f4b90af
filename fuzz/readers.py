"""Fuzz the file readers with atheris, a coverage-guided fuzzer that is based on libFuzzer.

    python fuzz/readers.py NAME|all [--runs N | --seconds N] [--jobs N] [--output FILE]
    python fuzz/readers.py NAME --replay FILE...

A reader reads a file, or refuses it with a ValueError or OSError that names the file. Any other
exception, a crash, or an input that takes too much time or memory is a finding. A finding ends the
run of that reader, and its input is saved in fuzz/found. NAME is a key of READERS in
tests/support/examples.

A C library may crash where a child process can read the file instead. Such a crash is no finding if
the child process refuses the file with an error: the run then continues.
"""

import argparse
import dataclasses
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
FOUND = HERE / "found"
"""Folder of the inputs that caused a finding."""
SECONDS_PER_INPUT = 10
"""Maximum time in seconds that reading one input may take."""
MAX_MIB = 2048
"""Maximum memory in MiB of the process that fuzzes."""
MIN_INPUT_BYTES = 2048
"""Half of the maximum length of inputs. Readers with a longer example use its length instead."""
MEMORY = Path("/dev/shm")  # noqa: S108
"""Folder in memory, where there is one. Writing to a disk would take most of the time."""

sys.path += [str(HERE.parent / "tests" / "support"), str(HERE.parent / "tools" / "robustness")]

from damage.record import add_row, facts  # noqa: E402
from examples import READERS, Reader, read_or_refused  # noqa: E402


@dataclasses.dataclass
class Result:
    """What fuzzing one reader did."""

    name: str
    inputs: int = 0
    seconds: float = 0.0
    findings: int = 0
    library_crashes: int = 0
    """Number of crashes of C libraries that become errors in a child process."""
    branches: int = 0
    """Number of branches and comparisons that were reached."""

    def __str__(self) -> str:
        return (
            f"{self.name}: {self.inputs} inputs in {self.seconds:.0f} s, {self.branches} branches, "
            f"{self.findings} findings, {self.library_crashes} crashes of libraries"
        )


def main() -> None:
    """Parse the command line, and fuzz readers or replay saved inputs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", choices=["all", *READERS], metavar="NAME")
    parser.add_argument("--runs", type=int, help="inputs per reader")
    parser.add_argument("--seconds", type=int, help="seconds per reader (default 60)")
    parser.add_argument("--jobs", type=int, default=1, help="readers at a time")
    parser.add_argument("--output", type=Path, help="file to which results are added, as JSON")
    parser.add_argument("--corpus", type=Path, help="folder that keeps the inputs for later runs")
    parser.add_argument("--replay", type=Path, nargs="+", help="saved inputs to read again")
    parser.add_argument("--isolated", action="store_true", help="replay in a child process")
    options = parser.parse_args()
    if options.replay:
        for file in options.replay:
            replay(READERS[options.name], file, options.isolated)
        return
    if find_spec("atheris") is None:
        sys.exit("atheris is not installed, so NOTHING was fuzzed: pip install 'atheris>=3'")
    if options.runs is None and options.seconds is None:
        options.seconds = 60
    names = list(READERS) if options.name == "all" else [options.name]
    FOUND.mkdir(exist_ok=True)
    findings, begin = 0, time.monotonic()
    with ThreadPoolExecutor(options.jobs) as pool:
        for result in pool.map(lambda name: fuzz(name, options), names):
            print(result, flush=True)
            findings += result.findings
            if options.output:
                add_row(options.output, {"part": "readers", **dataclasses.asdict(result)})
    if options.output and options.name == "all":
        run = facts(f"python fuzz/readers.py {shlex.join(sys.argv[1:])}")
        add_row(options.output, {**run, "of": "readers", "seconds": time.monotonic() - begin})
    print(f"{len(names)} readers, {findings} findings")
    sys.exit(bool(findings))


def replay(reader: Reader, file: Path, isolated: bool = False) -> None:
    """Read a saved input again, without catching unexpected exceptions."""
    with tempfile.TemporaryDirectory() as folder:
        path, damaged, _ = reader.example(Path(folder))
        damaged.write_bytes(reader.wrap(file.read_bytes()))
        read = reader.read_isolated if isolated and reader.read_isolated else reader.read
        result = read_or_refused(read, path)
    print(f"{file}: {'refused' if result is None else 'read'}")


def fuzz(name: str, options: argparse.Namespace) -> Result:
    """Return the result of fuzzing one reader in processes of its own."""
    result = Result(name)
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as temporary:
        folder = Path(temporary)
        longest = write_seeds(READERS[name], folder)
        kept = (options.corpus or folder / "corpus") / name
        kept.mkdir(parents=True, exist_ok=True)
        command = [
            *(sys.executable, str(HERE / "one_reader.py"), name, str(kept), str(folder / "seeds")),
            f"-max_len={2 * longest}",
            f"-timeout={SECONDS_PER_INPUT}",
            f"-rss_limit_mb={MAX_MIB}",
            f"-artifact_prefix={FOUND}/{name}-",
            "-print_final_stats=1",
        ]
        environment = {**os.environ, "TMPDIR": temporary}
        begin = time.monotonic()
        while True:
            limits = []
            if options.runs is not None:
                limits.append(f"-runs={options.runs - result.inputs}")
            if options.seconds is not None:
                limits.append(f"-max_total_time={options.seconds}")
            done = subprocess.run(  # noqa: S603
                [*command, *limits],
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            )
            result.inputs += last_number(r"stat::number_of_executed_units: (\d+)", done.stdout)
            result.branches = last_number(r"cov: (\d+)", done.stdout) or result.branches
            if done.returncode == 0:
                break
            if not is_library_crash(name, done.stdout):
                result.findings += 1
                print(f"== {name}", interesting_lines(done.stdout), sep="\n", flush=True)
                break
            result.library_crashes += 1
            if options.runs is None or result.inputs >= options.runs:
                break
        result.seconds = time.monotonic() - begin
    return result


def write_seeds(reader: Reader, folder: Path) -> int:
    """Write the examples of a reader as seeds, and return the length of the longest in bytes."""
    (folder / "seeds").mkdir()
    longest = MIN_INPUT_BYTES
    for number in range(len(reader.makers)):
        inner = folder / str(number)
        inner.mkdir()
        content = reader.example(inner, number)[2]
        (folder / "seeds" / str(number)).write_bytes(content)
        longest = max(longest, len(content))
    return longest


def is_library_crash(name: str, output: str) -> bool:
    """Return whether an input crashed a library, but is refused when a child process reads it."""
    artifacts = re.findall(r"Test unit written to (\S+)", output)
    if READERS[name].read_isolated is None or "Python exception" in output or not artifacts:
        return False
    command = [sys.executable, __file__, name, "--isolated", "--replay", artifacts[-1]]
    done = subprocess.run(command, capture_output=True, text=True)  # noqa: S603
    if done.returncode:
        return False
    Path(artifacts[-1]).unlink()
    return True


def last_number(pattern: str, output: str) -> int:
    """Return the last number that a pattern finds in libFuzzer's output, or 0."""
    numbers = re.findall(pattern, output)
    return int(numbers[-1]) if numbers else 0


def interesting_lines(output: str) -> str:
    """Return libFuzzer's output without the lines of progress."""
    lines = output.splitlines()
    return "\n".join(line for line in lines if not line.startswith(("#", "INFO:", "stat::")))


if __name__ == "__main__":
    main()
