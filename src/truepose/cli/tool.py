"""The tool that readings imply, as import and fit show it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose.cli.output import say

if TYPE_CHECKING:
    from truepose.cell import Cell
    from truepose.geometry import Registration, ToolEstimate


def show_tool(cell: Cell, registration: Registration, found: ToolEstimate | None) -> None:
    """Show the fitted tool, or the tool that fits best beside the stated one, and whether the latter is suspect."""
    import numpy as np

    if (tool := registration.p_flange_tool) is not None:
        std = np.sqrt(np.diag(registration.covariance)[6:9])
        parts = ", ".join(f"{axis} {value:.3f} ± {s:.3f}" for axis, value, s in zip("xyz", tool, std, strict=True))
        away = float(np.linalg.norm(tool - cell.tf_flange_tool[:3, 3]))
        say(
            f"Fitted tool, flange to measured point: {parts} mm",
            f"  {away:.3f} mm from the tool in the cell file, which is the starting value.",
        )
    elif found is not None and found.suspect:
        say(f"[yellow]Warning[/]: {found.suspicion}.")
    elif found is not None:
        say(f"Tool: {found.words}; errors of the arm explain such a difference.")
