"""A backup of a Universal Robots controller: recognised, read with its installation, corrected; checked independently."""

# ruff: noqa: E501

from __future__ import annotations

import gzip
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.programs.backups import universal_robots as corpus
from tests.programs.backups.compare import listing
from tests.programs.backups.small import lay
from tests.programs.joint_arms import Sagging
from tests.programs.urp_files import (
    ANGLES,
    CALIBRATED,
    NOMINAL,
    Waypoint,
    as_transform,
    forward,
    installation,
    move,
    packed,
    program,
)

from truepose.programs import CorrectedProgram, ReadOptions, correct_program, read_programs
from truepose.programs.backups import universal_robots as backups
from truepose.programs.batch import correct_programs
from truepose.robots import load_robot

MAP = Sagging(load_robot("universal-robots-ur10e"))
ALL = ReadOptions(derived=True, joint_targets=True, controller_kinematics=True)
FILES = corpus.backup()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay(tmp_path_factory.mktemp("ur"), FILES)


@pytest.fixture(scope="module")
def corrected(folder: Path) -> list[CorrectedProgram]:
    found = read_programs([folder], None, ALL)
    assert not found.unreadable
    return [correct_program(one, MAP, on_guard="skip") for one in found.programs]


# a reader of its own: regular expressions, no code of the library

N = rb"\s*(-?\d+\.?\d*(?:e-?\d+)?)\s*"
POSE = rb"p\[" + b",".join([N] * 6) + rb"\]"
TARGETS = (
    re.compile(rb"move[lpj]\((?:pose_trans\((?P<feature>\w+),)?" + POSE),
    re.compile(rb"global wp_\w+ = " + POSE),
    re.compile(rb"take\(" + POSE),
)
IN_LIST = re.compile(rb"pts = \[(?:[^\]]*\],?)*")
HOME = re.compile(rb"(?<=movej\(\[)[^\]]*")
FEATURE = re.compile(rb"global (\w+) = " + POSE)


def commanded(target: np.ndarray) -> np.ndarray:
    """Return the position [mm] to command for a target, by the errors of the map."""
    command = target
    for _ in range(6):
        command = target - MAP.error(command)
    return command


def targets(data: bytes) -> Iterator[tuple[tuple[int, int], np.ndarray, np.ndarray]]:
    """Yield the bytes of the numbers of each constant target of a script, its numbers, and its feature."""
    own = {m[1].decode(): [float(x) for x in m.groups()[1:]] for m in FEATURE.finditer(data)}
    features = {**corpus.FEATURES, **own}
    for pattern in TARGETS:
        for m in pattern.finditer(data):
            groups = m.groups()[-6:]
            name = (m.groupdict().get("feature") or b"").decode()
            frame = as_transform(features[name]) if name in features else np.eye(4)
            yield (m.start(len(m.groups()) - 5), m.end(len(m.groups()))), np.array([float(x) for x in groups]), frame
    for listed in IN_LIST.finditer(data):
        for m in re.finditer(POSE, listed[0]):
            span = (listed.start() + m.start(1), listed.start() + m.end(6))
            yield span, np.array([float(x) for x in m.groups()]), as_transform(corpus.FEATURES["Pallet_1"])


def test_the_controller_is_recognised(folder: Path) -> None:
    files = listing(folder)
    (root,) = backups.roots(files)
    assert root == folder / "programs"
    found = backups.contents(root, files)
    assert len(found.programs) == 35
    assert (found.robot, found.version) == ("UR10e", "5.11.1")
    assert found.others[root / "press_2.script"] == "written by the controller from press_2.urp"
    assert any("load the .urp" in warning for warning in found.warnings)
    frames = backups.stored_frames(root, files)
    assert set(frames.tools) == set(corpus.TCPS)
    for name, values in corpus.FEATURES.items():
        tf = as_transform(values)
        np.testing.assert_allclose(frames.bases[name].tf[:3, 3], 1000.0 * tf[:3, 3], atol=1e-9)
        np.testing.assert_allclose(frames.bases[name].tf[:3, :3], tf[:3, :3], atol=1e-12)


