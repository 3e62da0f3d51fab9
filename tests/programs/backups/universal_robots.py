"""A backup of a Universal Robots controller, of our own invention: one UR10e that handles, palletises, deburrs and glues.

`backup()` returns the files by their names; the same on every call. Real backups have this layout: programs of the
editor with one installation, scripts that the controller wrote beside them, scripts of offline systems and of
programmers, in subfolders, with LF and CR LF, some without a final newline.
"""
# ruff: noqa: E501

from __future__ import annotations

from collections.abc import Sequence
from random import Random

import numpy as np
from tests.programs.urp_files import CALIBRATED, Waypoint, forward, installation, listed, move, packed, program

TCPS = {
    "TCP": (0.0,) * 6,
    "grip": (0.0, 0.0, 0.1745, 0.0, 0.0, 0.0),
    "spindle": (0.012, -0.0305, 0.2102, 0.0, 0.7853981633974483, 0.0),
    "nozzle": (-0.0451, 0.0012, 0.1633, 0.0, -0.5235987755982988, 0.0),
}
FEATURES = {
    "Table": (0.6512, -0.3104, 0.0125, 0.001, -0.002, 0.7851),
    "Fixture_A": (0.4523, 0.3871, 0.1042, 0.0, 0.0, -1.2),
    "Pallet_1": (-0.3514, 0.6105, -0.0513, 0.002, 0.001, 0.1),
}
HOME = (-1.5707963, -1.5707963, -1.5707963, -1.5707963, 1.5707963, 0.0)
TOOL_DOWN = (2.2214, -2.2214, 0.0)
CELLS = ("press_1", "press_2", "lathe", "washer", "laser", "scale", "camera", "buffer")


def pose(x: float, y: float, z: float, r: Sequence[float] = TOOL_DOWN, decimals: int = 6) -> str:
    return "p[" + ",".join(f"{value:.{decimals}f}" for value in (x, y, z, *r)) + "]"


def place(random: Random, decimals: int = 6) -> str:
    """Return a pose in reach, in the base."""
    angle, radius = random.uniform(-1.2, 1.2), random.uniform(0.45, 0.85)
    return pose(radius * np.cos(angle), radius * np.sin(angle), random.uniform(0.05, 0.5), decimals=decimals)


def handling(name: str, random: Random) -> str:
    """Return a program that loads a machine: named poses, approaches, functions."""
    grip = listed(TCPS["grip"]).replace(" ", "")
    return f"""def {name}():
  set_tcp(p[{grip}])
  set_payload(1.2, [0.0, 0.0, 0.06])
  global up = p[0,0,0.08,0,0,0]
  global wp_pick = {place(random)}
  global wp_place = {place(random)}
  global wp_park = {place(random)}
  global wp_turn = {place(random)}
  def close():
    set_standard_digital_out(0, True)
    sleep(0.3)
  end
  def open():
    set_standard_digital_out(0, False)
    sleep(0.3)
  end
  def take(target, speed):
    movej(pose_add(target, up), a=1.2, v=1.0)
    movel(target, a=1.2, v=speed)
    close()
    movel(pose_add(target, up), a=1.2, v=0.25)
  end
  movej([{", ".join(map(repr, HOME))}], a=1.4, v=1.05)
  take({place(random)}, 0.1)
  take({place(random)}, 0.08)
  movel(wp_turn, a=1.2, v=0.25, r=0.02)
  movel(pose_trans(wp_place, p[0,0,-0.06,0,0,0]), a=1.2, v=0.25)
  movel(wp_place, a=1.2, v=0.05)
  open()
  above = wp_pick
  above[2] = above[2] + 0.1
  movel(above, a=1.2, v=0.25)
  movel(wp_pick, a=1.2, v=0.05)
  movej(wp_park)
end
"""


def palletising(name: str, random: Random) -> str:
    """Return a program with a list of places in a feature of the installation."""
    rows = [f"p[{0.08 * (k % 3):.4f}, {0.12 * (k // 3):.4f}, 0.0450, 0.0000, 3.1416, 0.0000]" for k in range(9)]
    listing = ",\n    ".join(rows)
    return f"""def {name}():
  set_tcp(p[0.0, 0.0, 0.1745, 0.0, 0.0, 0.0])
  global wp_feed = {place(random)}
  lift = p[0, 0, -0.12, 0, 0, 0]
  pts = [{listing}]
  i = 0
  while i < size(pts):
    movej(pose_trans(wp_feed, lift))
    movel(wp_feed, a=0.8, v=0.1)
    set_tool_digital_out(0, True)
    movel(pose_trans(wp_feed, lift))
    movel(pose_trans(Pallet_1, pts[i]), a=0.8, v=0.1)
    set_tool_digital_out(0, False)
    i = i + 1
  end
end"""


