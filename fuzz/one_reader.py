"""Fuzz one reader with atheris. ``fuzz/readers.py`` runs this script with options of libFuzzer."""

import json
import logging
import math
import random
import resource
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import atheris

MIB_PER_INPUT = 512
"""Maximum memory in MiB that reading one input may take."""

INSTRUMENTED = {"tiff": ("tifffile",), "png": ("PIL", "png"), "image": ("PIL",)}
"""Packages that are instrumented in addition to jotlight, by a part of the reader's name."""

NESTED = "nested"
"""Value that becomes 1500 lists in each other, deeper than Python's limit of recursion."""

ODD_VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 3, 2**31, 2**70, 0.5, 1e308, math.nan, math.inf),
    *("", "0", "a\0", "..", "a.npy", [], {}, [[]], [1, 2]),
    NESTED,
)
"""Values with which the mutator replaces values of JSON."""


def main(name: str) -> None:
    """Fuzz a reader until libFuzzer ends the process."""
    logging.disable()
    packages = [package for part in INSTRUMENTED if part in name for package in INSTRUMENTED[part]]
    with atheris.instrument_imports(include=["jotlight", *packages]):
        from examples import READERS, read_or_refused

        reader = READERS[name]
        path, damaged, _ = reader.example(Path(tempfile.mkdtemp()))
        # This call imports the modules that a reader imports lazily, so that they are instrumented.
        read_or_refused(reader.read, path)
    max_mib = _peak_mib() + MIB_PER_INPUT

    def test_input(data: bytes) -> None:
        # The file is deleted first, so that a file that is still open keeps its content.
        damaged.unlink(missing_ok=True)
        damaged.write_bytes(reader.wrap(data))
        read_or_refused(reader.read, path)
        assert _peak_mib() < max_mib, f"took more than {MIB_PER_INPUT} MiB"

    options = {"custom_mutator": _mutate_json} if reader.json else {}
    atheris.Setup([sys.argv[0], *sys.argv[2:]], test_input, **options)
    atheris.Fuzz()


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _mutate_json(data: bytes, max_size: int, seed: int) -> bytes:
    """Return JSON with one changed value, or sometimes bytes that libFuzzer changed."""
    rng = random.Random(seed)  # noqa: S311
    if rng.random() < 0.8:
        try:
            changed = _change_value(data.decode(), rng).encode()
        except (ValueError, RecursionError):
            changed = b""
        if 0 < len(changed) <= max_size:
            return changed
    return bytes(atheris.Mutate(data, max_size))


def _change_value(text: str, rng: random.Random) -> str:
    """Return JSON with one of its values, at any depth, replaced, deleted, or moved."""
    root = [json.loads(text)]
    places = list(_list_places(root))
    container, key = rng.choice(places)
    value = container[key]
    if isinstance(value, str) and value[:1] in ("{", "["):
        container[key] = _change_value(value, rng)  # a string that contains JSON
    elif container is not root and rng.random() < 0.2:
        del container[key]
    elif rng.random() < 0.2:
        other, other_key = rng.choice(places)
        container[key] = json.loads(json.dumps(other[other_key]))
    elif isinstance(value, int) and rng.random() < 0.5:
        container[key] = value + rng.choice((-1, 1, 8, value))
    else:
        container[key] = rng.choice(ODD_VALUES)
    return json.dumps(root[0]).replace(f'"{NESTED}"', 1500 * "[" + 1500 * "]")


def _list_places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the container and the key of each value in JSON."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield value, key
            yield from _list_places(inner)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
    main(sys.argv[1])
