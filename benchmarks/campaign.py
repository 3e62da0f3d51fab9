"""How often the tests of a campaign raise a false alarm, and how well they find faults, on virtual cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.held_out import Page
from truepose import Samples, VirtualCell
from truepose.error_map.campaign import CampaignCheck, check_campaign
from truepose.error_map.registration import register_samples
from truepose.planning.planner import shortest_tour

PAGE = "campaign"
SIZE = 60

Order = Callable[[VirtualCell, np.ndarray], np.ndarray]
ORDERS: dict[str, Order] = {
    "mixed": lambda _cell, q: q,
    "short tour": lambda cell, q: q[shortest_tour(q, np.deg2rad(cell.preset.home_deg))],
    "sorted along x": lambda cell, q: q[np.argsort(cell.robot.forward(q, tool=cell.tf_flange_tool)[:, 0, 3])],
}


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study."""
    page = Page("Tests of a campaign on virtual cells", path)
    seeds = range(3 if quick else 50)
    page.say(f"{SIZE} samples, {len(seeds)} cells (seeds 0 …) of each kind; see [](../campaign.md).")
    page.say("## False alarms")
    page.head(["cell", "order of the plan", "campaigns", "named", "stopped"])
    for preset in ("paper", "hard", "heavy-tails", "rounding", "joint-step", "pedestal"):
        for name, order in ORDERS.items():
            found = [checked(cell, cell.measure(order(cell, cell.design(SIZE)))) for cell in cells(preset, seeds)]
            stopped = sum(any(c.size > one.limit for c in one.changes) for one in found)
            page.row(preset, name, len(found), sum(bool(one.changes) for one in found), stopped)
    page.say("## Faults that are found")
    page.say(
        "Standardised: root mean square of (estimate − truth) over its standard error. Named as another kind: a drift "
        "where it was a move, for example."
    )
    heads = ["cell", "order of the plan", "fault", "campaigns", "named", "as another kind", "stopped", "standardised"]
    page.head(heads)
    for preset in ("paper", "hard"):
        for name in ("mixed", "short tour"):
            for fault in FAULTS:
                found_row(page, preset, name, fault, seeds)


def found_row(page: Page, preset: str, order: str, fault: str, seeds: range) -> None:
    """Add the row of one fault."""
    kind, spoil, estimate = FAULTS[fault]
    named = other = stopped = 0
    far = []
    for cell in cells(preset, seeds):
        found = checked(cell, spoil(cell.measure(ORDERS[order](cell, cell.design(SIZE)))))
        own = [change for change in found.changes if change.kind == kind]
        named, other = named + bool(own), other + (not own and bool(found.changes))
        stopped += any(change.size > found.limit for change in found.changes)
        far += [estimate(change) for change in own]
    rms = float(np.sqrt(np.mean(np.square(far)))) if far else float("nan")
    page.row(preset, order, fault, len(seeds), named, other, stopped, rms)


def cells(preset: str, seeds: range) -> list[VirtualCell]:
    """Return virtual cells of one kind."""
    return [VirtualCell(preset, seed=seed) for seed in seeds]


def checked(virtual: VirtualCell, samples: Samples) -> CampaignCheck:
    """Return what the tests find."""
    cell, robot = virtual.cell, virtual.robot
    registration, tf_flange_tool, _ = register_samples(cell, robot, samples)
    return check_campaign(cell, robot, samples, registration, tf_flange_tool)


def _late(samples: Samples) -> np.ndarray:
    return (np.arange(len(samples)) >= len(samples) // 2)[:, None]


def _moved(samples: Samples, shift: float) -> Samples:
    return replace(samples, p_meas=samples.p_meas + _late(samples) * shift * np.array([0.6, -0.8, 0.0]))


def _turned(samples: Samples) -> Samples:
    centre = samples.p_meas.mean(axis=0)
    there = Rotation.from_rotvec([0.0, 0.0, 0.2e-3]).apply(samples.p_meas - centre) + centre
    return replace(samples, p_meas=np.where(_late(samples), there, samples.p_meas))


def _creeping(samples: Samples, path: float) -> Samples:
    share = np.linspace(0.0, 1.0, len(samples))[:, None]
    return replace(samples, p_meas=samples.p_meas + share * path * np.array([0.6, 0.0, 0.8]))


FAULTS = {
    "move of 10 mm": ("moved", lambda s: _moved(s, 10.0), lambda c: (c.shift - 10.0) / c.shift_std),
    "move of 0.3 mm": ("moved", lambda s: _moved(s, 0.3), lambda c: (c.shift - 0.3) / c.shift_std),
    "turn of 0.2 mrad about the samples": ("moved", _turned, lambda c: (c.turn - 0.2e-3) / c.turn_std),
    "creep of 0.5 mm": ("drift", lambda s: _creeping(s, 0.5), lambda c: (c.shift - 0.5) / c.shift_std),
    "scale of 0.5 %": (
        "scale",
        lambda s: replace(s, p_meas=1.005 * s.p_meas),
        lambda c: (c.scale - 5e-3) / c.scale_std,
    ),
}
"""By name: the kind as which it is to be found, what spoils samples, and the standardised error of the estimate."""
