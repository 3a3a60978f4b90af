"""Imports run one way, from the command line down to the base modules."""

import importlib
import importlib.util
import re
import sys
from pathlib import Path

import pytest

import jotlight

MAX_LAYERS = 10


def load_tool():
    path = Path(__file__).parents[1] / "tools" / "import_layers.py"
    spec = importlib.util.spec_from_file_location("import_layers", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


tool = load_tool()


@pytest.fixture(scope="module")
def imports():
    return tool.read_imports()


def test_no_module_imports_one_of_a_higher_rank(imports):
    assert [str(each) for each in imports.upward()] == []


def test_every_unit_has_a_rank_and_every_rank_a_unit(imports):
    assert set(imports.units) == set(tool.ranks())


def test_neither_units_nor_modules_import_each_other(imports):
    assert tool.cycles(imports.unit_graph()) == []
    assert tool.cycles(imports.module_graph()) == []


def test_the_longest_chain_of_units_is_short(imports):
    chain = tool.longest_chain(imports.unit_graph())
    assert len(chain) <= MAX_LAYERS, " > ".join(chain)


@pytest.mark.parametrize(
    ("package", "order"),
    [
        ("cli", "terminal captures options reports reconstruction runs training"),
        (
            "estimators",
            "inverse_response planning mle iterative inpaint demosaicing vst merge_readings "
            "uncertainty readings photon_counters",
        ),
        (
            "evaluation",
            "methods many_trials held_out choice records contradictions color intervals",
        ),
        (
            "formats",
            "capture files frames format raw npy hdf5 matlab images zarr registry opening",
        ),
        (
            "motion",
            "tiles motion labels counts displacements agreement outlines posterior merging merge "
            "align films",
        ),
        (
            "networks",
            "layer splines conditioning graph layer_checks architectures precision inference "
            "stages planes files network planes_network color",
        ),
        ("sensing", "parameters bits drawing sensor merged data likelihood"),
    ],
)
def test_inner_folders_import_only_what_stands_before_them(imports, package, order):
    prefix = f"jotlight.{package}."
    graph = imports.module_graph()
    found = {
        name.split(".")[2] for name in graph if name.startswith(prefix) and name.count(".") > 2
    }
    lower = set()
    for inner in order.split():
        if inner in found:
            inside = [graph[name] for name in graph if name.startswith(f"{prefix}{inner}.")]
            targets = {name for name in set().union(*inside) if name.startswith(prefix)}
            assert {name.split(".")[2] for name in targets} <= lower | {inner}
        lower.add(inner)
    assert found <= lower


def test_no_module_imports_the_package_itself(imports):
    assert [str(each) for each in imports.of_package] == []


def make_package(folder, **modules):
    for name, text in modules.items():
        path = folder.joinpath("jotlight", *name.split("__"))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.with_suffix(".py").write_text(text)
    (folder / "jotlight" / "__init__.py").write_text("from jotlight import high")
    return tool.read_imports(folder / "jotlight")


def test_folders_import_their_public_modules_when_they_are_used():
    package = Path(jotlight.__file__).parent
    stub = (package / "__init__.pyi").read_text()
    modules = [
        (folder, name)
        for folder, name in re.findall(r"from \.([\w.]+) import (\w+)", stub)
        if package.joinpath(*folder.split("."), f"{name}.py").exists()
    ]
    assert ("estimators", "tv") in modules
    # Otherwise, the name exists only if something has imported the module before.
    for folder, name in modules:
        assert name in importlib.import_module(f"jotlight.{folder}").__all__, name


def test_every_kind_of_import_is_found(tmp_path):
    found = make_package(
        tmp_path,
        low="import os, jotlight._engine as engine",
        middle__one="from jotlight.low import name\nfrom . import two",
        middle__two="def function():\n    import jotlight.low",
        high="if TYPE_CHECKING:\n    from .middle.two import name\nfrom jotlight import low",
    )
    assert found.units == ["high", "jotlight", "low", "middle"]
    assert found.module_graph() == {
        "jotlight": {"jotlight.high"},
        "jotlight.high": {"jotlight.low", "jotlight.middle.two"},
        "jotlight.low": set(),
        "jotlight.middle.one": {"jotlight.low", "jotlight.middle.two"},
        "jotlight.middle.two": {"jotlight.low"},
    }
    assert [str(each) for each in found.of_package] == ["jotlight.high:3 imports jotlight"]
    assert tool.longest_chain(found.unit_graph()) == ["jotlight", "high", "middle", "low"]


def test_upward_imports_and_cycles_are_found(tmp_path):
    found = make_package(
        tmp_path,
        low="import jotlight.high",
        middle__one="import jotlight.middle.two",
        middle__two="import jotlight.middle.one",
        high="import jotlight.low, jotlight.middle.one",
    )
    order = "low < middle < high < jotlight"
    assert [str(each) for each in found.upward(order)] == ["jotlight.low:1 imports jotlight.high"]
    assert tool.cycles(found.unit_graph()) == [["high", "low"]]
    assert tool.cycles(found.module_graph()) == [
        ["jotlight.high", "jotlight.low"],
        ["jotlight.middle.one", "jotlight.middle.two"],
    ]
    assert tool.longest_chain(found.unit_graph()) == ["jotlight", "high + low", "middle"]
    assert "upward imports: 1" in tool.table(found, order)


def test_an_import_of_the_engine_through_the_package_is_found(tmp_path):
    found = make_package(tmp_path, low="from jotlight import _engine", high="")
    assert [str(each) for each in found.of_package] == ["jotlight.low:1 imports jotlight"]
