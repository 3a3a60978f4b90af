"""Fuzz the file readers with atheris, a coverage-guided fuzzer that is based on libFuzzer.

    python fuzz/readers.py NAME|all [--seconds N] [--corpus DIR]
    python fuzz/readers.py NAME --replay FILE...

A reader reads a file, or refuses it with a ValueError or OSError that names the file. Any other
exception, a crash, or an input that takes too much time or memory is a finding. A finding ends the
run of that reader, and its input is saved in fuzz/found. NAME is a key of READERS in
tests/support/examples.
"""

import argparse
import os
import subprocess
import sys
import tempfile
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

sys.path.insert(0, str(HERE.parent / "tests" / "support"))

from examples import READERS, Reader, read_or_refused  # noqa: E402


def main() -> None:
    """Parse the command line, and fuzz readers or replay saved inputs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", choices=["all", *READERS], metavar="NAME")
    parser.add_argument("--seconds", type=int, default=60, help="seconds per reader (default 60)")
    parser.add_argument("--corpus", type=Path, help="folder that keeps the inputs for later runs")
    parser.add_argument("--replay", type=Path, nargs="+", help="saved inputs to read again")
    options = parser.parse_args()
    if options.replay:
        for file in options.replay:
            replay(READERS[options.name], file)
        return
    if find_spec("atheris") is None:
        sys.exit("atheris is not installed, so NOTHING was fuzzed: pip install 'atheris>=3'")
    names = list(READERS) if options.name == "all" else [options.name]
    failed = [name for name in names if fuzz(name, options.seconds, options.corpus)]
    print(f"{len(names) - len(failed)} of {len(names)} readers without a finding", *failed)
    sys.exit(bool(failed))


def replay(reader: Reader, file: Path) -> None:
    """Read a saved input again, without catching unexpected exceptions."""
    with tempfile.TemporaryDirectory() as folder:
        path, damaged, _ = reader.example(Path(folder))
        damaged.write_bytes(reader.wrap(file.read_bytes()))
        result = read_or_refused(reader.read, path)
    print(f"{file}: {'refused' if result is None else 'read'}")


def fuzz(name: str, seconds: int, corpus: Path | None) -> int:
    """Return the exit status of fuzzing one reader in a new process; 0 means no finding."""
    print(f"== {name}", flush=True)
    FOUND.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        seeds = folder / "seeds"
        seeds.mkdir()
        longest = MIN_INPUT_BYTES
        for number in range(len(READERS[name].makers)):
            inner = folder / str(number)
            inner.mkdir()
            content = READERS[name].example(inner, number)[2]
            (seeds / str(number)).write_bytes(content)
            longest = max(longest, len(content))
        kept = (corpus or folder / "corpus") / name
        kept.mkdir(parents=True, exist_ok=True)
        command = [
            *(sys.executable, str(HERE / "one_reader.py"), name, str(kept), str(seeds)),
            f"-max_total_time={seconds}",
            f"-max_len={2 * longest}",
            f"-timeout={SECONDS_PER_INPUT}",
            f"-rss_limit_mb={MAX_MIB}",
            f"-artifact_prefix={FOUND}/{name}-",
            "-print_final_stats=1",
        ]
        return _run(command, {**os.environ, "TMPDIR": temporary})


def _run(command: list[str], environment: dict[str, str]) -> int:
    """Return the exit status of libFuzzer. Print its output without the lines of progress."""
    with subprocess.Popen(  # noqa: S603
        command, env=environment, stderr=subprocess.PIPE, text=True, errors="replace"
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if not line.startswith(("#", "INFO: Instrumenting")) or "DONE" in line:
                print(line, end="", flush=True)
    return process.returncode


if __name__ == "__main__":
    main()
