"""Print how the code is built: rooms, the imports between them, and import circles.

A room is a package or a module directly below ``truepose``. All imports count: inside functions and under
``TYPE_CHECKING``, too. Run it with ``python tools/house.py``; it exits with 1 when there is a circle.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import grimp
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = "truepose"
SOURCE = Path(__file__).resolve().parents[1] / "src"
Arrow = tuple[str, str]


def main() -> int:
    """Print the house, and return 1 if it has circles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reach", metavar="MODULE", nargs="*", default=[], help="also count what a module imports")
    arguments = parser.parse_args()
    graph = grimp.build_graph(ROOT, cache_dir=None)
    arrows = [(a, b) for a in graph.modules for b in graph.find_modules_directly_imported_by(a)]

    files, lines, between = Counter[str](), Counter[str](), Counter[Arrow]()
    for module in graph.modules:
        files[room(module)] += 1
        lines[room(module)] += len(path_of(module).read_text("utf-8").splitlines())
    between.update((room(a), room(b)) for a, b in arrows if room(a) != room(b))
    print(f"{len(files)} rooms, {files.total()} files, {lines.total()} lines, {len(between)} arrows between rooms")
    for name in sorted(files):
        below = ", ".join(sorted(b for a, b in between if a == name)) or "nothing"
        print(f"  {name}: {files[name]} files, {lines[name]} lines; imports {below}")
    for module in arguments.reach:
        print(f"{module} reaches {len(graph.find_upstream_modules(module))} files")

    found = list(circles(graph, arrows))
    print(f"{len(found)} import circles")
    for where, members in found:
        print(f"  in {where}: {', '.join(members)}")
    return 1 if found else 0


def room(module: str) -> str:
    """Return the room of a module; the package's own face is a room of its own."""
    return module.split(".")[1] if "." in module else "__init__"


def path_of(module: str) -> Path:
    """Return the file of a module."""
    path = SOURCE.joinpath(*module.split("."))
    package = path / "__init__.py"
    return package if package.exists() else path.with_suffix(".py")


def circles(graph: grimp.ImportGraph, arrows: Iterable[Arrow]) -> Iterator[tuple[str, list[str]]]:
    """Yield the circles among the files, and among the children of every package."""
    arrows = list(arrows)
    for members in strongly_connected(arrows):
        yield "files", members
    for package in sorted(graph.modules):
        children = graph.find_children(package)
        if not children:
            continue
        above = {module: child for child in children for module in (child, *graph.find_descendants(child))}
        siblings = {(above[a], above[b]) for a, b in arrows if a in above and b in above and above[a] != above[b]}
        for members in strongly_connected(siblings):
            yield package, members


def strongly_connected(arrows: Iterable[Arrow]) -> list[list[str]]:
    """Return the groups of two or more names that reach each other."""
    arrows = list(arrows)
    names = sorted({name for arrow in arrows for name in arrow})
    place = {name: i for i, name in enumerate(names)}
    index = np.array([(place[a], place[b]) for a, b in arrows], dtype=np.int64).reshape(-1, 2)
    matrix = coo_array((np.ones(len(index)), (index[:, 0], index[:, 1])), shape=(len(names), len(names)))
    _, group = connected_components(matrix, connection="strong")
    return [[names[i] for i in np.flatnonzero(group == g)] for g, n in enumerate(np.bincount(group)) if n > 1]


if __name__ == "__main__":
    sys.exit(main())
