"""Write the pages of the API reference: a page for each public name, and one for each section.

The public names are those of `__all__` in `jotlight` and in its public modules. A new name appears
by itself: its folder decides the section.
"""

import ast
import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from docutils.nodes import Element
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.autodoc.mock import _MockObject, mock
from sphinx.pycode import ModuleAnalyzer

import jotlight
import jotlight.plots

SECTIONS = {
    "sensing": "Sensor, bits, and likelihood",
    "formats": "Captures",
    "calibration": "Calibration",
    "evaluation": "Reconstruction and comparison",
    "estimators": "Classical methods and planning",
    "networks": "Networks",
    "training": "Training",
    "torch": "PyTorch",
    "motion": "Moving scenes",
    "images": "Images and films",
    "plots": "Figures",
    "datasets": "Test images and data sets",
    "metrics": "Measures of quality",
    "experiments": "Experiments of the paper",
    "errors": "Warnings and errors",
}
"""Titles of the sections by the folder of their names, in the order of the reference.

The names of another folder have a section after these, whose title is that of the folder.
"""

USED_NAMES = {
    "jotlight.estimators.planning.bracketing": ("best_threshold", "intensity_range", "snr_bound"),
    "jotlight.images.io": ("image_writer",),
    "jotlight.images.tone": ("Tone",),
    "jotlight.torch.deepinv": (
        "BitLikelihood",
        "NetworkDenoiser",
        "NetworkReconstructor",
        "SensorPhysics",
    ),
}
"""Names outside `__all__` that the guide and the examples import."""

INTERNAL_MEMBERS = ("engine_network", "sharing_engine")
"""Members of base classes that only the package uses."""

_INTRODUCTION = """\
This reference describes every public name of jotlight. Examples begin with
``import jotlight as jl`` and ``import numpy as np``. Names that are not listed here may change
without notice. The :doc:`../command_line` has a page of its own.
"""


_documented_paths: dict[str, str] = {}
"""Path of the page of each name, by the path of its definition."""


class Name(NamedTuple):
    """A public name."""

    module: str
    name: str
    value: Any

    @property
    def path(self) -> str:
        """Return the name as the user writes it."""
        return f"{self.module}.{self.name}"

    @property
    def file(self) -> str:
        """Return the name of its page. Some systems take `Plan` and `plan` for the same file."""
        return f"generated/{self.path}{'-class' if inspect.isclass(self.value) else ''}"

    @property
    def folder(self) -> str:
        """Return the folder of the module that lists it, or that of its code for `jl.NAME`."""
        listing = sys.modules[self.module].__name__
        parts = (self.value.__module__ if listing == "jotlight" else listing).split(".")
        return str(parts[1])


def public_names(mocked: list[str]) -> list[Name]:
    """Return all public names, each object once."""
    found: dict[int, Name] = {}
    with mock(mocked):
        for module, names in _namespaces():
            for name in names:
                value = getattr(sys.modules[module], name)
                if isinstance(value, ModuleType) or name == "__version__":
                    continue
                found.setdefault(id(value), Name(module, name, value))
    return list(found.values())


def _namespaces() -> Iterator[tuple[str, Sequence[str]]]:
    """Yield each public module, as the user writes it, and its public names."""
    yield "jotlight", jotlight.__all__
    for name in jotlight.__all__:
        module = getattr(jotlight, name)
        if isinstance(module, ModuleType):
            # Sphinx imports `jotlight.estimators.tv` by its short name, `jotlight.tv`.
            sys.modules[f"jotlight.{name}"] = module
            yield f"jotlight.{name}", module.__all__
    yield "jotlight.plots", jotlight.plots.__all__
    for package in pkgutil.iter_modules(jotlight.__path__, "jotlight."):
        if package.ispkg:
            module = importlib.import_module(package.name)
            yield package.name, getattr(module, "__all__", [])
    for used, names in USED_NAMES.items():
        importlib.import_module(used)
        yield used, names


def check_guide(folder: Path, names: list[Name]) -> None:
    """Raise ValueError for a name that the guide or an example imports without a page here."""
    documented = {id(each.value) for each in names}
    texts = [path.read_text("utf-8") for path in (folder.parent / "examples").glob("*.py")]
    for page in folder.rglob("*.md"):
        texts += re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.S | re.M)
    imports = (node for text in texts for node in ast.walk(ast.parse(text)))
    for node in imports:
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("jotlight"):
            for alias in node.names:
                module = sys.modules.get(str(node.module))
                if id(getattr(module, alias.name, None)) not in documented:
                    raise ValueError(
                        f"{node.module}.{alias.name}: the guide imports it, but the reference has "
                        "no page for it; add it to USED_NAMES in docs/_extensions/api_pages.py"
                    )


def _documentation(each: Name) -> str:
    """Return the docstring of a name; that of data is the string after its definition."""
    if inspect.isclass(each.value) or inspect.isroutine(each.value):
        return inspect.getdoc(each.value) or ""
    package = sys.modules[each.module].__name__
    for module in list(sys.modules.values()):
        name = module.__name__ if isinstance(module, ModuleType) else ""
        if name.startswith(package) and getattr(module, each.name, None) is each.value:
            lines = ModuleAnalyzer.for_module(name).find_attr_docs().get(("", each.name))
            if lines:
                return "\n".join(lines)
    raise ValueError(f"{each.path}: has no docstring; write one after its definition")


def _anchors(each: Name, names: list[Name]) -> str:
    """Return anchors for the links from the page with the source code of a name.

    If several public modules list names of one source file, that page links to all of them by the
    path of one module.
    """
    source = getattr(each.value, "__module__", None)
    modules = {other.module for other in names if getattr(other.value, "__module__", 0) == source}
    spans = (f'<span id="{name}.{each.name}"></span>' for name in sorted(modules - {each.module}))
    return "".join(spans)


