"""The licenses of the crates that the engine links."""

import importlib.util
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[2] / "tools/third_party_licenses.py"


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("third_party_licenses", TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def crate_in(folder, name="wand", offered="MIT", source="registry", kind="lib", files=()):
    """Return a crate with files in a folder, as cargo describes it."""
    (folder / name).mkdir()
    for file in files:
        (folder / name / file).write_text(f"{file} of {name}\n")
    manifest = str(folder / name / "Cargo.toml")
    targets = [{"kind": [kind]}]
    return {
        "name": name,
        "id": name,
        "license": offered,
        "source": source,
        "targets": targets,
        "manifest_path": manifest,
        "repository": "https://example.org/wands",
    }


def test_crates_that_only_serve_to_build_are_left_out(tool, tmp_path):
    crates = [
        crate_in(tmp_path, "jotlight-python", source=None),
        crate_in(tmp_path, "jotlight", source=None),
        *(crate_in(tmp_path, name) for name in ("linked", "deeper", "builds", "tests", "beneath")),
        crate_in(tmp_path, "macros", kind="proc-macro"),
    ]
    links = {
        "jotlight-python": [("jotlight", None), ("linked", None), ("macros", None)],
        "jotlight": [("tests", "dev"), ("builds", "build"), ("linked", None)],
        "linked": [("deeper", None)],
        "macros": [("beneath", None)],
    }
    nodes = [
        {
            "id": crate["id"],
            "deps": [
                {"pkg": name, "dep_kinds": [{"kind": kind}]}
                for name, kind in links.get(crate["id"], [])
            ],
        }
        for crate in crates
    ]
    found = tool.linked_crates({"packages": crates, "resolve": {"nodes": nodes}})
    assert {crate["name"] for crate in found} == {"linked", "deeper"}


@pytest.mark.parametrize(
    ("offered", "files", "expected"),
    [
        ("MIT OR Apache-2.0", ["LICENSE-APACHE", "LICENSE-MIT"], "LICENSE-MIT of wand"),
        ("Unlicense/MIT", ["COPYING", "LICENSE-MIT", "UNLICENSE"], "LICENSE-MIT of wand"),
        ("Apache-2.0", ["LICENSE"], "LICENSE of wand"),
        ("MIT", ["license.md"], "license.md of wand"),
    ],
)
def test_the_text_is_that_of_the_license_that_we_take(tool, tmp_path, offered, files, expected):
    assert tool.license_text(crate_in(tmp_path, "wand", offered, files=files), []) == expected


def test_a_part_of_a_crate_has_its_license(tool, tmp_path):
    whole = crate_in(tmp_path, "wand", files=["LICENSE"])
    part = crate_in(tmp_path, "wand-flag")
    assert tool.license_text(part, [whole, part]) == "LICENSE of wand"


@pytest.mark.parametrize(
    ("offered", "files", "message"),
    [
        ("GPL-3.0", ["LICENSE"], "expected one of MIT, .*, got GPL-3.0"),
        ("MIT", [], "wand: expected one file of MIT, got none"),
        ("Zlib", ["LICENSE-A", "LICENSE-B"], "wand: .* of Zlib, got LICENSE-A, LICENSE-B"),
    ],
)
def test_a_license_that_is_not_clear_is_an_error(tool, tmp_path, offered, files, message):
    with pytest.raises(ValueError, match=message):
        tool.license_text(crate_in(tmp_path, "wand", offered, files=files), [])
