"""What the tests of a measuring campaign found, on a screen."""

from __future__ import annotations

from typing import Any

from truepose.cli.output import say


def show_campaign(campaign: dict[str, Any]) -> None:
    """Show each fault of a campaign, or that there were too few samples to test."""
    for fault in campaign.get("faults", []):
        rms = f"{fault['size']:.3f} ± {fault['size_std']:.3f} mm"
        say(f"[yellow]Warning[/]: {fault['words']}; root mean square over the samples {rms}.")
    if campaign and not campaign["tested"]:
        say("[yellow]Note[/]: too few samples to test for a moved tracker, a scale or a drift.")