@pytest.mark.exhaustive
def test_a_correction_of_zero_returns_every_file(folder: Path) -> None:
    for one in read_programs([folder], None, ALL).programs:
        done = correct_program(one, Sagging(MAP.robot, 0.0), on_guard="skip")
        for path, data in done.files.items():
            assert data == FILES[path.relative_to(folder).as_posix()], path


@pytest.mark.exhaustive
def test_every_constant_target_is_recomputed_in_the_base_frame(corrected: list[CorrectedProgram], folder: Path) -> None:
    """What changed in each script are the positions of its targets, each to the digit where the map wants it."""
    count = 0
    for one in corrected:
        for path, after in one.files.items():
            before = FILES[path.relative_to(folder).as_posix()]
            if path.suffix == ".urp":
                continue
            old, new = (sorted(targets(data), key=lambda found: found[0]) for data in (before, after))
            assert len(old) == len(new)
            for (_, was, frame), (_, now, _) in zip(old, new, strict=True):
                target = 1000.0 * (frame @ np.append(was[:3], 1.0))[:3]
                wanted = commanded(target) / 1000.0
                own = frame[:3, :3].T @ (wanted - frame[:3, 3])
                np.testing.assert_allclose(now[:3], own, atol=0.5e-6 + 1e-12, rtol=0)
                np.testing.assert_array_equal(now[3:], was[3:])
                count += 1
            assert remainder(before, old) == remainder(after, new), path
    assert count == 8 * 6 + 4 * 10 + 5 * 60 + 4 * 80 + 2 * 2


def remainder(data: bytes, found: list[tuple[tuple[int, int], np.ndarray, np.ndarray]]) -> bytes:
    """Return a file without the numbers of its targets."""
    parts, done = [], 0
    for (start, end), _, _ in found:
        parts.append(data[done:start])
        done = end
    return HOME.sub(b"", b"".join([*parts, data[done:]]))


def test_joint_targets_of_scripts_are_those_of_the_arm_of_the_map(
    corrected: list[CorrectedProgram], folder: Path
) -> None:
    tool, count = as_transform(corpus.TCPS["grip"]), 0
    for one in corrected:
        for path, after in one.files.items():
            before = FILES[path.relative_to(folder).as_posix()]
            for was, now in zip(HOME.findall(before), HOME.findall(after), strict=True):
                old, new = (1000.0 * (forward(NOMINAL, joints(text)) @ tool)[:3, 3] for text in (was, now))
                assert np.linalg.norm(new - commanded(old)) < 1e-3
                count += 1
    assert count == 8


def test_every_waypoint_is_recomputed_with_another_arm_model(corrected: list[CorrectedProgram], folder: Path) -> None:
    count, tool = 0, as_transform(corpus.TCPS["grip"])
    for one in corrected:
        for path, after in one.files.items():
            if path.suffix != ".urp":
                continue
            old, new = (gzip.decompress(data) for data in (FILES[path.relative_to(folder).as_posix()], after))
            assert ANGLES.sub(b"", old) == ANGLES.sub(b"", new)
            for m, changed in zip(ANGLES.finditer(old), ANGLES.finditer(new), strict=True):
                was, now = (1000.0 * (forward(CALIBRATED, joints(found[1])) @ tool)[:3, 3] for found in (m, changed))
                if b'type="Relative"' in old[old.rfind(b"<Waypoint", 0, m.start()) : m.start()]:
                    assert m[1] == changed[1]
                    continue
                assert np.linalg.norm(now - commanded(was)) < 1e-3
                count += 1
    assert count == 71


def joints(text: bytes) -> list[float]:
    return [float(part) for part in text.split(b",")]


