"""Fuzz what reads files, guided by coverage, with atheris and its libFuzzer.

    python fuzz/readers.py FORMAT|all [--seconds N] [--corpus DIR]
    python fuzz/readers.py FORMAT --replay FILE...

A reader reads what it is given, or refuses it with a ValueError or OSError that names the file.
Another exception, a crash, or an input that takes too much time or memory ends the run of its
format and is saved in fuzz/found. The formats are READERS in tests/support/examples.py.
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
SECONDS_PER_INPUT = 10
MOST_MIB = 2048

sys.path.insert(0, str(HERE.parent / "tests" / "support"))

from examples import READERS, Reader, read_or_refused  # noqa: E402


def main() -> None:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("format", choices=["all", *READERS], metavar="FORMAT")
    parser.add_argument("--seconds", type=int, default=60, help="for each format (60)")
    parser.add_argument("--corpus", type=Path, help="a folder that keeps what was learned")
    parser.add_argument("--replay", type=Path, nargs="+", help="inputs that were saved")
    options = parser.parse_args()
    if options.replay:
        for file in options.replay:
            replay(READERS[options.format], file)
        return
    if find_spec("atheris") is None:
        sys.exit("atheris is not installed, so NOTHING was fuzzed: pip install 'atheris>=3'")
    names = list(READERS) if options.format == "all" else [options.format]
    failed = [name for name in names if fuzz(name, options.seconds, options.corpus)]
    print(f"{len(names) - len(failed)} of {len(names)} formats without a finding", *failed)
    sys.exit(bool(failed))


def replay(reader: Reader, file: Path) -> None:
    """Give an input to the reader again, with nothing caught."""
    with tempfile.TemporaryDirectory() as folder:
        path, damaged, _ = reader.example(Path(folder))
        damaged.write_bytes(reader.wrap(file.read_bytes()))
        read = read_or_refused(reader.read, path)
    print(f"{file}: {'refused' if read is None else 'read'}")


def fuzz(name: str, seconds: int, corpus: Path | None) -> int:
    """Fuzz one format in a process of its own; its status, 0 without a finding."""
    print(f"== {name}", flush=True)
    FOUND.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        seeds = folder / "seeds"
        seeds.mkdir()
        longest = 2048
        for number in range(len(READERS[name].makers)):
            inner = folder / str(number)
            inner.mkdir()
            content = READERS[name].example(inner, number)[2]
            (seeds / str(number)).write_bytes(content)
            longest = max(longest, len(content))
        learned = (corpus or folder / "corpus") / name
        learned.mkdir(parents=True, exist_ok=True)
        command = [
            *(sys.executable, str(HERE / "one_reader.py"), name, str(learned), str(seeds)),
            f"-max_total_time={seconds}",
            f"-max_len={2 * longest}",
            f"-timeout={SECONDS_PER_INPUT}",
            f"-rss_limit_mb={MOST_MIB}",
            f"-artifact_prefix={FOUND}/{name}-",
            "-print_final_stats=1",
        ]
        return _run(command, {**os.environ, "TMPDIR": place})


def _run(command: list[str], environment: dict[str, str]) -> int:
    """Run libFuzzer without the lines on its way."""
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
