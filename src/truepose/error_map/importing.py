"""From a measurement file and its plan to samples: matching, registration, and the tests of the campaign."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.error_map.campaign import CampaignCheck, check_campaign
from truepose.error_map.points import commanded_points
from truepose.error_map.registration import register_samples, tool_estimate, wrong_tool_named
from truepose.geometry import Registration, ToolEstimate
from truepose.robots import Robot
from truepose.samples import Distances, Mask, Poses, Samples, name_one, on_arm, set_aside, write_samples
from truepose.trackers import ImportSummary, import_readings

_SHOWN: Final = 8  # points that a fact names


@dataclass(frozen=True, eq=False)
class ImportedSamples:
    """Samples of a measurement file, made by `import_samples`.

    Attributes
    ----------
    table : Samples
        All samples in the order of the plan, with the masked ones.
    reasons : (n,) array of str
        The reason of each masked sample of the table; empty where it counts.
    samples : Samples
        The samples that count.
    understood : ImportSummary
        The summary of the import.
    registration : Registration
        The registration of the samples that count.
    tf_flange_tool : (4, 4) array [mm]
        The tool fitted with it, or as stated.
    campaign : CampaignCheck
        The faults of the measuring campaign.
    tool : ToolEstimate, optional
        The tool that the samples imply, beside the stated one.
    residuals : (n, 3) array [mm], base frame
        The errors of all samples of the table after the registration.
    """

    table: Samples
    reasons: NDArray[np.str_]
    samples: Samples
    understood: ImportSummary
    registration: Registration
    tf_flange_tool: FloatArray
    campaign: CampaignCheck
    tool: ToolEstimate | None
    residuals: FloatArray

    @property
    def outliers(self) -> list[dict[str, Any]]:
        """The samples that count with a large residual, by ``row``, ``point`` and ``line``."""
        length = np.linalg.norm(self.registration.residuals, axis=1)
        return [
            {**self.samples.identify(i), "residual_mm": float(length[i])}
            for i in np.flatnonzero(self.registration.outliers).tolist()
        ]

    @property
    def figures(self) -> dict[str, float]:
        """The mean and the maximum length of the errors after registration, without outliers [mm]."""
        kept = np.linalg.norm(self.registration.residuals, axis=1)[~self.registration.outliers]
        return {"mean_mm": float(kept.mean()), "max_mm": float(kept.max())}

    def rows(self) -> list[dict[str, Any]]:
        """Return the residual of every sample of the table as plain values, with its reason if it is masked."""
        outlier = np.zeros(len(self.table), dtype=np.bool_)
        outlier[np.flatnonzero(self.reasons == "")] = self.registration.outliers
        length = np.linalg.norm(self.residuals, axis=1)
        return [
            {
                **self.table.identify(i),
                "error_mm": self.residuals[i].tolist(),
                "residual_mm": float(length[i]),
                "outlier": bool(outlier[i]),
                "masked": str(self.reasons[i]),
            }
            for i in range(len(self.table))
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            "n": len(self.samples),
            "understood": self.understood.sentences(),
            "summary": asdict(self.understood),
            "registration": self.figures,
            "outliers": self.outliers,
            "masked": list(self.samples.excluded),
            "campaign": self.campaign.to_dict(),
            "distances": 0 if self.table.distances is None else len(self.table.distances),
        }

    def write(self, path: str | Path) -> None:
        """Write the table of samples, with the reasons of the masked ones."""
        write_samples(path, self.table, self.reasons)


def import_samples(
    cell: Cell,
    readings: str | Path,
    plan: Poses,
    *,
    mask: Mask | None = None,
    distances: Distances | None = None,
    reorder: bool = False,
    missing: bool = False,
    two_stations: bool = False,
    accept_campaign: bool = False,
    progress: Callable[[str], Any] = str,
    matched: Callable[[ImportSummary], Any] = lambda summary: None,
    **settings: Any,
) -> ImportedSamples:
    """Read a measurement file, match it with its plan, register it, and test the campaign.

    Parameters
    ----------
    cell : Cell
        The cell that was measured.
    readings : str or Path
        The measurement file.
    plan : Poses
        The commanded poses.
    mask : Mask, optional
        The points to leave out; they stay in the table with their reasons.
    distances : Distances, optional
        Distances from fixed points, which become rows of the table after those of positions.
    reorder, missing, two_stations : bool
        The permissions of `truepose.trackers.match`.
    accept_campaign : bool
        Whether to accept a campaign with faults; they are in the result in either case.
    progress : callable
        A function of a line about the current step.
    matched : callable
        A function of the summary of the matching, which is called before the registration.
    **settings
        The columns, units and reflectors of `truepose.trackers.read_measurement`.

    Returns
    -------
    ImportedSamples

    Raises
    ------
    FileError, DataError, RobotError, IdentifiabilityError
        For the reasons of `truepose.trackers.import_readings` and `register_samples`; `DataError` also for a campaign
        with faults.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from truepose import VirtualCell
    >>> from truepose.samples import Poses
    >>> from truepose.trackers import write_readings
    >>> virtual = VirtualCell("paper")
    >>> design = virtual.design(20)
    >>> with TemporaryDirectory() as folder:
    ...     write_readings(f"{folder}/tracker.csv", virtual.measure(design), "tidy")
    ...     found = import_samples(
    ...         virtual.cell, f"{folder}/tracker.csv", Poses(q=design), mask=Mask({3: "beam was cut"})
    ...     )
    >>> len(found.table), len(found.samples), found.rows()[3]["masked"]
    (20, 19, 'beam was cut')
    """
    table, understood = import_readings(
        readings,
        plan,
        cell=cell,
        **settings,
        mask=mask,
        reorder=reorder,
        missing=missing,
        two_stations=two_stations or accept_campaign,
    )
    matched(understood)
    if distances is not None:
        assert table.row is not None
        after = int(table.row.max()) + 1 + np.arange(len(distances))
        table = replace(table, distances=replace(distances, row=after))
    reasons = (
        np.full(len(table), "", dtype="<U1")
        if mask is None
        else mask.of(table, plan if table.reflector is None else None)
    )
    samples = set_aside(table, reasons)
    progress("Registering")
    robot = cell.load_robot()
    registration, tf_flange_tool, _ = register_samples(cell, robot, samples)
    if samples.distances is not None:
        from truepose.error_map.distances import check_distance_rows, distance_rows, with_origins

        whole = with_origins(cell, on_arm(samples, robot))
        check_distance_rows(robot, whole, distance_rows(cell, whole, registration), tf_flange_tool)
    progress("Testing for a moved tracker, a scale error and a drift")
    campaign = check_campaign(cell, robot, samples, registration, tf_flange_tool)
    if not accept_campaign:
        with wrong_tool_named(cell, robot, samples):
            campaign.refuse(samples.source, accepted=("moved", "drift", "reference") if two_stations else ())
    facts = _facts(understood, samples, registration)
    table, samples = replace(table, facts=facts), replace(samples, facts=facts)
    return ImportedSamples(
        table=table,
        reasons=reasons,
        samples=samples,
        understood=understood,
        registration=registration,
        tf_flange_tool=tf_flange_tool,
        campaign=campaign,
        tool=tool_estimate(cell, robot, samples),
        residuals=registration.apply(table.p_meas) - _commanded(cell, robot, table, tf_flange_tool),
    )


def _facts(understood: ImportSummary, samples: Samples, registration: Registration) -> tuple[tuple[str, str], ...]:
    """Return what the import found about the readings, each with the code of a fact."""
    far, size = np.flatnonzero(registration.outliers), np.linalg.norm(registration.residuals, axis=1)
    listed = {
        "missing": ("points of the plan without a reading were left out", understood.missing_points),
        "reordered": ("readings in another order than the plan were reordered", understood.reordered_points),
        "suspect-readings": (
            "readings lie far from the expected positions",
            [f"{name_one(samples.identify(i))} by {size[i]:.3f} mm" for i in far.tolist()] or understood.outlier_points,
        ),
    }
    found = [(code, f"{what}: {_some(points)}") for code, (what, points) in listed.items() if points]
    if understood.averaged:
        found.append(("averaged", f"{understood.averaged} repeated readings were averaged"))
    return (*found, *(("import-note", note.rstrip(".")) for note in understood.notes))


def _some(points: Sequence[str]) -> str:
    """Return the first points in words."""
    more = f" and {len(points) - _SHOWN} more" if len(points) > _SHOWN else ""
    return ", ".join(points[:_SHOWN]) + more


def _commanded(cell: Cell, robot: Robot, table: Samples, tf_flange_tool: FloatArray) -> FloatArray:
    """Return the commanded positions of a table, (n, 3) [mm], base frame."""
    if table.q is not None:
        return commanded_points(robot, cell, table, tf_flange_tool)
    assert table.p_cmd is not None  # Poses holds one of them
    return table.p_cmd