@pytest.mark.exhaustive
def test_the_share_that_is_corrected(folder: Path, corrected: list[CorrectedProgram]) -> None:
    """More than 85 % of the targets of scripts are corrected with --derived; the others depend on the run time."""
    scripts = [one for one in corrected if one.program.language == "urscript"]
    done, total = (sum(getattr(one.coverage, key) for one in scripts) for key in ("corrected", "targets"))
    assert done / total > 0.97
    left = {
        outcome.reason
        for one in scripts
        for outcome in one.targets
        if outcome.target.motions and outcome.verdict == "skip" and not outcome.target.follows
    }
    assert {reason.partition(":")[0] for reason in left} <= {
        "joint target",
        "target computed at run time",
        "X",
        "target known at run time only",
    }, left
    whole, all_targets = (sum(getattr(one.coverage, key) for one in corrected) for key in ("corrected", "targets"))
    assert whole / all_targets > 0.95
    plain = [
        correct_program(one, MAP, on_guard="skip")
        for one in read_programs([folder]).programs
        if one.counts()["correct"]
    ]
    assert sum(one.coverage.corrected for one in plain) / all_targets < 0.85


@pytest.mark.exhaustive
def test_the_backup_comes_back_as_files_to_load(tmp_path: Path, folder: Path) -> None:
    batch = correct_programs([folder], MAP, options=ALL, on_guard="skip")
    batch.write(tmp_path / "out")
    written = {path.relative_to(tmp_path / "out").as_posix() for path in listing(tmp_path / "out")}
    assert {name for name in written if name.endswith((".urp", ".script", ".urscript"))} == {
        name for name in FILES if name.endswith((".urp", ".script", ".urscript")) and not _generated(name)
    }
    assert not any(name.endswith((".installation", ".variables", ".txt")) for name in written)


def _generated(name: str) -> bool:
    return name.endswith(".script") and name.removesuffix(".script") + ".urp" in FILES


@pytest.mark.exhaustive
def test_a_zip_differs_in_corrected_programs_alone(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "backup.zip", "w", zipfile.ZIP_DEFLATED) as packed_files:
        for name, data in FILES.items():
            packed_files.writestr(name, data)
    batch = correct_programs([tmp_path / "backup.zip"], MAP, options=ALL, on_guard="skip")
    batch.write(tmp_path / "out", whole=True)
    with zipfile.ZipFile(tmp_path / "out" / "backup.zip") as result:
        assert result.namelist() == list(FILES)
        same = {name for name in FILES if result.read(name) == FILES[name]}
        assert same == {
            name for name in FILES if _generated(name) or not name.endswith((".urp", ".script", ".urscript"))
        }
        text = gzip.decompress(result.read("programs/lathe.urp"))
    assert ANGLES.sub(b"", text) == ANGLES.sub(b"", gzip.decompress(FILES["programs/lathe.urp"]))


# incomplete and broken backups


def small(**files: bytes) -> dict[str, bytes]:
    point = Waypoint("W", [-1.5, -1.6, 1.9, -1.8, -1.5, 0.2], corpus.TCPS["grip"], NOMINAL, corpus.FEATURES["Table"])
    return {
        "default.installation": packed(installation(corpus.TCPS, "grip", corpus.FEATURES)),
        "a.urp": packed(program([move([point], feature="Table")], "a")),
        "b.script": b"def b():\n  movel(pose_trans(Table,p[0.1,0.2,0.3,0,3.1,0]))\nend\n",
        **{name.replace("__", "."): data for name, data in files.items()},
    }


def test_without_its_installation(tmp_path: Path) -> None:
    files = small()
    del files["default.installation"]
    folder = lay(tmp_path, files)
    (root,) = backups.roots(listing(folder))
    (warning,) = backups.contents(root, listing(folder)).warnings
    assert "1 programs name default.installation, which is not there" in warning
    reasons = {one.path.name: one.targets[0].reason for one in read_programs([folder], None, ALL).programs}
    assert "default.installation is not in the backup; add it" in reasons["a.urp"]
    assert "base Table is not known; give it in [frames.bases.Table]" in reasons["b.script"]


def test_two_installations_that_contradict_each_other(tmp_path: Path) -> None:
    moved = {**corpus.FEATURES, "Table": (0.7, -0.31, 0.0, 0.0, 0.0, 0.785)}
    folder = lay(tmp_path, small(other__installation=packed(installation(corpus.TCPS, "grip", moved))))
    stored = backups.stored_frames(folder, listing(folder))
    assert "states another one" in stored.bases["Table"].problem
    assert not stored.bases["Pallet_1"].problem
    verdicts = {one.path.name: one.targets[0].verdict for one in read_programs([folder], None, ALL).programs}
    assert verdicts == {"a.urp": "correct", "b.script": "skip"}  # a program of the editor names its installation


