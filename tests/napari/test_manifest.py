"""The manifest of the napari plugin: its functions exist, and its patterns fit the formats."""

import importlib
import warnings
from importlib.util import find_spec
from pathlib import Path

import pytest

from jotlight.formats.registry import FORMATS
from jotlight.napari import opening, reader

with warnings.catch_warnings():  # npe2 uses features of pydantic that will change
    warnings.simplefilter("ignore")
    npe2 = pytest.importorskip("npe2", reason="no napari: pip install 'jotlight[napari]'")

pytestmark = pytest.mark.filterwarnings("default")


@pytest.fixture
def manifest():
    return npe2.PluginManifest.from_file(str(Path(reader.__file__).with_name("napari.yaml")))


@pytest.fixture
def find_readers(manifest):
    """Return a function that returns the commands that npe2 finds for a path."""
    manager = npe2.PluginManager()
    manager.register(manifest)
    return lambda path: [each.command for each in manager.iter_compatible_readers(str(path))]


def expected_extensions():
    """Return the extensions of all formats."""
    extensions = set()
    for format_ in FORMATS.values():
        written = format_.writer.extensions if format_.writer else ()
        extensions |= {*format_.extensions, *format_.other_extensions, *written}
    # jotlight opens two kinds of .gz, whose names end in .npy.gz and .bin.gz. Other kinds belong
    # to other plugins.
    return extensions - {".gz"}


def test_the_patterns_are_the_extensions_of_the_formats(manifest):
    [contribution] = manifest.contributions.readers
    patterns = {each for each in contribution.filename_patterns if "[" not in each}
    assert patterns == {f"*{each}" for each in expected_extensions()} | {"transforms.json"}


@pytest.mark.parametrize(
    "name",
    [
        *(f"scan.2024{extension}" for extension in sorted(expected_extensions())),
        *("CAPTURE.NXS", "capture.npy.gz", "transforms.json"),
        *("a", "capture", "captures", "capture_0001", "2024.06.01_capture"),
    ],
)
def test_captures_have_exactly_one_reader(find_readers, name):
    assert find_readers(name) == ["jotlight.read"]


@pytest.mark.parametrize(
    "name",
    ["photo.jpg", "photo.jpeg", "a.c", "notes.md", "brain.nii.gz", "map.geojson", "data.json"],
)
def test_other_files_are_left_to_other_plugins(find_readers, name):
    assert find_readers(name) == []


def test_folders_have_exactly_one_reader(find_readers, tmp_path):
    assert find_readers(tmp_path) == ["jotlight.read"]


def test_the_manifest_names_functions_that_exist(manifest):
    assert manifest.name == "jotlight"
    for command in manifest.contributions.commands:
        module, _, name = command.python_name.partition(":")
        if not module.endswith("widget") or find_spec("magicgui"):
            assert callable(getattr(importlib.import_module(module), name))
    commands = {command.id for command in manifest.contributions.commands}
    contributions = manifest.contributions
    used = [*contributions.readers, *contributions.widgets, *contributions.sample_data]
    assert {each.command for each in used} == commands


def test_the_manifest_has_the_titles_of_the_widgets(manifest):
    titles = {each.display_name for each in manifest.contributions.widgets}
    assert titles == {reader.OPEN_TITLE, opening._WIDGET_TITLE}
