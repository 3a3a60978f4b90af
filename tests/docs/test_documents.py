"""README, docs, docstrings and examples run as they stand."""

import ast
import dataclasses
import doctest
import importlib
import linecache
import pkgutil
import re
import runpy
import shlex
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight
from printed_comments import agrees, run_block, stated_prints

ROOT = Path(__file__).parents[2]
# Other folders of docs are made, and perhaps removed, by a build of the website.
PAGES = [ROOT / "README.md"] + [
    page
    for folder in (".", "decisions", "guide", "results", "theory")
    for page in sorted((ROOT / "docs" / folder).glob("*.md"))
]
SITE = "https://jotlight.github.io/jotlight/"
SOURCE = "https://github.com/jotlight/jotlight"
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
MODULES = ["jotlight"] + [
    module.name
    for module in pkgutil.walk_packages(jotlight.__path__, "jotlight.")
    if not module.name.endswith("_engine")
]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.S | re.M)


NEEDS = {
    "jotlight.napari.background": "magicgui",
    "jotlight.napari.open_widget": "magicgui",
    "jotlight.napari.widget": "magicgui",
    "jotlight.torch": "torch",
    "jotlight.torch.deepinv": "deepinv",
    "jotlight.view.app": "starlette",
    "jotlight.view.serving": "uvicorn",
    "jotlight.networks.files.onnx_export": "onnx",
    "jotlight.networks.files.onnx_graph": "onnx",
}


