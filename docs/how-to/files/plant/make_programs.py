"""Write thirty KRL programs in three folders, as they may come from a plant; `--mended` corrects the two bad ones."""

import sys
from pathlib import Path

ABC = "A 180.0,B 20.0,C 180.0"
LINE_ENDS = ("\n", "\r\n")


def write_drilling(path: Path, n: int, depth: float, *, tool: int = 3, typo: bool = False) -> None:
    """Write a program with n taught points in its .dat; all keep the Turn of the first, which half of them outgrew."""
    moves, points = [], []
    for i in range(1, n + 1):
        x, y, z = f"{40 + depth:.3f}", -600 + 1200 * (i - 1) / (n - 1), 25 * (i % 5) - depth
        x = x.replace(".", "..") if typo and i == 3 else x
        moves.append(f"{'PTP' if i == 1 else 'LIN'} XP{i}")
        points.append(f"DECL E6POS XP{i}={{X {x},Y {y:.3f},Z {z:.3f},{ABC},S 2,T 10,E1 0.0}}")
        points.append(f"DECL FDAT FP{i}={{TOOL_NO {tool},BASE_NO 1,IPO_FRAME #BASE}}")
    write(path.with_suffix(".src"), [f"DEF {path.name}( )", *moves, "END"])
    write(path.with_suffix(".dat"), [f"DEFDAT {path.name.upper()}", *points, "ENDDAT"])


def write_milling(path: Path, n: int, z: float) -> None:
    """Write a path of n points as a CAM system does, with the coordinates in the .src."""
    frames = ["BAS(#TOOL,3)", "BAS(#BASE,1)"]
    start = f"PTP {{X 60.0,Y -500.0,Z {z:.3f},{ABC},S 2,T 10}}"
    cuts = [f"LIN {{X 60.0,Y {-500 + 1000 * k / n:.3f},Z {z:.3f},{ABC}}} C_DIS" for k in range(1, n + 1)]
    write(path.with_suffix(".src"), [f"DEF {path.name}( )", *frames, start, *cuts, "END"])


def write(path: Path, lines: list[str]) -> None:
    """Write lines; the line ends differ from folder to folder, because the programs come from several systems."""
    path.parent.mkdir(parents=True, exist_ok=True)
    end = LINE_ENDS[path.parent.name == "left"]
    path.write_bytes("".join(line + end for line in ["&ACCESS RVP", *lines]).encode())


def main(root: Path, *, mended: bool) -> None:
    """Write all programs below a folder."""
    for k in range(1, 13):
        side = "left" if k <= 6 else "right"
        write_drilling(root / "drilling" / side / f"rib{k:02}", 8 + k, 4.0 * k)
    for k in range(1, 11):
        write_milling(root / "milling" / f"skin{k:02}", 500 if k == 1 else 60, 20.0 * k)
    for k in range(1, 9):
        bad = 0 if mended else k
        write_drilling(root / "riveting" / f"door{k:02}", 20, -5.0 * k, tool=7 if bad == 4 else 3, typo=bad == 6)


main(Path("programs"), mended="--mended" in sys.argv)
