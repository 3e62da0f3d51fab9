"""The demonstration: from tracker readings of a virtual cell to a corrected program, through files.

The folder then holds the files of a real cell: cell.toml, plan.csv, the tracker's readings, samples, the map, a KRL
program, its corrected copy, and the report.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.files import write_atomic
from truepose._typing import FloatArray
from truepose.cell import Cell, load_cell
from truepose.error_map import ErrorMap, load_map
from truepose.error_map.fit import fit_cell
from truepose.errors import MissingPackageError
from truepose.geometry import apply_transform, euler, make_transform
from truepose.programs import FrameTable, correct_program, read_program, verify_program
from truepose.report.findings import structure_verdict
from truepose.report.locale import load_locale
from truepose.report.study import similarity_study
from truepose.robots import status_turn
from truepose.samples import Poses, Samples, read_poses, read_samples, write_samples
from truepose.simulation import VirtualCell
from truepose.trackers import import_readings, write_readings
from truepose.verification import accuracy

N_SAMPLES: Final = 160
N_HELD_OUT: Final = 100
EVERY_VIEW: Final = "kinematic-kriging"
"""A predictor whose map also tells the joints' own errors, so that every view of it has something to show."""
_PREDICTOR: Final = {"paper": "ordinary-kriging"}  # the paper's own; varying orientations need the arm's model
_TOOL, _BASE = 3, 1
_PANEL_ROWS, _PANEL_COLUMNS = 4, 6
_APPROACH_DEG: Final = 2.0
_TOLERANCE_MM: Final = 0.3
_TEMPERATURE_C: Final = 20.0


def run_demo(
    directory: Path,
    *,
    preset: str = "paper",
    seed: int = 0,
    predictor: str | None = None,
    progress: Callable[[str], Any],
) -> dict[str, Any]:
    """Run the demonstration and return its figures and paths; without the packages of a report, that path is None.

    Parameters
    ----------
    directory : Path
        The folder of all files.
    preset : str
        The name of a preset in `truepose.simulation.PRESETS`.
    seed : int
        The seed of the virtual cell.
    predictor : str, optional
        The predictor of the map, by its name; by default the paper's for its preset, else kinematic Kriging.
    progress : callable
        A function of a line about the current step.
    """
    virtual = VirtualCell(preset, seed=seed)
    progress("Planning and measuring")
    cell_path = directory / "cell.toml"
    write_atomic(cell_path, _stated(virtual).to_toml() + '\n[frames]\nconfig_dat = "program/$config.dat"\n')
    cell = load_cell(cell_path)
    samples = _measure(virtual, directory, "fit", N_SAMPLES, seed)
    held_out = _measure(virtual, directory, "held_out", N_HELD_OUT, seed + 1_000_003)

    progress("Fitting")
    predictor = predictor or _PREDICTOR.get(preset, EVERY_VIEW)
    fit_cell(cell, samples, predictor).save(directory / "map.truepose")
    error_map = load_map(directory / "map.truepose")  # so that the programs corrected with it are listed beside it
    progress("Looking for similarity")
    study = similarity_study(error_map)
    progress("Validating on held-out poses")
    held_out_figures = error_map.validate(held_out)

    progress("Correcting a program")
    source = _write_program(virtual, directory / "program")
    corrected = correct_program(source, error_map, cell)
    corrected.write(directory / "corrected", force=True)
    corrected_path = directory / "corrected" / source.name
    progress("Measuring the corrected program's targets")
    remeasured, (before, after) = _remeasure(virtual, error_map, directory, source, corrected_path)
    verified = verify_program(error_map, corrected_path, after, cell=cell, before=before)

    progress("Writing the report")
    report = directory / "report.html"
    sidecar = directory / "corrected" / f"{source.stem}.corrections.json"
    try:
        from truepose.report import write_report

        write_report(error_map, report, held_out, sidecars=[sidecar], verifications=[verified], study=study)
        written: Path | None = report
    except MissingPackageError as error:
        warnings.warn(f"the demonstration goes on without a report: {error}", UserWarning, stacklevel=2)
        written = None
    return {
        "preset": preset,
        "seed": seed,
        "robot": virtual.robot.name,
        "predictor": error_map.predictor_name,
        "n_samples": len(samples),
        "registration": "rigid registration of tracker to base",
        "similarity": structure_verdict(study.parts[0], load_locale("en")),
        **{
            key: held_out_figures[key]
            for key in ("before", "after", "reduction_mean_percent", "reduction_max_percent", "coverage", "groups")
        },
        "noise_floor_mm": virtual.noise_floor,
        "remeasured": remeasured,
        "verification": verified.sentences()[0],
        "report": written,
        "program": corrected_path,
    }


def _stated(virtual: VirtualCell) -> Cell:
    """Return the cell with the noise of its tracker and the facts of the report, as its user states them."""
    noise, today = virtual.preset.tracker, datetime.now(UTC).date()
    next_year = today.replace(year=today.year + 1, day=min(today.day, 28))
    tracker = {
        "range_um": 1e3 * noise.range_std,
        "range_um_per_m": 1e6 * noise.range_std_per_mm,
        "angle_um": 1e3 * noise.cross_std,
        "angle_um_per_m": 1e6 * noise.cross_std_per_mm,
    }
    facts: dict[str, Any] = {
        "company": "Demonstration of truepose",
        "site": "virtual cell",
        "operator": "truepose demo",
        "job": f"seed {virtual.seed}",
        "part": f"panel with {_PANEL_ROWS * _PANEL_COLUMNS} holes",
        "measured": today,
        "robot_serial": "virtual",
        "tracker": "virtual laser tracker",
        "tracker_serial": "virtual",
        "tracker_calibration_due": next_year,
        "reflector": "virtual, 1.5 in",
        "reflector_calibration_due": next_year,
        "temperature_C": _TEMPERATURE_C,
        "tolerance_mm": _TOLERANCE_MM,
    }
    known = virtual.cell.model_dump(mode="json", exclude_unset=True)
    known["tracker"] |= {name: round(value, 6) for name, value in tracker.items()}
    return Cell.model_validate({**known, "report": facts})


