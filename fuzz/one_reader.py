"""One reader under atheris; ``fuzz/readers.py`` starts it, with what libFuzzer is told."""

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
FOLLOWED = {"tiff": ("tifffile",), "png": ("PIL", "png"), "picture": ("PIL",)}
"""Packages whose branches guide the fuzzing besides our own, by a word in the reader's name."""

ODD: tuple[Any, ...] = (
    *(None, True, 0, -1, 1, 3, 2**31, 2**70, 0.5, 1e308, math.nan, math.inf),
    *("", "0", "a\0", "..", "a.npy", [], {}, [[]], [1, 2]),
)


def main(name: str) -> None:
    """Fuzz a reader; libFuzzer ends the process."""
    logging.disable()
    others = [package for word in FOLLOWED if word in name for package in FOLLOWED[word]]
    with atheris.instrument_imports(include=["jotlight", *others]):
        from examples import READERS, read_or_refused

        reader = READERS[name]
        path, damaged, _ = reader.example(Path(tempfile.mkdtemp()))
        # Some modules are imported only here.
        read_or_refused(reader.read, path)
    most = _peak_mib() + MIB_PER_INPUT

    def one_input(data: bytes) -> None:
        # A new file, lest one that is still mapped becomes shorter.
        damaged.unlink(missing_ok=True)
        damaged.write_bytes(reader.wrap(data))
        read_or_refused(reader.read, path)
        assert _peak_mib() < most, f"took more than {MIB_PER_INPUT} MiB"

    changes = {"custom_mutator": _mutated_json} if reader.json else {}
    atheris.Setup([sys.argv[0], *sys.argv[2:]], one_input, **changes)
    atheris.Fuzz()


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _mutated_json(data: bytes, most: int, seed: int) -> bytes:
    """Bytes changed by libFuzzer, or mostly a value of the JSON in them."""
    rng = random.Random(seed)  # noqa: S311
    if rng.random() < 0.8:
        try:
            changed = _changed(data.decode(), rng).encode()
        except (ValueError, RecursionError):
            changed = b""
        if 0 < len(changed) <= most:
            return changed
    return bytes(atheris.Mutate(data, most))


def _changed(text: str, rng: random.Random) -> str:
    """JSON with one of its values, at any depth, replaced, left out or moved."""
    whole = [json.loads(text)]
    places = list(_places(whole))
    holder, key = rng.choice(places)
    value = holder[key]
    if isinstance(value, str) and value[:1] in ("{", "["):
        holder[key] = _changed(value, rng)  # JSON within JSON
    elif holder is not whole and rng.random() < 0.2:
        del holder[key]
    elif rng.random() < 0.2:
        other, its = rng.choice(places)
        holder[key] = json.loads(json.dumps(other[its]))
    elif isinstance(value, int) and rng.random() < 0.5:
        holder[key] = value + rng.choice((-1, 1, 8, value))
    else:
        holder[key] = rng.choice(ODD)
    return json.dumps(whole[0])


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Each place in a JSON, as what holds it and its key there."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield value, key
            yield from _places(inner)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
    main(sys.argv[1])
