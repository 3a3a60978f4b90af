"""The imports of python/jotlight: layers of packages, cycles, and imports of higher packages.

Run as a script, it prints a table. A *unit* is a folder or a top-level module of the package. All
imports count, also those in functions and under `if TYPE_CHECKING`. The compiled engine does not
count. Imports of the package itself are listed separately: `import jotlight` imports everything.

    python tools/import_layers.py [FOLDER] [--order "low units < higher units < highest units"]
"""

import argparse
import ast
import dataclasses
from collections.abc import Iterator
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "python" / "jotlight"

ENGINE = "_engine"

ORDER = (
    "errors array_types kept seeds arrays checks parameter_names notebook blur squares underflow "
    "figure_style figures progress chunks interrupts layout memory output_files output_links "
    "disk_space temporary_names write_errors files tensors paths < sensing < calibration formats "
    "metrics < estimators images < datasets networks < motion training < torch plots < evaluation "
    "< runs experiments < dask view < cli napari < jotlight"
)
"""The units, from the lowest rank to the highest; `jotlight` is `__init__.py` and `__main__.py`."""

Graph = dict[str, set[str]]


@dataclasses.dataclass(frozen=True)
class Import:
    """An import statement: the importing module, its line, and the imported module."""

    module: str
    line: int
    target: str

    def __str__(self) -> str:
        return f"{self.module}:{self.line} imports {self.target}"


@dataclasses.dataclass(frozen=True)
class Imports:
    """All imports between the modules of a package."""

    modules: tuple[str, ...]
    imports: tuple[Import, ...]
    of_package: tuple[Import, ...]
    """Imports of the package itself: `import jotlight`, `from jotlight import mle`."""

    @property
    def units(self) -> list[str]:
        """Return the units of the package, sorted."""
        return sorted({unit(module) for module in self.modules})

    def module_graph(self) -> Graph:
        """Return the modules that each module imports, by name."""
        graph: Graph = {module: set() for module in self.modules}
        for each in self.imports:
            graph[each.module].add(each.target)
        return graph

    def unit_graph(self) -> Graph:
        """Return the other units that each unit imports, by name."""
        graph: Graph = {name: set() for name in self.units}
        for each in self.imports:
            if unit(each.module) != unit(each.target):
                graph[unit(each.module)].add(unit(each.target))
        return graph

    def upward(self, order: str = ORDER) -> list[Import]:
        """Return the imports of units that have a higher rank than the importing unit."""
        rank = ranks(order)
        return [
            each
            for each in self.imports
            if rank.get(unit(each.module), len(rank)) < rank.get(unit(each.target), -1)
        ]


def unit(module: str) -> str:
    """Return the unit of a module: `sensing` for `jotlight.sensing.bits.bits`."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and parts[1] != "__main__" else parts[0]


def ranks(order: str = ORDER) -> dict[str, int]:
    """Return the rank of each unit in an order such as `low other < high`."""
    levels = order.split("<")
    return {name: rank for rank, level in enumerate(levels) for name in level.split()}


def read_imports(folder: Path = FOLDER) -> Imports:
    """Return the imports of all modules of the package in `folder`."""
    paths = {_module_name(path, folder): path for path in sorted(folder.rglob("*.py"))}
    found: dict[Import, None] = {}
    for module, path in paths.items():
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        for node in _statements(ast.parse(path.read_text(), str(path))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                targets = _targets(node, package, frozenset(paths))
                found |= {Import(module, node.lineno, target): None for target in targets}
    between = tuple(each for each in found if each.target not in (folder.name, each.module))
    of_package = tuple(
        each for each in found if each.target == folder.name and each.module != folder.name
    )
    return Imports(tuple(paths), between, of_package)


def cycles(graph: Graph) -> list[list[str]]:
    """Return the groups of names that import each other, directly or indirectly."""
    reached = {name: _reachable(graph, name) for name in graph}
    groups = {
        tuple(sorted(other for other in reached[name] if name in reached[other]))
        for name in graph
        if name in reached[name]
    }
    return [list(group) for group in sorted(groups)]


def longest_chain(graph: Graph) -> list[str]:
    """Return a longest chain of imports, from the top down. A cycle counts as one name."""
    group = {name: name for name in graph}
    for names in cycles(graph):
        group |= dict.fromkeys(names, " + ".join(names))
    merged: Graph = {name: set() for name in group.values()}
    for name, targets in graph.items():
        merged[group[name]] |= {group[target] for target in targets} - {group[name]}

    @cache
    def chain(name: str) -> list[str]:
        return [name, *max(map(chain, sorted(merged[name])), key=len, default=[])]

    return max(map(chain, sorted(merged)), key=len, default=[])


def _module_name(path: Path, folder: Path) -> str:
    """Return the dotted name of a module's file."""
    parts = path.relative_to(folder.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements in a statement. Expressions are left out: they import nothing."""
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        for child in getattr(node, block, ()):
            yield child
            yield from _statements(child)


def _targets(
    node: ast.Import | ast.ImportFrom, package: str, modules: frozenset[str]
) -> Iterator[str]:
    """Yield the modules of the package that a statement imports."""
    root = package.split(".")[0]
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    else:
        parents = package.split(".")[: len(package.split(".")) - node.level + 1]
        base = ".".join([*(parents if node.level else []), *([node.module] if node.module else [])])
        names = [f"{base}.{alias.name}" for alias in node.names]
    for name in names:
        if name.split(".")[0] != root:
            continue
        # `from jotlight import plots` imports the package, and its module plots.
        if isinstance(node, ast.ImportFrom) and name.rpartition(".")[0] == root:
            yield root
        if name.split(".")[1:2] == [ENGINE]:
            continue
        while name not in modules:
            name = name.rpartition(".")[0]
        yield name


def _reachable(graph: Graph, start: str) -> set[str]:
    """Return the names that `start` imports, directly or indirectly."""
    reached: set[str] = set()
    waiting = [start]
    while waiting:
        new = graph[waiting.pop()] - reached
        reached |= new
        waiting += new
    return reached


def table(imports: Imports, order: str = ORDER) -> str:
    """Return a text with the units by rank, and all cycles and upward imports."""
    rank = ranks(order)
    chain = longest_chain(imports.unit_graph())
    upward = imports.upward(order)
    found = cycles(imports.unit_graph()), cycles(imports.module_graph())
    unranked = [name for name in imports.units if name not in rank]
    lines = [f"{level:2}  {' '.join(units)}" for level, units in _levels(imports, rank)]
    lines += [
        "",
        f"layers: {len(chain)} ({' > '.join(chain)})",
        f"cycles of units: {len(found[0])}",
        *(f"    {', '.join(group)}" for group in found[0]),
        f"cycles of modules: {len(found[1])}",
        *(f"    {', '.join(group)}" for group in found[1]),
        f"upward imports: {len(upward)}",
        *(f"    {each}" for each in upward),
        f"imports of the package itself: {len(imports.of_package)}",
        *(f"    {each}" for each in imports.of_package),
        f"units without a rank: {', '.join(unranked) or 'none'}",
    ]
    return "\n".join(lines)


def _levels(imports: Imports, rank: dict[str, int]) -> Iterator[tuple[int, list[str]]]:
    for level in sorted(set(rank.values()), reverse=True):
        yield level, [name for name in imports.units if rank.get(name) == level]


def main() -> None:
    """Print the table of a folder."""
    parser = argparse.ArgumentParser(description="Print the layers of a package's imports.")
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    parser.add_argument("--order", default=ORDER)
    options = parser.parse_args()
    print(table(read_imports(options.folder), options.order))


if __name__ == "__main__":
    main()
