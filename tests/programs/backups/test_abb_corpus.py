"""The backup of an ABB cell from reading to writing, checked by a reader of regular expressions."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.backups import abb as made
from tests.programs.backups.compare import zero_changes_no_byte
from tests.programs.backups.small import lay

from truepose.programs import CorrectedProgram, FrameTable, Program, ReadOptions, correct_program
from truepose.programs.backups import abb

N = r"[-+]?\d+(?:\.\d+)?"
TARGET = re.compile(rf"\[\[({N}),({N}),({N})\],\[({N},{N},{N},{N})\],\[-?\d+,-?\d+,-?\d+,-?\d+\],\[9E\+09,")
MOTION = re.compile(r"\b(?:Move[LJ]|Arc\w+|SearchL)\\?\w*[ ,]*(.*?),v\w+,(?:\w+,)*?(t\w+)(?:\\WObj:=(\w+))?;")
GAIN = np.array([[2e-4, 1e-4, 0.0], [-1e-4, 3e-4, 5e-5], [5e-5, 0.0, -2e-4]])
CONSTANT = np.array([0.21, -0.13, 0.08])
ACCEPTED = (
    r"joint target; allow joint_targets to correct it",
    r"target computed at run time: Offs\(pCorner3,i\*80,j\*60,nLayer\*42\.5\)",  # the layer comes from another task
    r"moved to with an offset that is known at run time only \(Pallet3\.mod, line 8\)",
    r"derived from pCorner3 \(line 3\), which is left out: moved to with an offset.*",
    r"its value is known at run time only",  # what a sensor found, and where the robot stands
    r"wVision is changed by the program \(Vision\.mod, line 6\).*",
    r"a system module; system modules are corrected if that is asked for \(--system-modules\)",
)
"""Reasons that a programmer accepts."""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay(tmp_path_factory.mktemp("backup"), made.backup())


def read(root: Path) -> list[Program]:
    files = sorted(path for path in root.rglob("*") if path.is_file())
    programs, errors = abb.read_all(root, files, FrameTable(), ReadOptions(derived=True))
    assert errors == []
    return programs


def corrected(root: Path, error_map: Any) -> dict[Path, bytes]:
    found: dict[Path, bytes] = {}
    for program in read(root):
        if len(program.targets):
            done: CorrectedProgram = correct_program(program, error_map, on_guard="skip")
            found |= done.files
    return found


def rotation(q: str) -> np.ndarray:
    a, b, c, d = np.array([float(x) for x in q.split(",")]) / np.linalg.norm([float(x) for x in q.split(",")])
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
        ]
    )


def transform(xyz: str, q: str) -> np.ndarray:
    tf = np.eye(4)
    tf[:3, :3], tf[:3, 3] = rotation(q), [float(x) for x in xyz.split(",")]
    return tf


def frames() -> dict[str, np.ndarray]:
    """Return the workobjects relative to the robot's base."""
    moc = {
        key: float(value) for key, value in re.findall(r"-base_frame_(\w+) ([\d.]+)", made.MOC.partition("SINGLE")[0])
    }
    p = ",".join(str(1000 * moc.get(f"pos_{axis}", 0.0)) for axis in "xyz")
    tf_world_base = transform(p, ",".join(str(moc.get(f"orient_u{k}", 0.0)) for k in range(4)))
    found = {"wobj0": np.linalg.inv(tf_world_base)}
    for name, value in made.WOBJS.items():
        poses = re.findall(r"\[\[([^\]]*)\],\[([^\]]*)\]\]", value)
        found[name] = found["wobj0"] @ transform(*poses[0]) @ transform(*poses[1])
    return found


def motions(texts: dict[str, str]) -> dict[str, set[tuple[str, str]]]:
    """Return the tools and workobjects under which each name is moved to, in its module or any."""
    found: dict[str, set[tuple[str, str]]] = {}
    for file, text in texts.items():
        local = set(re.findall(r"LOCAL (?:CONST|PERS) robtarget (\w+)", text))
        calls = {
            parameter: re.findall(rf"^ +{routine} (\w+);", text, re.M)
            for routine, parameter in re.findall(r"PROC (\w+)\(robtarget (\w+)\)", text)
        }
        for goal, tool, wobj in MOTION.findall(text):
            for name in re.findall(r"\bp[A-Z]\w*|\bTarget_\w+", goal):
                for one in calls.get(name, [name]):
                    found.setdefault(f"{file}:{one}" if one in local else one, set()).add((tool, wobj or "wobj0"))
    return found


@pytest.mark.exhaustive
def test_a_zero_correction_changes_no_byte(root: Path) -> None:
    assert zero_changes_no_byte(read(root))


def test_most_targets_are_corrected_and_the_others_for_good_reasons(root: Path) -> None:
    targets = [target for program in read(root) for target in program.targets if target.motions]
    cartesian = [target for target in targets if not target.reason.startswith("joint target")]
    left = [t for t in cartesian if t.verdict != "correct" and not (t.follows and "left out" not in t.reason)]
    assert len(cartesian) > 450
    assert len(left) <= 0.15 * len(cartesian), Counter(target.reason for target in left)
    for target in targets:
        if target.verdict != "correct" and not target.reason.endswith("it gets the correction of that point"):
            assert any(re.fullmatch(one, target.reason) for one in ACCEPTED), target


def test_corrected_numbers_are_those_of_an_independent_calculation(root: Path, make_map: Any) -> None:
    class Linear(make_map):
        def correct(self, poses: np.ndarray, **more: Any) -> Any:
            answer = super().correct(poses, **more)
            answer.p_command = answer.p_target + answer.p_target @ GAIN.T + CONSTANT
            return answer

    found = corrected(root, Linear())
    texts = {path.name: path.read_bytes().decode("latin-1") for path in found}
    tf, moved, checked = frames(), motions(texts), Counter[str]()
    for path, content in found.items():
        old = path.read_bytes().decode("latin-1")
        new = content.decode("latin-1")
        pairs = list(zip(TARGET.finditer(old), TARGET.finditer(new), strict=True))
        assert TARGET.sub("#", old) == TARGET.sub("#", new), path
        for before, after in pairs:
            assert before[4] == after[4]
            if before.groups() == after.groups():
                continue
            head = old[: before.start()]
            line = old[head.rfind("\n") + 1 : old.find(";", before.end())] + ";"
            if inline := re.search(r"(t\w+)(?:\\WObj:=(\w+))?;$", line):
                uses = {(inline[1], inline[2] or "wobj0")}
            else:
                declared = re.findall(r"robtarget (\w+)(?:\{\d+\})?:=", head)[-1]
                uses = moved.get(f"{path.name}:{declared}") or moved[declared]
            ((_, wobj),) = uses
            p = tf[wobj] @ [float(before[1]), float(before[2]), float(before[3]), 1.0]
            p[:3] += GAIN @ p[:3] + CONSTANT
            for token, expected in zip(after.groups()[:3], (np.linalg.inv(tf[wobj]) @ p)[:3], strict=True):
                decimals = len(token.partition(".")[2])
                assert decimals >= 2
                assert abs(float(token) - expected) <= 0.5 * 10.0**-decimals + 1e-9, (path, line)
            checked[wobj] += 1
    assert checked == {"wTable": 301, "wJig": 40, "wMachine": 20, "wobj0": 6, "wPallet": 2}