LONG_DOCSTRINGS = [
    "jotlight.estimators.planning.bracketing",
    "jotlight.estimators.dead_time",
    "jotlight.motion.align",
    "jotlight.motion.films.film",
    "jotlight.motion.films.estimates",
    "jotlight.motion.merge",
    "jotlight.training.train",
]
"""Modules whose examples take long. The tests of these modules run the same code."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in LONG_DOCSTRINGS else [])
        for name in MODULES
    ],
)
def test_docstring_examples_run(name, monkeypatch):
    for module, package in NEEDS.items():
        if name == module or name.startswith(f"{module}."):
            pytest.importorskip(package)
    # Before each docstring, doctest looks for changes of all files that tracebacks have shown.
    monkeypatch.setattr(linecache, "checkcache", lambda filename=None: None)
    implied = {"jl": jotlight, "np": np}  # as the API reference says
    module = importlib.import_module(name)
    result = doctest.testmod(module, extraglobs=implied, optionflags=doctest.ELLIPSIS)
    assert result.failed == 0


def test_every_public_name_is_documented():
    for name in jotlight.__all__:
        documented = getattr(jotlight, name).__doc__
        assert name == "__version__" or (documented and len(documented) > 20), name


def page_cases() -> Iterator[object]:
    """Yield a test case per page. Pages that run commands or PyTorch, and long ones, are slow."""
    for page in PAGES:
        is_slow = bool(blocks(page, "sh")) or "import torch" in page.read_text("utf-8")
        is_slow |= page.name in ("brackets.md", "color.md", "networks.md", "which_sensor.md")
        name = str(page.relative_to(ROOT))
        yield pytest.param(page, id=name, marks=[pytest.mark.slow] if is_slow else [])


@pytest.mark.parametrize("page", list(page_cases()))
def test_the_page_runs_from_top_to_bottom(page, run):
    code = page.read_text("utf-8")
    if "jotlight.torch" in code or "--quality" in "".join(blocks(page, "sh")):
        pytest.importorskip("torch")
    for package in ("deepinv", "onnxruntime"):
        if f"import {package}" in code:
            pytest.importorskip(package)
    names: dict[str, object] = {}
    for language, block, below in re.findall(
        r"^```(python|sh)\n(.*?)^```(?:\n+```text\n(.*?)^```)?", code, re.S | re.M
    ):
        if language == "python":
            printed = run_block(block, page.name, names)
            for line, stated in stated_prints(block).items():
                assert agrees(stated, printed[line]), (stated, printed[line])
            text = "".join(printed[line] for line in sorted(printed))
            assert agrees(below, text), (below, text)
        elif page.name != "README.md":  # its sh blocks install the package itself
            for line in block.splitlines():
                run_command(line, run)


def test_the_code_of_pages_is_python_and_uses_names_that_exist():
    used = set()
    for page in PAGES:
        for node in ast.walk(ast.parse("\n".join(blocks(page, "python")))):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "jl":
                used.add(node.attr)
    assert {"Sensor", "reconstruct", "FreeRunning"} <= used
    assert [name for name in sorted(used) if not hasattr(jotlight, name)] == []


def run_command(line: str, run: Callable[..., tuple[int, str]]) -> None:
    words = shlex.split(line, comments=True)
    if not words:
        return
    assert words[0] == "jotlight", f"expected a jotlight command, got {line!r}"
    with warnings.catch_warnings():
        # Commands print warnings, such as that about the dead pixels of the tutorial.
        warnings.simplefilter("default", jotlight.JotlightWarning)
        status, output = run(*words[1:])
    assert status == 0, output


def test_the_readme_names_only_commands_that_exist():
    from jotlight.cli.app import app

    known = set(app)
    named = set(re.findall(r"^jotlight ([\w-]+)", "\n".join(blocks(PAGES[0], "text")), re.M))
    assert named
    assert named <= known


def test_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text("utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), (page, target)


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub and the website name them."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.S | re.M)
    titles = [
        re.sub(r"[^\w\- ]", "", title.lower()) for title in re.findall(r"^#+ (.*)$", text, re.M)
    ]
    return {title.strip().replace(" ", "-") for title in titles}


def test_links_to_headings_lead_somewhere():
    count = 0
    for page in PAGES:
        for target, anchor in re.findall(r"\]\(([^)#\s:]*)#([^)\s]+)\)", page.read_text("utf-8")):
            place = (page.parent / target).resolve() if target else page
            if place.suffix == ".md":
                count += 1
                assert anchor in anchors(place), (page, target, anchor)
    assert count > 100


def linked_file(target: str) -> Path | None:
    """Return the file that an address on the website, or in the repository, shows."""
    if target.startswith(SITE):
        page = target.removeprefix(SITE) or "index.html"
        return ROOT / "docs" / page.replace(".html", ".md")
    raw = SOURCE.replace("github.com", "raw.githubusercontent.com")
    for prefix in (f"{SOURCE}/blob/main/", f"{SOURCE}/tree/main/", f"{raw}/main/"):
        if target.startswith(prefix):
            return ROOT / target.removeprefix(prefix)
    return None


def test_links_of_the_readme_also_work_on_the_package_index():
    text = PAGES[0].read_text("utf-8")
    targets = re.findall(r"\]\(([^)]+)\)|^\[[^\]]+\]: (\S+)$", text, re.M)
    found = [one or other for one, other in targets]
    assert len(found) == text.count("https://") > 20  # every address is that of a link
    assert [each for each in found if not each.startswith("https://")] == []
    for each in found:
        target, _, anchor = each.partition("#")
        file = linked_file(target)
        if file is None:
            assert not target.startswith((SITE, SOURCE)), each
            continue
        assert file.exists(), each
        assert ("/tree/" in each) == file.is_dir(), each
        assert not anchor or anchor in anchors(file), each


def test_the_readme_leads_a_newcomer_to_the_first_tasks():
    readme = PAGES[0].read_text("utf-8")
    tasks = "files.html#your-first-image", "which_sensor.html", "motion.html", "networks.html"
    for task in (*tasks, "tutorial.html#uncertainty-brightness-and-number-of-frames"):
        assert f"{SITE}guide/{task}" in readme, task


def example_cases() -> Iterator[object]:
    """Yield a test case per example. The session `gallery` runs them all, also the slowest one."""
    for path in EXAMPLES:
        mark = pytest.mark.exhaustive if "train" in path.stem else pytest.mark.slow
        yield pytest.param(path, id=path.stem, marks=mark)


@pytest.mark.parametrize("path", list(example_cases()))
@pytest.mark.filterwarnings("ignore:.* pixels have no valid bit")
def test_the_example_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    with Image.open(tmp_path / f"{path.stem}.png") as figure:
        assert min(figure.size) > 100


def test_there_are_six_examples_of_less_than_60_lines():
    assert len(EXAMPLES) == 6
    for path in EXAMPLES:
        assert len(path.read_text("utf-8").splitlines()) < 60


def test_the_page_for_contributors_names_functions_and_files_that_exist():
    page = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    blocks_of_code = re.findall(r"^ *```\w+\n(.*?)^ *```", page, re.S | re.M)
    code = "\n".join(blocks_of_code + re.findall(r"`([^`\n]+)`", page))
    names = set(re.findall(r"(?<![\w/.])[a-z]+(?:_[a-z]+)+(?![\w/]|\.py)", code))
    assert {"prepare_data", "read_in_chunks"} <= names
    files = [path for top in ("python", "tests/support") for path in (ROOT / top).rglob("*.py")]
    known = {"open_mycamera", "write_mycamera"}
    known.update(*(re.findall(r"\w+", path.read_text("utf-8")) for path in files))
    assert sorted(names - known) == []
    folders = ROOT, ROOT / "python/jotlight"
    for name in re.findall(r"`([a-z_]+/[a-z0-9_/]+\.(?:py|rs|yaml))`", page):
        assert "mycamera" in name or any((each / name).is_file() for each in folders), name


def test_the_glossary_has_every_parameter_of_the_sensor():
    page = (ROOT / "docs/notation.md").read_text("utf-8")
    names = [field.name for field in dataclasses.fields(jotlight.Sensor)]
    assert [name for name in names if f"`Sensor.{name}`" not in page] == []


def test_scripts_named_in_a_page_exist():
    for page in [*PAGES, *ROOT.glob("*.md")]:
        for name in re.findall(
            r"python ((?:benchmarks|tools|examples|fuzz)/[\w/.]+\.py)", page.read_text()
        ):
            assert (ROOT / name).is_file(), name


def loaded_packages(code):
    """Return the packages that a new process has loaded after a piece of code."""
    code += "; import sys; print(*{name.split('.')[0] for name in sys.modules})"
    command = [sys.executable, "-c", code]
    return set(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split())


def test_import_loads_no_other_package():
    assert "numpy" not in loaded_packages("import jotlight")


def test_the_public_names_load_nothing_heavy():
    heavy = {"scipy", "skimage", "matplotlib", "cyclopts", "rich", "safetensors", "PIL", "tifffile"}
    heavy |= {"jinja2", "torch"}
    heavy |= {"pooch", "requests"}
    for code in (
        "from jotlight import *",
        "import os; os.environ['EAGER_IMPORT'] = '1'; import jotlight",
    ):
        loaded = loaded_packages(code)
        assert "numpy" in loaded
        assert not heavy & loaded


def test_modules_of_subpackages_are_attributes_only():
    code = """
