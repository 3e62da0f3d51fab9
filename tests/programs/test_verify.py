"""Verification of programs: re-measured targets, the decision rule, the record, and the matching of readings."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.cell.sections import Correction, UncertaintySection
from truepose.geometry import apply_transform
from truepose.programs import read_program
from truepose.samples import Samples, write_samples
from truepose.trackers import Readings, write_readings
from truepose.verification import conformity

N = 8
TOLERANCE = 0.25
NOISE = 0.01


@dataclass(frozen=True)
class Proof:
    folder: Path
    error_map: tp.ErrorMap
    p: np.ndarray
    original: Path
    corrected: Path
    map_path: Path

    def readings(self, error: np.ndarray, *, names: bool = True, moved: np.ndarray | None = None) -> Readings:
        """Readings of targets whose errors (n, 3) [mm] are known, by a station that was moved on request."""
        p = apply_transform(self.error_map.registration.tf_tracker_base, self.p + error)
        p = p if moved is None else apply_transform(moved, p)
        own = np.array([f"p{k}" for k in range(N)]) if names else None
        return Readings(p, np.arange(2, N + 2), "readings.txt", p_std=np.full((N, 3), NOISE), name=own)


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> Proof:
    folder = tmp_path_factory.mktemp("proof")
    virtual = tp.VirtualCell("paper", seed=5)
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(60, seed=1)), "ordinary-kriging")
    map_path = folder / "map.truepose"
    error_map.save(map_path)
    error_map = tp.load_map(map_path)
    poses = error_map.robot.forward(virtual.design(N, seed=3), tool=error_map.tf_flange_tool)
    p = np.round(poses[:, :3, 3], 3)
    angles = tp.euler("kuka", Rotation.from_matrix(poses[:, :3, :3]))
    rows = [f"p{k}," + ",".join(f"{v:.3f}" for v in row) for k, row in enumerate(np.hstack([p, angles]))]
    original = folder / "part.csv"
    original.write_text("name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n" + "\n".join(rows) + "\n")
    corrected = tp.correct_program(original, error_map, on_guard="skip", accept_weak_map=True)
    assert corrected.summary()["corrected"] >= N - 2
    corrected.write(folder / "corrected")
    return Proof(folder, error_map, p, original, folder / "corrected" / "part.csv", map_path)


def along_x(*lengths: float) -> np.ndarray:
    return np.array(lengths)[:, None] * [1.0, 0.0, 0.0]


def test_errors_are_those_from_the_nominal_targets_of_the_record(proof):
    error = along_x(*np.linspace(0.0, 0.14, N))
    found = tp.verify_program(proof.error_map, proof.corrected, proof.readings(error), tolerance_mm=0.5)
    assert [t.error_mm for t in found.targets] == pytest.approx(np.linalg.norm(error, axis=1), abs=1e-6)
    assert found.targets[0].uncertainty_mm > 2 * NOISE  # the station counts, too
    assert found.decision == "pass"
    assert found.before == "predicted"
    assert found.record.endswith("part.corrections.json")
    assert found.figures["before"]["mean_mm"] > 0.01
    assert found.figures["after"]["p95_mm"] == pytest.approx(np.percentile(np.linalg.norm(error, axis=1), 95), abs=1e-6)


@pytest.mark.promise(
    "A target passes only if its error and the expanded uncertainty together are within the tolerance."
)
def test_decisions_follow_the_rule(proof):
    first = tp.verify_program(proof.error_map, proof.corrected, proof.readings(along_x(*[0.1] * N)), tolerance_mm=9.0)
    u = [t.uncertainty_mm for t in first.targets]
    lengths = [0.001, TOLERANCE - u[1] - 1e-3, TOLERANCE - u[2] + 1e-3, TOLERANCE + u[3] + 1e-3, *[0.001] * 4]
    found = tp.verify_program(
        proof.error_map, proof.corrected, proof.readings(along_x(*lengths)), tolerance_mm=TOLERANCE
    )
    assert [t.decision for t in found.targets][:4] == ["pass", "pass", "undecided", "fail"]
    assert found.decision == "fail"
    assert found.counts == {"pass": 6, "undecided": 1, "fail": 1}
    assert found.sentences()[0] == "FAIL: all 8 targets were measured; 6 pass, 1 undecided, 1 fail."
    assert "ISO 14253-1" in " ".join(found.sentences())
    assert "FAIL" in repr(found)


def test_the_uncertainty_is_combined_along_the_error(proof):
    """Reading, station and repeatability are known here; what is not stated is a line of the budget, and never zero."""
    error = along_x(*[0.1] * N)
    found = tp.verify_program(proof.error_map, proof.corrected, proof.readings(error), tolerance_mm=1.0)
    lines = {line.source: line for line in found.budget}
    assert set(lines) == {"reading", "reflector", "station", "tool", "repeatability", "temperature"}
    assert [name for name, line in lines.items() if line.u_mm is None] == ["reflector", "temperature"]
    assert sum(line.share for line in found.budget if line.share is not None) == pytest.approx(1.0)
    station = proof.error_map.registration
    for k, target in enumerate(found.targets):
        lever = proof.p[k] + error[k] - station.tf_base_tracker[:3, 3]
        turned = np.cross(np.eye(3), lever)[:, 0]  # what each turn of the station moves along x
        row = np.array([1.0, 0.0, 0.0, *turned])
        variance = NOISE**2 + row @ station.covariance[:6, :6] @ row + (lines["repeatability"].u_mm) ** 2
        assert target.uncertainty_mm == pytest.approx(2.0 * np.sqrt(variance), rel=1e-6)
    said = " ".join(found.sentences())
    assert "reflector: not stated ([uncertainty] reflector_mm)" in said
    assert "alike at all targets (registration)" in said


def test_what_the_cell_states_of_uncertainty_counts(proof):
    error = along_x(*[0.1] * N)
    section = {"reflector_mm": 0.03, "temperature_K": 4.0, "tool_mm": 0.1}
    stated = proof.error_map.cell.model_copy(update={"uncertainty": UncertaintySection(**section)})
    readings = proof.readings(error)
    bare, full = (
        tp.verify_program(proof.error_map, proof.corrected, readings, cell=cell, tolerance_mm=1.0)
        for cell in (None, stated)
    )
    lines = {line.source: line.u_mm for line in full.budget}
    assert lines["reflector"] == pytest.approx(0.03 / np.sqrt(3.0))
    along = 12e-6 * 4.0 / np.sqrt(3.0) * np.abs(proof.p[:, 0])  # towards the base, and the errors lie along x
    assert lines["temperature"] == pytest.approx(np.sqrt(np.mean(along**2)))
    assert lines["tool"] == 0.0  # the reflector is the tool of this program
    assert all(a.uncertainty_mm > b.uncertainty_mm for a, b in zip(full.targets, bare.targets, strict=True))


def test_shuffled_readings_match_by_name_and_by_position(proof):
    error = along_x(*np.linspace(0.0, 0.14, N))
    shuffled = proof.readings(error)[np.random.default_rng(0).permutation(N)]
    by_name = tp.verify_program(proof.error_map, proof.corrected, shuffled, tolerance_mm=1.0, match="name")
    nameless = replace(shuffled, name=None)
    by_position = tp.verify_program(proof.error_map, proof.corrected, nameless, tolerance_mm=1.0)
    assert [t.error_mm for t in by_name.targets] == [t.error_mm for t in by_position.targets]


def test_contradicting_names_are_refused(proof):
    wrong = proof.readings(np.zeros((N, 3)))
    swapped = replace(wrong, name=wrong.name[[1, 0, *range(2, N)]])
    with pytest.raises(tp.TrueposeError, match=r"line [23] \(p[01]\) lies .* mm from target p[01], whose name it has"):
        tp.verify_program(proof.error_map, proof.corrected, swapped, tolerance_mm=1.0)


def test_repeats_are_averaged_and_missing_targets_named(proof):
    once = proof.readings(np.zeros((N, 3)))
    part = replace(once[np.array([0, 0, 0, 0, 1])], p_std=np.full((5, 3), 0.02))
    found = tp.verify_program(proof.error_map, proof.corrected, part, tolerance_mm=1.0)
    assert [t.readings for t in found.targets] == [4, 1]
    reading = next(line for line in found.budget if line.source == "reading")
    assert reading.u_mm == pytest.approx(np.sqrt((0.01**2 + 0.02**2) / 2.0))
    assert found.unmeasured == tuple(f"p{k}" for k in range(2, N))
    assert found.decision == "not assessed"
    assert found.sentences()[0] == f"NOT ASSESSED: 2 of {N} targets were measured; 2 pass, 0 undecided, 0 fail."
    assert f"Not measured: {', '.join(found.unmeasured)}." in found.sentences()
    far = proof.readings(along_x(3.0, *[0.0] * (N - 1)))[np.array([0, 1])]
    assert tp.verify_program(proof.error_map, proof.corrected, far, tolerance_mm=1.0).decision == "fail"


@pytest.mark.parametrize("program", ["original", "corrected"])
@pytest.mark.parametrize("run", ["original", "corrected"])
def test_readings_of_another_run_are_named(proof, program, run):
    """The errors of a run without correction are those that the map predicts, those of a corrected run are small."""
    small = np.random.default_rng(2).normal(0.0, 0.01, (N, 3))
    poses = read_program(proof.original).poses_base()
    predicted = proof.error_map.correct(poses, on_guard="skip", accept_weak_map=True).e
    error = small + (predicted if run == "original" else 0.0)
    found = tp.verify_program(proof.error_map, getattr(proof, program), proof.readings(error), tolerance_mm=5.0)
    assert found.run == ("" if run == program else run)
    assert found.decision == ("pass" if run == program else "not assessed")
    said = "The readings are those of a corrected run" if run == "corrected" else "of a run without correction"
    assert any(said in text for text in found.sentences()) == (run != program)


def test_a_run_is_not_judged_where_the_map_changes_little(proof):
    """Errors that neither run explains are those of the robot, and not of another run."""
    error = np.random.default_rng(3).normal(0.0, 1.0, (N, 3))
    for program in (proof.original, proof.corrected):
        assert tp.verify_program(proof.error_map, program, proof.readings(error), tolerance_mm=5.0).run == ""


def test_a_moved_tracker_is_registered_again(proof):
    moved = np.eye(4)
    moved[:3, 3] = [150.0, -40.0, 3.0]
    rng = np.random.default_rng(1)
    readings = proof.readings(rng.normal(0.0, 0.02, (N, 3)), moved=moved)
    with pytest.raises(tp.TrueposeError, match=r"did the tracker stay where it was\? Register .* with --register"):
        tp.verify_program(proof.error_map, proof.corrected, readings, tolerance_mm=TOLERANCE)
    found = tp.verify_program(proof.error_map, proof.corrected, readings, tolerance_mm=TOLERANCE, register=True)
    assert found.decision == "pass"
    assert any("a common shift or turn of all targets" in text for text in found.sentences())
    nameless = replace(readings, name=None)
    again = tp.verify_program(proof.error_map, proof.corrected, nameless, tolerance_mm=TOLERANCE, register=True)
    assert [t.error_mm for t in again.targets] == pytest.approx([t.error_mm for t in found.targets])


def test_an_original_program_shows_the_errors_before(proof):
    error = along_x(*[0.5] * N)
    found = tp.verify_program(proof.error_map, proof.original, proof.readings(error), tolerance_mm=TOLERANCE)
    assert (found.record, found.before, found.decision) == ("", "", "fail")
    good = proof.readings(np.zeros((N, 3)))
    both = tp.verify_program(
        proof.error_map, proof.corrected, good, tolerance_mm=TOLERANCE, before=proof.readings(error)
    )
    assert both.before == "measured"
    assert both.figures["before"]["mean_mm"] == pytest.approx(0.5, abs=1e-5)


def test_a_changed_program_and_a_missing_record_are_refused(proof, tmp_path):
    readings = proof.readings(np.zeros((N, 3)))
    alone = tmp_path / "part.csv"
    alone.write_bytes(proof.corrected.read_bytes())
    with pytest.raises(tp.TrueposeError, match=r"its record NAME\.corrections\.json is missing"):
        tp.verify_program(proof.error_map, alone, readings, tolerance_mm=1.0)
    record = proof.corrected.with_name("part.corrections.json")
    (tmp_path / record.name).write_bytes(record.read_bytes())
    alone.write_bytes(proof.corrected.read_bytes().replace(b"p0,", b"p9,"))
    with pytest.raises(tp.TrueposeError, match=r"part\.csv was changed after the correction"):
        tp.verify_program(proof.error_map, alone, readings, tolerance_mm=1.0)


def test_one_program_of_a_corrected_folder_is_verified(proof, tmp_path):
    """The record of a project lists all its programs and lies above them; points of one name are in each."""
    project, half = tmp_path / "cell", N // 2
    for name, some in (("one", range(half)), ("two", range(half, N))):
        (project / name).mkdir(parents=True)
        lines = proof.original.read_text().splitlines()[1:]
        values = [lines[k].split(",")[1:] for k in some]
        points = [
            f"DECL E6POS XP{i}={{{','.join(f'{key} {v}' for key, v in zip('XYZABC', row, strict=True))}}}\n"
            for i, row in enumerate(values, 1)
        ]
        moves = "".join(f"LIN XP{i}\n" for i in range(1, half + 1))
        (project / name / f"{name}.dat").write_text(f"DEFDAT {name}\n{''.join(points)}ENDDAT\n")
        (project / name / f"{name}.src").write_text(f"DEF {name}()\n{moves}END\n")
    frames = replace(tp.FrameTable(), tools={1: proof.error_map.tf_flange_tool}, tool=1, base=0)
    tp.correct_program(project, proof.error_map, frames=frames, on_guard="skip", accept_weak_map=True).write(
        tmp_path / "out"
    )
    corrected = tmp_path / "out" / "two" / "two.src"
    error = np.linspace(0.01, 0.08, N)[:, None] * [1.0, 0.0, 0.0]
    names = np.array([f"P{i}" for i in range(1, half + 1)])
    p = proof.readings(error).p[half:]
    readings = Readings(p, np.arange(2, half + 2), "readings.txt", p_std=np.full((half, 3), NOISE), name=names)
    found = tp.verify_program(proof.error_map, corrected, readings, tolerance_mm=TOLERANCE, frames=frames)
    assert [target.name for target in found.targets] == [f"XP{i}" for i in range(1, half + 1)]
    np.testing.assert_allclose([target.error_mm for target in found.targets], error[half:, 0], atol=1e-6)
    assert (found.unmeasured, Path(found.record).name) == ((), "cell.corrections.json")
    with pytest.raises(tp.errors.RefusedError, match=r"was corrected already, see cell\.corrections\.json"):
        tp.correct_program(corrected, proof.error_map, frames=frames, on_guard="skip", accept_weak_map=True)


def test_tolerance_and_uncertainty_must_be_known(proof):
    readings = proof.readings(np.zeros((N, 3)))
    bare = proof.error_map.cell.model_copy(update={"correction": Correction()})
    with pytest.raises(tp.TrueposeError, match="no tolerance is known; state tolerance_mm under"):
        tp.verify_program(proof.error_map, proof.corrected, readings, cell=bare)
    stated = bare.model_copy(update={"correction": Correction(tolerance_mm=0.4)})
    found = tp.verify_program(proof.error_map, proof.corrected, readings, cell=stated)
    assert (found.tolerance_mm, found.tolerance_origin) == (0.4, "cell file")
    silent = bare.model_copy(update={"tracker": type(bare.tracker)()})
    with pytest.raises(tp.TrueposeError, match="the uncertainty of the readings is not known"):
        tp.verify_program(
            proof.error_map, proof.corrected, replace(readings, p_std=None), cell=silent, tolerance_mm=1.0
        )


def test_command_writes_csv_and_json_and_exits_with_1_if_a_target_fails(proof, run, tmp_path):
    error = along_x(0.0, 1.0, *[0.0] * (N - 2))
    readings = proof.readings(error)
    path = tmp_path / "tracker.csv"
    samples = Samples(p_cmd=proof.p, p_meas=readings.p, p_std=readings.p_std, name=readings.name)
    write_samples(path, samples)
    command = ("verify", proof.map_path, proof.corrected, path, "--tolerance", "0.25")
    done = run(*command, "--out", tmp_path / "proof.csv")
    assert done.code == 1
    assert "FAIL: all 8 targets were measured; 7 pass" in done.out
    assert max(map(len, done.out.splitlines()[:14])) <= 80
    rows = list(csv.DictReader(io.StringIO((tmp_path / "proof.csv").read_text())))
    assert [row["decision"] for row in rows] == ["pass", "fail", *["pass"] * (N - 2)]
    assert float(rows[1]["error_mm"]) == pytest.approx(1.0, abs=1e-5)
    done = run(*command[:4], "--tolerance", "2", "--json")
    assert done.code == 0
    assert done.json["decision"] == "pass"
    assert len(done.json["targets"]) == N


def test_any_layout_of_import_is_read(proof, tmp_path):
    readings = proof.readings(np.zeros((N, 3)))
    samples = Samples(p_cmd=proof.p, p_meas=readings.p, name=readings.name)
    for layout in ("spatial-analyzer", "leica", "columns"):
        write_readings(tmp_path / "r.txt", samples, layout)
        found = tp.verify_program(
            proof.error_map, proof.corrected, tmp_path / "r.txt", tolerance_mm=0.2, uncertainty_mm=0.01
        )
        assert found.decision == "pass"


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan")])
def test_conformity_refuses_a_tolerance_that_is_none(tolerance):
    with pytest.raises(tp.TrueposeError, match="expected a positive tolerance"):
        conformity([0.1], [0.01], tolerance)


def test_the_options_of_measurement_files_are_those_of_import(run, proof, tmp_path):
    readings = proof.readings(along_x(*np.linspace(0.0, 0.14, N)))
    inches = tmp_path / "inches.txt"
    inches.write_text("".join(f"p{k} {x:.7f} {y:.7f} {z:.7f}\n" for k, (x, y, z) in enumerate(readings.p / 25.4)))
    verify = ("verify", proof.map_path, proof.corrected, inches, "--tolerance", TOLERANCE, "--uncertainty", NOISE)
    saved = tmp_path / "columns.toml"
    columns = ("--columns", "name=1, x=2, y=3, z=4, unit=in", "--save-columns", saved)
    found = run(*verify, *columns, "--json").json
    assert [t["error_mm"] for t in found["targets"]] == pytest.approx(np.linspace(0.0, 0.14, N), abs=1e-5)
    assert run(*verify, "--columns", saved, "--json").json["targets"] == found["targets"]
    bare = tmp_path / "bare.csv"
    bare.write_text("".join(f"p{k},{x:.7f},{y:.7f},{z:.7f}\n" for k, (x, y, z) in enumerate(readings.p / 25.4)))
    wrong = run(*verify[:3], bare, *verify[4:])
    assert "are its lengths in mm (if not, pass --unit)" in wrong.failed()
    assert run(*verify[:3], bare, *verify[4:], "--unit", "in", "--json").json["targets"] == found["targets"]
    twice = tmp_path / "twice.csv"  # two reflectors per target, the second of which is that of the map
    twice.write_text(
        "".join(f"{x + 50:.7f},{y:.7f},{z:.7f}\n{x:.7f},{y:.7f},{z:.7f}\n" for x, y, z in readings.p / 25.4)
    )
    kept = run(*verify[:3], twice, *verify[4:], "--unit", "in", "--reflectors", 2, "--keep", 2, "--json").json
    assert [t["error_mm"] for t in kept["targets"]] == [t["error_mm"] for t in found["targets"]]
    assert "--keep has no effect without --reflectors; give both" in run(*verify, "--keep", 2).failed()
