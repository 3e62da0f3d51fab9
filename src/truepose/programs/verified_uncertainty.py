"""The contributions to the uncertainty of a re-measured target: from the readings, the cell file and the map."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.error_map.repeatability import Repeatability
from truepose.geometry.transforms import cross_matrix
from truepose.programs.nominal import NominalTargets
from truepose.programs.remeasured import Remeasured
from truepose.verification import RP_PER_STD
from truepose.verification.budget import Budget, Contribution, along, budget, isotropic

_SAME_POINT_MM: Final = 1e-3
"""Distance of the reflector from the tool of a program below which they are one point."""


def uncertainty(
    error_map: ErrorMap, cell: Cell, nominal: NominalTargets, measured: Remeasured, target: IntArray, row: IntArray
) -> Budget:
    """Return the uncertainty of the errors of n targets, combined along each error.

    Parameters
    ----------
    error_map : ErrorMap
        The map, whose tool is the measured point.
    cell : Cell
        The cell, with what it states of uncertainties.
    nominal : NominalTargets
        The nominal targets.
    measured : Remeasured
        The readings.
    target, row : (n,) arrays of int
        The places of the targets among the nominal ones, and among the measured ones.
    """
    p = nominal.positions_of(error_map.tf_flange_tool)[target]
    errors = measured.p_base[row] - p
    stated, n = cell.uncertainty, len(target)
    reflector = None
    if stated.reflector_mm is not None:
        reflector = isotropic(np.full(n, stated.reflector_mm / np.sqrt(3.0)))
    warmth = None
    if stated.temperature_K is not None:
        warmth = along(1e-6 * stated.expansion_um_per_m_K * stated.temperature_K * np.linalg.norm(p, axis=1), p)
    rp = Repeatability.of(cell, error_map.robot).known or Repeatability.of(error_map.cell, error_map.robot).known
    return budget(
        errors,
        [
            Contribution("reading", isotropic(measured.std[row]), dof=measured.dof, origin=measured.std_origin),
            Contribution("reflector", reflector, "rectangular", origin="[uncertainty] reflector_mm"),
            Contribution("station", _of_station(measured, row), common=True, origin="registration"),
            _of_tool(error_map, cell, nominal, target),
            Contribution(
                "repeatability",
                None if rp is None else isotropic(np.full(n, rp / RP_PER_STD)),
                origin="[robot] repeatability_mm",
            ),
            Contribution("temperature", warmth, "rectangular", common=True, origin="[uncertainty] temperature_K"),
        ],
    )


def _of_station(measured: Remeasured, row: IntArray) -> FloatArray:
    """Return the covariances of points by that of the station, (n, 3, 3) [mm²]: δp = δt + δω × R p_tracker."""
    station = measured.registration
    lever = measured.p_base[row] - station.tf_base_tracker[:3, 3]
    columns = np.concatenate([np.tile(np.eye(3), (len(row), 1, 1)), -cross_matrix(lever)], axis=2)
    return np.asarray(columns @ station.covariance[:6, :6] @ np.swapaxes(columns, 1, 2))


def _of_tool(error_map: ErrorMap, cell: Cell, nominal: NominalTargets, target: IntArray) -> Contribution:
    """Return what the place of the reflector on the flange adds where it is not the tool of the program."""
    away = nominal.tf_flange_tool[target, :3, 3] - error_map.tf_flange_tool[:3, 3]
    apart = np.linalg.norm(away, axis=1) > _SAME_POINT_MM
    if not apart.any():
        return Contribution("tool", np.zeros((len(target), 3, 3)), origin="the measured point is the tool")
    if error_map.tool_fitted and len(error_map.registration.covariance) == 9:
        turn = (nominal.tf_base_tool @ np.linalg.inv(nominal.tf_flange_tool))[target, :3, :3]
        fitted = turn @ error_map.registration.covariance[6:9, 6:9] @ np.swapaxes(turn, 1, 2)
        return Contribution("tool", apart[:, None, None] * fitted, origin="fitted with the map")
    std = cell.uncertainty.tool_mm
    whole = None if std is None else apart[:, None, None] * isotropic(np.full(len(target), std))
    return Contribution("tool", whole, origin="[uncertainty] tool_mm")
