"""Print how the code is built: rooms, the imports between them, and import circles.

A room is a package or a module directly below ``truepose``. All imports count: inside functions and under
``TYPE_CHECKING``, too. Run it with ``python tools/house.py``; it exits with 1 when there is a circle. With
``--svg FILE`` it also draws the rooms; the page "How it is built" of the documentation shows this drawing.
"""

from __future__ import annotations

import argparse
import ast
import html
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import grimp
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

ROOT = "truepose"
SOURCE = Path(__file__).resolve().parents[1] / "src"
Arrow = tuple[str, str]
EVERYWHERE = {"_deprecated", "_lazy", "_typing", "_version", "errors"}
"""Modules that many import and that import no room; they are not drawn."""


@dataclass(frozen=True)
class Room:
    """A package or module below ``truepose``: how large it is, and the first line of its docstring."""

    files: int
    lines: int
    purpose: str


def main() -> int:
    """Print the house, and return 1 if it has circles."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reach", metavar="MODULE", nargs="*", default=[], help="also count what a module imports")
    parser.add_argument("--svg", metavar="FILE", type=Path, help="draw the rooms")
    arguments = parser.parse_args()
    graph, rooms, between = build()
    arrows = [(a, b) for a in graph.modules for b in graph.find_modules_directly_imported_by(a)]
    files, lines = (sum(getattr(found, key) for found in rooms.values()) for key in ("files", "lines"))
    print(f"{len(rooms)} rooms, {files} files, {lines} lines, {len(between)} arrows between rooms")
    for name, found in sorted(rooms.items()):
        below = ", ".join(sorted(b for a, b in between if a == name)) or "nothing"
        print(f"  {name}: {found.files} files, {found.lines} lines; imports {below}")
    if arguments.svg:
        arguments.svg.write_text(drawing(rooms, between), "utf-8")
    for module in arguments.reach:
        print(f"{module} reaches {len(graph.find_upstream_modules(module))} files")

    found = list(circles(graph, arrows))
    print(f"{len(found)} import circles")
    for where, members in found:
        print(f"  in {where}: {', '.join(members)}")
    return 1 if found else 0


def build() -> tuple[grimp.ImportGraph, dict[str, Room], set[Arrow]]:
    """Return the graph of imports, the rooms by name, and the imports between rooms."""
    graph = grimp.build_graph(ROOT, cache_dir=None)
    files, lines = Counter[str](), Counter[str]()
    for module in graph.modules:
        files[room(module)] += 1
        lines[room(module)] += len(path_of(module).read_text("utf-8").splitlines())
    rooms = {name: Room(files[name], lines[name], purpose(name)) for name in files}
    arrows = ((room(a), room(b)) for a in graph.modules for b in graph.find_modules_directly_imported_by(a))
    return graph, rooms, {(a, b) for a, b in arrows if a != b}


def purpose(name: str) -> str:
    """Return the first line of a room's docstring."""
    path = path_of(ROOT if name == "__init__" else f"{ROOT}.{name}")
    return (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").split("\n")[0]


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


def floors(names: Iterable[str], between: set[Arrow]) -> tuple[dict[str, int], set[Arrow]]:
    """Return how far below the top each room lies, and the imports that no longer way implies."""
    order = sorted(names)
    direct = np.array([[(a, b) in between for b in order] for a in order])
    walks, depth, reach = np.eye(len(order), dtype=bool), np.zeros(len(order), dtype=int), np.zeros_like(direct)
    for length in range(1, len(order) + 1):
        walks = walks @ direct
        reach |= walks
        depth[walks.any(axis=0)] = length
    if walks.any():
        raise ValueError("rooms import each other in a circle; run tools/house.py")
    needed = direct & ~(direct @ reach)
    return dict(zip(order, depth.tolist(), strict=True)), {(order[a], order[b]) for a, b in np.argwhere(needed)}


def drawing(rooms: dict[str, Room], between: set[Arrow]) -> str:
    """Return an SVG: a box for each room, arrows to what it imports; arrows that others imply are left out."""
    width, height, box, gap = 860, 88, 132, 40
    shown = [name for name in rooms if name not in EVERYWHERE]
    depth, needed = floors(shown, {(a, b) for a, b in between if a in shown and b in shown})
    place: dict[str, tuple[float, float]] = {}
    for level in range(max(depth.values()) + 1):
        row = [name for name in shown if depth[name] == level]
        row.sort(key=lambda name: (np.mean([place[a][0] for a, b in needed if b == name] or [0.0]), name))
        left = (width - len(row) * (box + gap) + gap + box) / 2
        place |= {name: (left + k * (box + gap), level * height + 24.0) for k, name in enumerate(row)}
    attributes = 'font-family="sans-serif" font-size="13" role="img" aria-label="Rooms and their imports"'
    tip = '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    view = f"0 0 {width} {(max(depth.values()) + 1) * height}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view}" {attributes}>',
        f'<defs>{tip}<path d="M0 0L8 4L0 8z" fill="currentColor"/></marker></defs>',
        *(_arrow(*place[a], *place[b]) for a, b in sorted(needed)),
        *(_box(ROOT if name == "__init__" else name, rooms[name], *place[name], box) for name in place),
    ]
    return "\n".join([*parts, "</svg>"])


def _arrow(x: float, y: float, u: float, v: float) -> str:
    bend = f"C{x:.0f} {y + 70:.0f} {u:.0f} {v - 60:.0f} {u:.0f} {v - 23:.0f}"
    stroke = 'fill="none" stroke="currentColor" opacity="0.6" marker-end="url(#tip)"'
    return f'<path d="M{x:.0f} {y + 22:.0f}{bend}" {stroke}/>'


def _box(label: str, found: Room, x: float, y: float, width: float) -> str:
    shape = f'x="{x - width / 2:.0f}" y="{y - 22:.0f}" width="{width}" height="44" rx="6"'
    text = f'<text x="{x:.0f}" text-anchor="middle" fill="#16212c"'
    return (
        f'<g><title>{html.escape(found.purpose)}</title><rect {shape} fill="#dbe6f1" stroke="#51687f"/>'
        f'{text} y="{y - 3:.0f}" font-weight="bold">{label}</text>'
        f'{text} y="{y + 14:.0f}" font-size="11">{found.files} files, {found.lines} lines</text></g>'
    )


if __name__ == "__main__":
    sys.exit(main())