import importlib.util
from jotlight import denoise, gates, operators, tv, vst
for module in denoise, gates, operators, tv, vst:
    assert importlib.import_module(module.__name__) is module
    assert importlib.util.find_spec("jotlight." + module.__name__.rpartition(".")[2]) is None
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_paper_map_names_functions_and_tests_that_exist():
    rows = (ROOT / "docs/theory/paper_map.md").read_text("utf-8")
    names = set(re.findall(r"`([^`]+)`", rows))
    dotted = {name for name in names if re.fullmatch(r"jotlight(\.\w+)+", name)}
    rust = {name for name in names if name.endswith(".rs")}
    python = {name for name in names if name.endswith(".py")}
    assert names - dotted - rust - python == {"crates/jotlight/src", "start"}
    for name in dotted:
        pkgutil.resolve_name(name)
    assert rust
    for name in rust:
        assert (ROOT / "crates/jotlight/src" / name).is_file(), name
    assert any(name.startswith("tests/") for name in python)
    for name in python:
        assert (ROOT / name).is_file(), name


def test_every_equation_of_the_paper_map_has_code_and_tests():
    page = (ROOT / "docs/theory/paper_map.md").read_text("utf-8")
    equations = page.split("## Experiments")[0].split("| --- |\n")[1]
    for row in equations.strip().splitlines():
        _, equation, _, where, tests, *_ = row.split("|")
        assert "`" in where, equation
        assert "`tests/" in tests, equation


def test_the_page_of_methods_has_a_row_for_every_method():
    from jotlight.evaluation.methods import METHODS

    page = (ROOT / "docs/guide/methods.md").read_text("utf-8")
    rows = "\n".join(line.split("|")[1] for line in page.splitlines() if line.startswith("| `"))
    assert [name for name in METHODS if f"`{name}`" not in rows] == []


def test_the_guide_to_files_has_a_row_for_every_format():
    from jotlight.formats.registry import FORMATS

    page = (ROOT / "docs/guide/files.md").read_text("utf-8")
    rows = "\n".join(line.split("|")[1] for line in page.splitlines() if line.startswith("| `"))
    assert [name for name in FORMATS if f"`{name}`" not in rows] == []
