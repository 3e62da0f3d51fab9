"""What a page shows of maps: entries of the list, and the facts of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, Field

from truepose.error_map import ErrorMap
from truepose.error_map.figures import fit_figures
from truepose.errors import TrueposeError, one_line
from truepose.predictors import KinematicKriging
from truepose.programs.agreement import same_robot
from truepose.verification import summary
from truepose.web.cache import ResultCache
from truepose.web.maps.arrays import box
from truepose.web.workspace import CellFolder, StoredFile, Workspace

Origin = Literal["samples after registration", "leave-one-out", "unseen blocks", "cross-validation"]
Point = tuple[float, float, float]


class Lengths(BaseModel):
    """Figures of error lengths in mm, and what they are of."""

    of: Origin
    n: int
    mean_mm: float
    rms_mm: float
    std_mm: float
    p95_mm: float
    max_mm: float


class MapEntry(BaseModel):
    """A map file of a cell."""

    sha: str = Field(description="SHA-256 of the file; the name of the map in addresses")
    file: str = Field(description="path in the cell's folder")
    modified: float = Field(description="seconds since 1970")
    size: int
    problem: str | None = Field(None, description="why the file cannot be used; then nothing else is known")
    predictor: str | None = None
    n: int | None = Field(None, description="samples of the fit")
    before: Lengths | None = None
    after: Lengths | None = None
    weak: bool | None = Field(None, description="not shown to be better than no map")
    robot_id: str | None = Field(None, description="id of the robot that was measured")
    other_robot: bool = Field(False, description="whether the cell file beside it states the id of another robot")


class MapFacts(MapEntry):
    """The facts of one map. Lengths in mm, base frame."""

    cell: str
    robot: str
    foreign: str | None = Field(None, description="how the map differs from the cell file beside it")
    space: Literal["cartesian", "joint"]
    low_mm: Point = Field(description="lowest corner of the samples' bounding box, base frame")
    high_mm: Point = Field(description="highest corner of the samples' bounding box, base frame")
    q_deg: list[float] | None = Field(None, description="joints of the sample nearest to the middle of the box")
    joint_curves: bool = Field(description="whether the map knows errors of single joints")
    local_std: bool = Field(description="whether the standard deviation depends on the pose")
    tf_base_tracker: list[list[float]] = Field(description="station of the tracker by the registration, mm")
    registered_rms_mm: float = Field(description="RMS error of the samples after registration")
    figures: dict[str, Any] = Field(description="the figures that 'truepose fit --json' prints")
    worth_words: str
    arm_words: str
    commands: dict[str, str] = Field(description="command lines that show the same, in the cell's folder")


def entry(workspace: Workspace, cache: ResultCache, file: StoredFile) -> MapEntry:
    """Return the entry of a map file; a broken or foreign one tells why it cannot be used."""
    about = {"file": one_line(file.name), "modified": file.modified, "size": file.size}
    try:
        sha = workspace.hash_of(file)
        known = cache.json(("entry", sha), lambda: _short(workspace.load(file)))
    except (TrueposeError, OSError) as error:
        return MapEntry(sha="", problem=one_line(str(error).replace(f"{file.path.parent}/", "")), **about)
    return MapEntry(sha=sha, **about, **known)


def of_cell(cell: CellFolder, entries: Sequence[MapEntry]) -> list[MapEntry]:
    """Return the entries of a cell's maps: those of its own robot first, the others marked as of another one."""
    try:
        own = cell.load().robot_id
    except (TrueposeError, OSError):
        own = None
    marked = [one.model_copy(update={"other_robot": _is_other(own, one.robot_id)}) for one in entries]
    return sorted(marked, key=lambda one: one.other_robot)


def _is_other(own: str | None, robot_id: str | None) -> bool:
    return own is not None and robot_id is not None and not same_robot(own, robot_id)


def _short(error_map: ErrorMap) -> dict[str, Any]:
    return {
        "predictor": error_map.predictor_name,
        "n": len(error_map.samples),
        "before": {"of": "samples after registration", **summary(error_map.e)},
        "after": {"of": "leave-one-out", **summary(error_map.leave_one_out().residual)},
        "weak": error_map.worth.weak,
        "robot_id": error_map.cell.robot_id,
    }


def facts(workspace: Workspace, cache: ResultCache, sha: str) -> MapFacts:
    """Return the facts of a map."""
    cell, file, error_map = workspace.map(sha)
    about = {"sha": sha, "file": one_line(file.name), "modified": file.modified, "size": file.size}
    known = cache.json(("facts", sha), lambda: {**_short(error_map), **_long(error_map)})
    return MapFacts(**about, cell=cell.id, foreign=_foreign(cell, error_map), commands=_commands(file), **known)


def _long(error_map: ErrorMap) -> dict[str, Any]:
    low, high = box(error_map)
    middle = np.argmin(np.linalg.norm(error_map.p_cmd - (low + high) / 2, axis=1))
    q = error_map.samples.q
    return {
        "robot": f"{error_map.robot.maker} {error_map.robot.model}".strip() or error_map.robot.name,
        "space": error_map.space,
        "low_mm": low,
        "high_mm": high,
        "q_deg": None if q is None else np.rad2deg(q[middle]),
        "joint_curves": isinstance(error_map.predictor, KinematicKriging),
        "local_std": error_map.predictor.has_local_std,
        "tf_base_tracker": error_map.registration.tf_base_tracker,
        "registered_rms_mm": summary(error_map.e)["rms_mm"],
        "figures": fit_figures(error_map),
        "worth_words": error_map.worth.words,
        "arm_words": _arm_words(error_map),
    }


def _arm_words(error_map: ErrorMap) -> str:
    """Return what the controller's positions say of arm and tool, and the readings of the reflector."""
    reflector = [fact.words for fact in error_map.facts if fact.code.startswith("reflector-")]
    return " ".join([error_map.arm_check.words, *(f"{words[0].upper()}{words[1:]}." for words in reflector)])


def _foreign(cell: CellFolder, error_map: ErrorMap) -> str | None:
    """Return how a map differs from the cell file beside it; None if it does not, or there is no valid cell file."""
    try:
        stated = cell.load()
        robot = stated.load_robot()
    except TrueposeError:
        return None
    if robot.name != error_map.robot.name:
        return f"the map is of {error_map.robot.name}, the cell file states {robot.name}"
    if _is_other(stated.robot_id, error_map.cell.robot_id):
        return f"the map is of the robot {error_map.cell.robot_id}, the cell file of {stated.robot_id}"
    if robot.dof != error_map.robot.dof or not np.allclose(robot.fixed, error_map.robot.fixed, atol=1e-6):
        return f"the map has other nominal parameters of {robot.name} than the cell file"
    if error_map.cell.tool.fit == "none" and not np.allclose(
        stated.tf_flange_tool, error_map.tf_flange_tool, atol=1e-3
    ):
        return "the map has another tool than the cell file"
    return None


def _commands(file: StoredFile) -> dict[str, str]:
    name = f'"{file.name}"' if any(letter.isspace() for letter in file.name) else file.name
    return {name_: f"truepose {name_} {name}" for name_ in ("explain", "validate", "predict", "report")}
