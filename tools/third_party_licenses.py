"""Compare THIRD-PARTY-LICENSES with the Rust crates that the wheels contain, or write it.

    python tools/third_party_licenses.py
    python tools/third_party_licenses.py --write

The file holds the license of each crate that the compiled engine links, from the crate itself. The
gate runs the comparison. Write the file again after a change of `Cargo.lock`.
"""

import argparse
import json
import re
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OUTPUT = ROOT / "THIRD-PARTY-LICENSES"
ENGINE = "jotlight-python"
PLATFORMS = (
    "aarch64-apple-darwin",
    "aarch64-unknown-linux-gnu",
    "x86_64-apple-darwin",
    "x86_64-pc-windows-msvc",
    "x86_64-unknown-linux-gnu",
)
"""The platforms of the wheels."""

CHOICE = ("MIT", "BSD-2-Clause", "Zlib", "Apache-2.0")
"""Licenses, the first of which we take where a crate offers several."""

HEADER = """\
The wheels of jotlight contain the compiled engine. It links the Rust crates below, under the stated
licenses. The command `python tools/third_party_licenses.py --write` makes this file.
"""

LINE = "=" * 100

Crate = dict[str, Any]


def metadata(platform: str) -> dict[str, Any]:
    """Return what cargo states about the crates for a platform."""
    options = ("--format-version", "1", "--locked", "--filter-platform", platform)
    answer = subprocess.run(
        ["cargo", "metadata", *options], cwd=ROOT, check=True, capture_output=True
    )
    found: dict[str, Any] = json.loads(answer.stdout)
    return found


def linked_crates(found: dict[str, Any]) -> Iterator[Crate]:
    """Yield the crates of others that the engine links, without those that only serve to build."""
    crates = {crate["id"]: crate for crate in found["packages"]}
    nodes = {node["id"]: node for node in found["resolve"]["nodes"]}
    waiting = [name for name, crate in crates.items() if crate["name"] == ENGINE]
    known = set(waiting)
    while waiting:
        crate = crates[waiting.pop()]
        if any("proc-macro" in target["kind"] for target in crate["targets"]):
            continue
        if crate["source"] is not None:  # not ours
            yield crate
        for link in nodes[crate["id"]]["deps"]:
            if any(kind["kind"] is None for kind in link["dep_kinds"]) and link["pkg"] not in known:
                known.add(link["pkg"])
                waiting.append(link["pkg"])


def chosen_license(expression: str) -> str:
    """Return the license that we take of a crate's.

    Raises
    ------
    ValueError
        When the crate offers none of those that we know.
    """
    offered = re.split(r" OR |/", expression)
    for each in CHOICE:
        if each in offered:
            return each
    raise ValueError(f"expected one of {', '.join(CHOICE)}, got {expression}")


def license_files(crate: Crate) -> list[Path]:
    """Return the files of a crate that hold licenses."""
    folder = Path(crate["manifest_path"]).parent
    return [path for path in sorted(folder.iterdir()) if path.name.upper().startswith("LICEN")]


def license_text(crate: Crate, others: Iterable[Crate]) -> str:
    """Return the text of the license that we take.

    A crate without such a file has those of the crate whose name begins its own, in the same
    repository.

    Raises
    ------
    ValueError
        When the crate does not hold the text of this license alone.
    """
    chosen = chosen_license(crate["license"])
    files = license_files(crate)
    for other in others:
        is_part = crate["name"].startswith(f"{other['name']}-")
        if not files and is_part and other["repository"] == crate["repository"]:
            files = license_files(other)
    suffix = f"-{chosen.partition('-')[0]}".upper()
    of_chosen = [path for path in files if path.stem.upper().endswith(suffix)]
    texts = of_chosen or files
    if len(texts) != 1:
        names = ", ".join(path.name for path in files) or "none"
        raise ValueError(f"{crate['name']}: expected one file of {chosen}, got {names}")
    return texts[0].read_text("utf-8").strip()


def document() -> str:
    """Return the text of the file."""
    crates = {
        (crate["name"], crate["version"]): crate
        for platform in PLATFORMS
        for crate in linked_crates(metadata(platform))
    }
    parts = [HEADER]
    for (name, version), crate in sorted(crates.items()):
        title = f"{name} {version}, {chosen_license(crate['license'])}\n{crate['repository']}"
        parts.append(f"{LINE}\n{title}\n\n{license_text(crate, crates.values())}\n")
    lines = "\n".join(parts).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"


def main() -> None:
    """Compare the file, and exit with 1 if it is old; or write it."""
    parser = argparse.ArgumentParser(description="Compare or write THIRD-PARTY-LICENSES.")
    parser.add_argument("--write", action="store_true", help="write the file")
    text = document()
    if parser.parse_args().write:
        OUTPUT.write_text(text, "utf-8", newline="\n")
    elif OUTPUT.read_text("utf-8") != text:
        raise SystemExit(
            f"{OUTPUT.name} does not match Cargo.lock: run "
            "python tools/third_party_licenses.py --write"
        )


if __name__ == "__main__":
    main()
