"""Plans of 40 poses on virtual cells: what each method's poses leave, and whether that was to be expected.

Not a race: `python -m benchmarks.plans` prints the table that docs/validation shows. Every method measures the same ten
arms; the same model is fitted to each series and tried on the same held-out poses.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

import truepose as tp

METHODS = ("posterior", "posterior-largest", "d-optimal", "grid", "latin-hypercube", "sobol")
RESULTS = Path(__file__).parent.parent / "docs" / "validation" / "plans.md"
_HELD_OUT = 300


def main() -> None:
    """Parse the command line, run, print; write the table when asked."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.plans", description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--n", type=int, nargs="+", default=[20, 40, 80])
    parser.add_argument("--compared", type=int, default=40, help="the number at which methods are compared")
    parser.add_argument("--write", action="store_true", help=f"also write {RESULTS.name}")
    arguments = parser.parse_args()
    found: dict[tuple[str, int], list[float]] = defaultdict(list)
    expected: dict[tuple[str, int], float] = {}
    for seed in range(arguments.seeds):
        virtual = tp.VirtualCell("hard", seed=seed)
        held_out = virtual.measure(virtual.design(_HELD_OUT, seed=1_000), seed=1)
        for method in METHODS:
            for n in arguments.n if method == "posterior" else [arguments.compared]:
                plan = tp.plan(virtual.cell, n, method, seed=seed)
                error_map = tp.fit_cell(virtual.cell, virtual.measure(plan.q, seed=2), "kinematic-kriging")
                found[method, n].append(error_map.validate(held_out)["after"]["mean_mm"])
                expected[method, n] = plan.expected_mm
        print(seed, {f"{method} {n}": round(of[-1], 4) for (method, n), of in found.items()}, flush=True)
    text = _table(found, expected, arguments.seeds)
    print(text)
    if arguments.write:
        RESULTS.write_text(text, "utf-8")


def _table(found: dict[tuple[str, int], list[float]], expected: dict[tuple[str, int], float], seeds: int) -> str:
    lines = [
        "# Plans: what the poses chosen leave",
        "",
        f"Preset `hard`, seeds 0–{seeds - 1}; kinematic Kriging fitted to each plan's readings, mean over {_HELD_OUT}",
        "held-out poses [mm], noise included. The expected accuracy knows no reading.",
        "`python -m benchmarks.plans --write`",
        "",
        "| method | poses | median [mm] | range [mm] | expected [mm] | found / expected |",
        "|---|---|---|---|---|---|",
    ]
    for (method, n), of in sorted(found.items(), key=lambda item: (item[0][1], float(np.median(item[1])))):
        median, belief = float(np.median(of)), expected[method, n]
        lines.append(
            f"| {method} | {n} | {median:.4f} | {min(of):.4f}–{max(of):.4f} | {belief:.4f} | {median / belief:.2f} |"
        )
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