def test_programs_of_several_robots_are_told(tmp_path: Path) -> None:
    other = program([move([Waypoint("W", [-1.5, -1.6, 1.9, -1.8, -1.5, 0.2])])], "c", serial="20183512345")
    folder = lay(tmp_path, small(c__urp=packed(other)))
    found = backups.contents(folder, listing(folder))
    assert found.robot == "UR10e and UR5"
    assert any("were saved on 2 robots" in warning for warning in found.warnings)


def test_a_broken_program_does_not_block_the_others(tmp_path: Path) -> None:
    folder = lay(tmp_path, small(c__urp=b"\x1f\x8b\x08\0\0\0"))
    found = read_programs([folder], None, ALL)
    assert {one.path.name for one in found.programs} == {"a.urp", "b.script"}
    (error,) = found.unreadable
    assert "c.urp" in str(error)


@pytest.mark.promise("A broken installation of a UR backup is named, and refuses the programs that name it alone.")
def test_a_broken_installation_refuses_its_programs_alone(tmp_path: Path) -> None:
    twice = installation({"grip": corpus.TCPS["grip"]}, "grip", {}).replace(
        "</availablePoses>", '<tcp name="grip" offset="0,0,0,0,0,0"/></availablePoses>'
    )
    waypoint = Waypoint("W", corpus.HOME, corpus.TCPS["grip"])
    for text, why in ((twice, "grip is given twice"), ("<!DOCTYPE x []><Installation/>", "has a DOCTYPE")):
        other = packed(program([move([waypoint])], "other", installation="bench"))
        folder = lay(tmp_path, {**small(), "bench.installation": packed(text), "other.urp": other})
        found = read_programs([folder], None, ALL)
        assert not found.unreadable
        assert any(why in warning for warning in found.backups[0].controllers[0].contents.warnings)
        by_name = {one.path.name: one for one in found.programs}
        assert by_name["a.urp"].counts()["correct"] > 0
        assert [why in target.reason for target in by_name["other.urp"].targets] == [True]


@pytest.mark.promise("Each UR program has the installation that it names, of its folder or of the next one around it.")
def test_installations_of_one_name_in_several_folders(tmp_path: Path) -> None:
    """A program in a folder without one, where several lie elsewhere, is corrected only if all of them agree."""
    grip, nozzle = (installation(corpus.TCPS, name, {}) for name in ("grip", "nozzle"))
    files = {"default.installation": packed(grip), "press/default.installation": packed(nozzle)}
    for name, tcp in {"a": "grip", "press/b": "nozzle", "press/deep/c": "nozzle", "press/d": "grip"}.items():
        waypoint = Waypoint("W", corpus.HOME, corpus.TCPS[tcp])
        files[f"{name}.urp"] = packed(program([move([waypoint])]))
    named = program([move([Waypoint("W", corpus.HOME, corpus.TCPS["grip"])])])
    files["press/e.urp"] = packed(named.replace("directory=", 'installationRelativePath="../default" directory='))
    found = read_programs([lay(tmp_path, files)], None, ALL)
    assert not found.unreadable
    assert {one.path.stem: one.counts()["correct"] for one in found.programs} == {
        "a": 1,
        "b": 1,
        "c": 1,
        "d": 0,
        "e": 1,
    }
    files = {f"{name}/default.installation": packed(text) for name, text in {"x": grip, "y": nozzle}.items()}
    files["a.urp"] = files["x/b.urp"] = packed(program([move([Waypoint("W", corpus.HOME, corpus.TCPS["grip"])])]))
    found = read_programs([lay(tmp_path / "apart", files)], None, ALL)
    assert {one.path.stem: one.counts()["correct"] for one in found.programs} == {"a": 0, "b": 1}


def test_other_folders_are_no_backup(tmp_path: Path) -> None:
    assert backups.roots(listing(lay(tmp_path, {"a.script": b"def a():\nend\n", "b.src": b"DEF b()\nEND\n"}))) == []
