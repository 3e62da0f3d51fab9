"""The colours of all pictures, for light and dark schemes; pairs remain distinct for red-green blind readers."""

from __future__ import annotations

from typing import Any, Final

LIGHT: Final = {
    "ink": "#1c2430",
    "paper": "#ffffff",
    "soft": "#5d6978",
    "line": "#d9dee5",
    "card": "#f5f7f9",
    "before": "#c2562d",
    "after": "#1f77a4",
    "point": "#1f4e79",
    "weak": "#9db4c9",
    "model": "#c8501f",
    "band": "#dcdcdc",
    "theory": "#00856f",
    "arm": "#8f8577",
}
"""The colours by name, on light paper."""
DARK: Final = {
    "ink": "#e4e9ef",
    "paper": "#12161b",
    "soft": "#98a4b3",
    "line": "#313a45",
    "card": "#1a2027",
    "before": "#f0906a",
    "after": "#5fb0dc",
    "point": "#8cc4ff",
    "weak": "#5b7084",
    "model": "#ff8a5c",
    "band": "#39414b",
    "theory": "#1fae92",
    "arm": "#c9b79c",
}
"""The same on dark paper."""
CURVES: Final = (LIGHT["point"], LIGHT["model"], LIGHT["theory"], "#56b4e9", "#e6b800", "#f0a3c4")
"""The colours of curves in one picture."""
MARKERS: Final = ("o", "s", "^", "D", "v", "P")
"""Their markers, so that no curve is known by its colour alone."""
COLOURS: Final = {colour: name for name, colour in LIGHT.items() if name not in ("paper", "line", "card")}
"""The names of the colours in the pictures of a page, which replaces them."""

_INKED: Final = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")


def inked() -> dict[Any, Any]:
    """Return matplotlib's settings for text and axes in ink, which `adaptive` can replace."""
    return dict.fromkeys(_INKED, LIGHT["ink"])


def adaptive(svg: str) -> str:
    """Return an SVG file with a style sheet that exchanges its colours where the reader prefers a dark scheme."""
    rules = "".join(
        f'[style*="{kind}: {colour}"]{{{kind}:{DARK[name]}!important}}'
        for name, colour in LIGHT.items()
        for kind in ("fill", "stroke")
    )
    start = svg.index(">", svg.index("<svg")) + 1
    return f"{svg[:start]}\n<style>@media (prefers-color-scheme: dark){{{rules}}}</style>{svg[start:]}"