def _measure(virtual: VirtualCell, directory: Path, name: str, n: int, seed: int) -> Samples:
    """Plan n poses, measure them, and import the readings from the tracker's file."""
    lags = "backlash" in virtual.effects  # then it is measured, by coming to the poses from either side
    measured = virtual.measure(virtual.design(n, seed=seed), approach="order" if lags else None)
    measured = replace(measured, name=np.array([f"P{number}" for number in range(1, n + 1)]))
    plan_path, readings_path, samples_path = (
        directory / f"{name}_{kind}" for kind in ("plan.csv", "readings.txt", "samples.csv")
    )
    commanded = ("name", "q", "p_cmd", "rotation_cmd", "approach", "load", "temperature")
    write_samples(plan_path, Poses(**{name: getattr(measured, name) for name in commanded}))
    write_readings(readings_path, measured, "spatial-analyzer")
    samples, _ = import_readings(readings_path, read_poses(plan_path))
    write_samples(samples_path, samples)
    return read_samples(samples_path)


def _write_program(virtual: VirtualCell, directory: Path) -> Path:
    """Write a KRL program that drills a panel: taught points with FDAT in the .dat, and $config.dat with the frames."""
    tf_base_panel = make_transform(Rotation.identity(), np.asarray(virtual.preset.centre_mm))
    y, z = np.meshgrid(
        np.linspace(-0.4, 0.4, _PANEL_COLUMNS) * virtual.preset.size_mm[1],
        np.linspace(-0.4, 0.4, _PANEL_ROWS) * virtual.preset.size_mm[2],
    )
    x = 0.15 * virtual.preset.size_mm[0] * np.cos(np.pi * y / virtual.preset.size_mm[1])
    p_panel = np.stack([x, y, z], axis=-1).reshape(-1, 3).round(2)
    q = virtual.reach(apply_transform(tf_base_panel, p_panel))
    status, turn = status_turn(virtual.robot, q)
    a, b, c = virtual.preset.abc_deg
    moves, points = [], []
    for i, ((px, py, pz), s, t) in enumerate(zip(p_panel, status, turn, strict=True), 1):
        if "backlash" in virtual.effects:  # the virtual robot comes to each hole with all joints turning up
            before = ",".join(f"A{j} {a:.3f}" for j, a in enumerate(np.rad2deg(q[i - 1]) - _APPROACH_DEG, 1))
            moves.append(f"PTP {{{before}}}\nPTP XP{i}\nDRILL()\n")
        else:
            moves.append(f"{'PTP' if i == 1 else 'LIN'} XP{i}\nDRILL()\n")
        points.append(
            f"DECL E6POS XP{i}={{X {px:.3f},Y {py:.3f},Z {pz:.3f},A {a:.3f},B {b:.3f},C {c:.3f},S {s},T {t},E1 0.0}}\n"
            f'DECL FDAT FP{i}={{TOOL_NO {_TOOL},BASE_NO {_BASE},IPO_FRAME #BASE,POINT2[] " "}}\n'
        )
    source = directory / "panel.src"
    write_atomic(source, "&ACCESS RVP\nDEF panel( )\n" + "".join(moves) + "END\n\nDEF DRILL( )\nWAIT SEC 0.5\nEND\n")
    write_atomic(source.with_suffix(".dat"), "&ACCESS RVP\nDEFDAT PANEL\n" + "".join(points) + "ENDDAT\n")
    write_atomic(directory / "$config.dat", _config_dat(virtual.tf_flange_tool, tf_base_panel))
    return source


def _config_dat(tf_flange_tool: FloatArray, tf_base_panel: FloatArray) -> str:
    def frame(tf: FloatArray) -> str:
        values = [*tf[:3, 3], *euler("kuka", Rotation.from_matrix(tf[:3, :3]))]
        return "{" + ",".join(f"{name} {value:.4f}" for name, value in zip("XYZABC", values, strict=True)) + "}"

    tool, base = f"TOOL_DATA[{_TOOL}]={frame(tf_flange_tool)}", f"BASE_DATA[{_BASE}]={frame(tf_base_panel)}"
    return f"DEFDAT $CONFIG PUBLIC\n{tool}\n{base}\nENDDAT\n"


def _remeasure(
    virtual: VirtualCell, error_map: ErrorMap, directory: Path, original: Path, corrected: Path
) -> tuple[dict[str, Any], list[Path]]:
    """Run both programs on the virtual robot and measure their targets.

    Returns
    -------
    accuracy : dict
        The distances to the original targets, before and after.
    readings : list of Path
        The readings of the original and of the corrected program.
    """
    frames = FrameTable.from_config_dat(original.parent / "$config.dat")
    nominal = read_program(original, frames)
    targets = nominal.positions_base()
    names = np.array([target.name for target in nominal.targets if target.joint_form is None])
    paths, missed = [], []
    for name, program in (("original", original), ("corrected", corrected)):
        q = virtual.reach(read_program(program, frames).positions_base())
        measured = virtual.measure(q, approach=1.0 if "backlash" in virtual.effects else None)
        paths.append(directory / f"panel_{name}_readings.txt")
        write_readings(paths[-1], replace(measured, name=names), "spatial-analyzer")
        missed.append(apply_transform(error_map.registration.tf_base_tracker, measured.p_meas) - targets)
    return accuracy(*missed).to_dict(), paths
