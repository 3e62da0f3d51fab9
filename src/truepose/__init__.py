"""Positional error maps of industrial robots: from tracker readings to corrected programs.

Positions are mm, angles rad, errors are measured − commanded in the robot base frame. The names here are the public
interface; each is imported when it is first used, so that ``import truepose`` is fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.cell import Cell, load_cell
    from truepose.error_map import ErrorMap, FrozenMap, load_map, recheck, update_map
    from truepose.error_map.arm_check import check_point
    from truepose.error_map.fit import fit_cell
    from truepose.error_map.selection import choose
    from truepose.errors import TrueposeError
    from truepose.geometry import euler, register, register_with_tool
    from truepose.planning import plan
    from truepose.predictors import (
        GridCell,
        InverseDistance,
        KinematicCalibration,
        KinematicKriging,
        LocalKriging,
        Nearest,
        OrdinaryKriging,
        RadialBasis,
        ResidualNetwork,
        SimpleKriging,
        UniversalKriging,
        VecchiaKriging,
        VectorKriging,
    )
    from truepose.programs import FrameTable, correct_program, read_program, verify_program
    from truepose.report import write_report
    from truepose.report.plots import plot
    from truepose.robots import Robot, list_robots, load_robot
    from truepose.samples import Poses, Samples, load_example, read_poses, read_samples, write_samples
    from truepose.similarity import VariogramModel, experimental_variogram, fit_variogram, permutation_envelope
    from truepose.simulation import VirtualCell
    from truepose.studies.performance import iso9283, iso9283_poses
    from truepose.trackers import import_readings, read_readings, write_readings
    from truepose.verification import accuracy, held_out

    __version__: str

_HOME = {
    "Cell": "cell",
    "ErrorMap": "error_map",
    "FrameTable": "programs",
    "FrozenMap": "error_map",
    "GridCell": "predictors",
    "InverseDistance": "predictors",
    "KinematicCalibration": "predictors",
    "KinematicKriging": "predictors",
    "LocalKriging": "predictors",
    "Nearest": "predictors",
    "OrdinaryKriging": "predictors",
    "RadialBasis": "predictors",
    "ResidualNetwork": "predictors",
    "Poses": "samples",
    "Robot": "robots",
    "Samples": "samples",
    "SimpleKriging": "predictors",
    "TrueposeError": "errors",
    "UniversalKriging": "predictors",
    "VariogramModel": "similarity",
    "VecchiaKriging": "predictors",
    "VectorKriging": "predictors",
    "VirtualCell": "simulation",
    "accuracy": "verification",
    "check_point": "error_map",
    "choose": "error_map",
    "correct_program": "programs",
    "euler": "geometry",
    "experimental_variogram": "similarity",
    "fit_cell": "error_map",
    "fit_variogram": "similarity",
    "held_out": "verification",
    "import_readings": "trackers",
    "iso9283": "studies.performance",
    "iso9283_poses": "studies.performance",
    "list_robots": "robots",
    "load_cell": "cell",
    "load_example": "samples",
    "load_map": "error_map",
    "load_robot": "robots",
    "permutation_envelope": "similarity",
    "plan": "planning",
    "plot": "report.plots",
    "read_poses": "samples",
    "read_program": "programs",
    "read_readings": "trackers",
    "read_samples": "samples",
    "recheck": "error_map",
    "register": "geometry",
    "register_with_tool": "geometry",
    "update_map": "error_map",
    "verify_program": "programs",
    "write_readings": "trackers",
    "write_report": "report",
    "write_samples": "samples",
}

__all__ = [
    "Cell",
    "ErrorMap",
    "FrameTable",
    "FrozenMap",
    "GridCell",
    "InverseDistance",
    "KinematicCalibration",
    "KinematicKriging",
    "LocalKriging",
    "Nearest",
    "OrdinaryKriging",
    "Poses",
    "RadialBasis",
    "ResidualNetwork",
    "Robot",
    "Samples",
    "SimpleKriging",
    "TrueposeError",
    "UniversalKriging",
    "VariogramModel",
    "VecchiaKriging",
    "VectorKriging",
    "VirtualCell",
    "__version__",
    "accuracy",
    "check_point",
    "choose",
    "correct_program",
    "euler",
    "experimental_variogram",
    "fit_cell",
    "fit_variogram",
    "held_out",
    "import_readings",
    "iso9283",
    "iso9283_poses",
    "list_robots",
    "load_cell",
    "load_example",
    "load_map",
    "load_robot",
    "permutation_envelope",
    "plan",
    "plot",
    "read_poses",
    "read_program",
    "read_readings",
    "read_samples",
    "recheck",
    "register",
    "register_with_tool",
    "update_map",
    "verify_program",
    "write_readings",
    "write_report",
    "write_samples",
]


_lazy = lazy_names(__name__, _HOME)


def __getattr__(name: str) -> Any:
    if name == "__version__":  # asks git in a checkout, which takes longer than the import
        from truepose._version import version

        return version()
    return _lazy(name)


def __dir__() -> list[str]:
    return __all__