def cam(name: str, random: Random, n: int, feature: str, tcp: str, word: str = "movel") -> str:
    """Return a path of an offline system in a feature that the program states."""
    lines = [
        f"def {name}():",
        f"  global {feature} = p[{listed(FEATURES[feature])}]",
        f"  set_tcp(p[{listed(TCPS[tcp])}])",
    ]
    lines += ["  accel_mss=1.2", "  speed_ms=0.05"]
    phase = random.uniform(0, 6)
    for k in range(n):
        turn = phase + 0.05 * k
        at = pose(0.12 * np.cos(turn), 0.08 * np.sin(turn), 0.01 + 0.0005 * k, (3.1416, 0.0, 0.002 * k), 5)
        lines.append(f"  {word}(pose_trans({feature},{at}),accel_mss,speed_ms,0,0.0005)")
    return "\r\n".join([*lines, "end", ""])


def path(name: str, random: Random, n: int) -> str:
    """Return a path of an offline system in the base: one motion a line."""
    x, y = random.uniform(0.45, 0.6), random.uniform(-0.3, 0.3)
    lines = [f"def {name}():", f"  set_tcp(p[{listed(TCPS['nozzle'])}])"]
    for k in range(n):
        at = pose(x + 0.002 * k, y + 0.02 * np.sin(0.1 * k), 0.12, (0.0, 3.14159, 0.0))
        lines.append(f"  movep({at}, a=1.2, v=0.05, r=0.001)")
    return "\n".join([*lines, "end", name + "()", ""])


def measuring(name: str, random: Random) -> str:
    """Return a program whose targets come from a camera, beside some that are constant."""
    return f"""def {name}():
  set_tcp(p[0.0,0.0,0.1745,0.0,0.0,0.0])
  global wp_look = {place(random)}
  global wp_drop = {place(random)}
  socket_open("192.168.10.20", 4000)
  while True:
    movej(wp_look)
    found = socket_read_ascii_float(6)
    target = p[found[1], found[2], found[3], 0, 3.1416, 0]
    movel(pose_add(target, p[0,0,0.05,0,0,0]))
    movel(target)
    movel(wp_drop)
  end
end
"""


def waypoints(random: Random, names: Sequence[str], tcp: str, feature: str = "") -> list[Waypoint]:
    """Return waypoints whose joints were taught near one place."""
    middle = np.array([random.uniform(-2.2, -0.6), -1.6, 1.9, -1.85, -1.55, 0.2])
    frame = FEATURES[feature] if feature else (0.0,) * 6
    return [
        Waypoint(name, middle + [random.uniform(-0.12, 0.12) for _ in range(6)], TCPS[tcp], CALIBRATED, frame)
        for name in names
    ]


def editor(name: str, random: Random, k: int) -> str:
    """Return a program of the editor: a MoveJ, a MoveL in a feature, logic around them."""
    first = waypoints(random, [f"{name}_start", f"{name}_via"], "grip")
    inside = waypoints(random, [f"{name}_{i}" for i in range(3 + k % 3)], "grip", "Table")
    shared = '<feature class="GeomFeatureReference" reference="../../Move[1]/feature"/>'
    again = '\n    <Waypoint reference="../../../Move[1]/children/Waypoint[1]"/>'
    nodes = [
        move(first, "MoveJ"),
        move(inside, "MoveL", "Table"),
        '\n  <Set type="DigitalOutput"><pin referencedName="digital_out[0]"/><digitalValue>1</digitalValue></Set>',
        '\n  <Wait type="Sleep"><waitTime>0.4</waitTime></Wait>',
        move([again], "MoveL", shared),
    ]
    if k % 4 == 0:
        nodes.append(move([Waypoint(f"{name}_lift", first[0].q, TCPS["grip"], CALIBRATED, kind="Relative")]))
    return program(nodes, name)


def saved_script(name: str, random: Random) -> str:
    """Return a script as the controller writes it beside a program."""
    q = waypoints(random, ["a"], "grip")[0].q
    tf = forward(CALIBRATED, q)
    return f"def {name}():\n  global a_p={pose(*tf[:3, 3])}\n  movel(a_p, a=1.2, v=0.25)\nend\n"


def backup() -> dict[str, bytes]:
    """Return the files of the backup."""
    random = Random(14)
    files = {
        "programs/default.installation": packed(installation(TCPS, "grip", FEATURES), "default"),
        "programs/default.variables": b'counter=12\nlast_part="A7"\n',
    }
    for k, cell in enumerate(CELLS):
        files[f"programs/load_{cell}.script"] = handling(f"load_{cell}", random).encode()
        files[f"programs/{cell}.urp"] = packed(editor(cell, random, k), cell)
        if k % 2:
            files[f"programs/{cell}.script"] = saved_script(cell, random).encode()
            files[f"programs/{cell}.txt"] = b" Program\n   Robot Program\n     MoveJ\n"
    for k in range(4):
        files[f"programs/pallets/layer_{k}.script"] = palletising(f"layer_{k}", random).encode()
        files[f"programs/pallets/pallet_{k}.urp"] = packed(editor(f"pallet_{k}", random, k + 1), "")
    for k, feature in enumerate(("Table", "Fixture_A", "Fixture_A", "Table", "Fixture_A")):
        name = f"deburr_{k}"
        files[f"programs/cam/{name}.script"] = cam(name, random, 60, feature, "spindle").encode()
    for k in range(4):
        files[f"programs/cam/glue_{k}.urscript"] = path(f"glue_{k}", random, 80).encode()
    for k in range(2):
        files[f"programs/camera_{k}.script"] = measuring(f"camera_{k}", random).encode()
    return files