def _import_lines(module: str) -> list[str]:
    """Return how to import a module of a subpackage, which is only an attribute of `jotlight`."""
    name = module.rpartition(".")[2]
    if sys.modules[module].__name__ == module:
        return []
    return [
        f"Write ``jl.{name}``, or ``from jotlight import {name}``. The module lies in a "
        f"subpackage, so ``import {module}`` fails.",
        "",
    ]


def _inherited_members(value: type, names: Sequence[Name]) -> str:
    """Return the option that adds members of base classes without pages, which come first."""
    with_pages = {id(each.value) for each in names}
    for number, base in enumerate(value.__mro__[1:]):
        if not base.__module__.startswith("jotlight.") or id(base) in with_pages:
            hidden = f"   :exclude-members: {', '.join(INTERNAL_MEMBERS)}\n"
            return f"   :inherited-members: {base.__name__}\n{hidden}" if number else ""
    return ""


def _page(each: Name, documentation: str, anchors: str, names: Sequence[Name] = ()) -> str:
    head = f"{each.path}\n{'=' * len(each.path)}\n\n.. currentmodule:: {each.module}\n\n"
    head += f".. raw:: html\n\n   {anchors}\n\n" if anchors else ""
    head += "".join(f"{line}\n" for line in _import_lines(each.module))
    if inspect.isclass(each.value):
        bases = "" if each.value.__bases__ == (object,) else "   :show-inheritance:\n"
        inherited = _inherited_members(each.value, names)
        return f"{head}.. autoclass:: {each.name}\n   :members:\n{inherited}{bases}"
    if inspect.isroutine(each.value):
        return f"{head}.. autofunction:: {each.name}\n"
    body = "\n".join(f"   {line}" for line in documentation.splitlines())
    return f"{head}.. py:data:: {each.name}\n\n{body}\n"


def _section_page(title: str, names: list[Name], summaries: dict[str, str]) -> str:
    lines = [title, "=" * len(title), ""]
    for module in dict.fromkeys(each.module for each in names):
        within = [each for each in names if each.module == module]
        if module != "jotlight":
            lines += [module, "-" * len(module), "", *_import_lines(module)]
        lines += [".. list-table::", "   :class: api", ""]
        for each in within:
            lines += [
                f"   * - :py:obj:`{each.name} <{each.path}>`",
                f"     - {summaries[each.path]}",
            ]
        lines.append("")
    lines += [".. toctree::", "   :hidden:", ""]
    lines += [f"   {each.name} <{each.file}>" for each in names]
    return "\n".join(lines) + "\n"


def _index_page(titles: dict[str, str], names: list[Name]) -> str:
    title = "API reference"
    lines = [title, "=" * len(title), "", _INTRODUCTION, ".. list-table::", ""]
    for folder in titles:
        within = [each for each in names if each.folder == folder]
        links = ", ".join(f":py:obj:`{each.name} <{each.path}>`" for each in within)
        lines += [f"   * - :doc:`{folder}`", f"     - {links}"]
    lines += ["", ".. toctree::", "   :hidden:", "", *(f"   {name}" for name in titles)]
    return "\n".join([*lines, "   ../command_line"]) + "\n"


def write_pages(app: Sphinx) -> None:
    """Write all pages of the reference into `docs/api`, and remove those of earlier names."""
    folder = Path(app.srcdir) / "api"
    names = public_names(app.config.autodoc_mock_imports)
    check_guide(Path(app.srcdir), names)
    for each in names:
        module = getattr(each.value, "__module__", None) or each.module
        _documented_paths[f"{module}.{each.name}"] = each.path
    texts = {each.path: _documentation(each) for each in names}
    summaries = {path: " ".join(text.split("\n\n")[0].split()) for path, text in texts.items()}
    folders = {each.folder for each in names}
    titles = {name: title for name, title in SECTIONS.items() if name in folders}
    titles |= {name: name.capitalize() for name in sorted(folders - set(SECTIONS))}
    pages = {
        each.file: _page(each, texts[each.path], _anchors(each, names), names) for each in names
    }
    for name, title in titles.items():
        within = [each for each in names if each.folder == name]
        pages[name] = _section_page(title, within, summaries)
    pages["index"] = _index_page(titles, names)
    _write_changed(folder, pages)


def _write_changed(folder: Path, pages: dict[str, str]) -> None:
    """Write pages whose text changed, so that a second build is fast."""
    (folder / "generated").mkdir(parents=True, exist_ok=True)
    for old in (*folder.glob("*.rst"), *folder.glob("generated/*.rst")):
        if str(old.relative_to(folder).with_suffix("")) not in pages:
            old.unlink()
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def resolve_real_path(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, content: Element
) -> Element | None:
    """Return a link to a name that a docstring calls by its real path, or None.

    Docstrings write `jotlight.estimators.tv.shrink`; its page is that of `jotlight.tv.shrink`.
    """
    target = node.get("reftarget", "")
    for real in (target, target.rpartition(".")[0]):
        if node.get("refdomain") == "py" and real in _documented_paths:
            path = _documented_paths[real] + target.removeprefix(real)
            page, kind = node.get("refdoc", ""), node["reftype"]
            domain = env.get_domain("py")
            return domain.resolve_xref(env, page, app.builder, kind, path, node, content)
    return None


def _union(mocked: object, other: object) -> object:
    """Return a mocked type in place of its union with another type."""
    return mocked


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    # Annotations such as `torch.device | str` are evaluated; Sphinx's mocks have no `|`.
    _MockObject.__or__ = _MockObject.__ror__ = _union  # type: ignore[attr-defined]
    app.connect("builder-inited", write_pages, priority=100)
    app.connect("missing-reference", resolve_real_path)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
