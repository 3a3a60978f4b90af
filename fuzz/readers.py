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
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path

from campaign import HERE, Result, libfuzzer_options, parse_options, run_targets

MIN_INPUT_BYTES = 2048
"""Half of the maximum length of inputs. Readers with a longer example use its length instead."""
MEMORY = Path("/dev/shm")  # noqa: S108
"""Folder whose files are in memory, if the system has it. It holds the inputs, because writing them
to a disk would take most of the time."""

sys.path.append(str(HERE.parent / "tests" / "support"))

from examples import READERS, Reader, read_or_refused  # noqa: E402


@dataclasses.dataclass
class ReaderResult(Result):
    """What was measured while one reader was fuzzed: a row of the results."""

    library_crashes: int = 0
    """Number of crashes of C libraries that become errors in a child process."""

    def __str__(self) -> str:
        return f"{super().__str__()}, {self.library_crashes} crashes of libraries"


def main() -> None:
    """Parse the command line, and fuzz readers or replay saved inputs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", choices=["all", *READERS], metavar="NAME")
    parser.add_argument("--corpus", type=Path, help="folder that keeps the inputs for later runs")
    parser.add_argument("--isolated", action="store_true", help="replay in a child process")
    options = parse_options(parser, "reader")
    if options.replay:
        for file in options.replay:
            replay(READERS[options.name], file, options.isolated)
        return
    if find_spec("atheris") is None:
        sys.exit("atheris is not installed, so NOTHING was fuzzed: pip install 'atheris>=3'")
    names = list(READERS) if options.name == "all" else [options.name]
    run_targets("readers", names, lambda name: fuzz(name, options), options, {})


def replay(reader: Reader, file: Path, isolated: bool = False) -> None:
    """Read a saved input again, without catching unexpected exceptions."""
    with tempfile.TemporaryDirectory() as folder:
        path, damaged, _ = reader.example(Path(folder))
        damaged.write_bytes(reader.wrap(file.read_bytes()))
        read = reader.read_isolated if isolated and reader.read_isolated else reader.read
        result = read_or_refused(read, path)
    print(f"{file}: {'refused' if result is None else 'read'}")


def fuzz(name: str, options: argparse.Namespace) -> ReaderResult:
    """Return the result of fuzzing one reader in processes of its own."""
    result = ReaderResult(name)
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as temporary:
        folder = Path(temporary)
        longest = write_seeds(READERS[name], folder)
        kept = (options.corpus or folder / "corpus") / name
        kept.mkdir(parents=True, exist_ok=True)
        command = [
            *(sys.executable, str(HERE / "one_reader.py"), name, str(kept), str(folder / "seeds")),
            f"-max_len={2 * longest}",
        ]
        begin = time.monotonic()
        while True:
            done = subprocess.run(  # noqa: S603
                [*command, *libfuzzer_options(result, options)],
                env={**os.environ, "TMPDIR": temporary},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
            )
            result.add_statistics(done.stdout)
            if done.returncode == 0:
                break
            if not is_library_crash(name, done.stdout):
                result.add_finding(done.stdout)
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
    """Return whether an input crashed a library, and a child process refuses it."""
    artifacts = re.findall(r"Test unit written to (\S+)", output)
    if READERS[name].read_isolated is None or "Python exception" in output or not artifacts:
        return False
    command = [sys.executable, __file__, name, "--isolated", "--replay", artifacts[-1]]
    done = subprocess.run(command, capture_output=True, text=True)  # noqa: S603
    if done.returncode:
        return False
    Path(artifacts[-1]).unlink()
    return True


if __name__ == "__main__":
    main()
