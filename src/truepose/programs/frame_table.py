"""The controller's tools and bases: given by the user, by the cell file, or by KUKA's ``$config.dat``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.geometry.transforms import check_transforms, invert_transform
from truepose.programs.core.program import IDENTITY, MEASURED_TOOL, Key, MotionGroups, frame_key
from truepose.programs.krl.controller import read_config_dat

if TYPE_CHECKING:
    from truepose.cell import Cell

_SAME_MM: Final = 1e-3
_SHOWN: Final = 12


@dataclass(frozen=True, eq=False, repr=False)
class FrameTable:
    """The controller's tools and bases, by number or by name.

    Number 0 is the null frame on every controller, and is always there.

    Parameters
    ----------
    tools : mapping of int or str to (4, 4) array [mm]
        The transforms from the flange to each tool.
    bases : mapping of int or str to (4, 4) array [mm]
        The transforms from the robot's base to each frame of targets. Number 0 is the controller's world.
    tool, base : int or str, optional
        The tool and the base in force where a program sets none. The tool ``map`` is the one that the map was measured
        with, if none has this name.
    in_world : set of int or str
        The bases that are given in the controller's world instead, as in ``$config.dat``.
    tf_world_base : (4, 4) array [mm], optional
        The transform from that world to the robot's base, once it is known; see `standing_at`.
    groups : MotionGroups
        The motion groups of the controller (FANUC).
    problems : mapping of ("tool" or "base", int or str) to str
        The reasons why frames that the controller has cannot be used, whatever the tables say.
    of_held_parts : mapping of ("tool" or "base", int or str) to bool
        Whether a tool is a part in the gripper, or a base a tool that stands, where the controller says it (KUKA).

    Raises
    ------
    DataError
        If a frame is not a rigid transform, or the one in force is not among those given.

    Examples
    --------
    >>> import numpy as np
    >>> gripper = np.eye(4)
    >>> gripper[:3, 3] = 0.0, 0.0, 150.0
    >>> FrameTable(tools={3: gripper}, bases={"table": np.eye(4)}, tool=3)
    FrameTable(tools: 0, 3; bases: 0, table; in force: tool 3)
    """

    tools: Mapping[Key, FloatArray] = field(default_factory=dict)
    bases: Mapping[Key, FloatArray] = field(default_factory=dict)
    tool: Key | None = None
    base: Key | None = None
    in_world: frozenset[Key] = frozenset()
    tf_world_base: FloatArray | None = None
    groups: MotionGroups = field(default_factory=MotionGroups)
    problems: Mapping[tuple[str, Key], str] = field(default_factory=dict)
    of_held_parts: Mapping[tuple[str, Key], bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for kind in ("tools", "bases"):
            given = {frame_key(n): check_transforms(f"{kind} {n}", tf) for n, tf in getattr(self, kind).items()}
            object.__setattr__(self, kind, {0: IDENTITY, **given})
        for which, kind in (("tool", "tools"), ("base", "bases")):
            if (given_default := getattr(self, which)) is None:
                continue
            key = frame_key(given_default)
            measured = which == "tool" and key == MEASURED_TOOL
            if key not in (known := getattr(self, kind)) and not measured:
                shown = ", ".join(map(str, known))
                raise DataError(f"{which} {key} is not among those given ({shown}); give it in [frames.{kind}.{key}]")
            object.__setattr__(self, which, key)

    def __repr__(self) -> str:
        parts = [f"{kind}: {_listed(table)}" for kind, table in (("tools", self.tools), ("bases", self.bases))]
        in_force = [f"{which} {key}" for which, key in (("tool", self.tool), ("base", self.base)) if key is not None]
        return f"FrameTable({'; '.join([*parts, *(['in force: ' + ', '.join(in_force)] if in_force else [])])})"

    def to_dict(self) -> dict[str, Any]:
        """Return the frames as lists of numbers, for JSON."""
        tables = {"tools": self.tools, "bases": self.bases}
        found = {kind: {str(key): tf.tolist() for key, tf in table.items()} for kind, table in tables.items()}
        return {**found, "tool": self.tool, "base": self.base}

    @classmethod
    def from_config_dat(cls, path: str | Path) -> Self:
        """Return the tools and bases of a KUKA ``$config.dat``.

        Parameters
        ----------
        path : str or Path
            The path of the file.

        Raises
        ------
        FileError
            If the file cannot be read, defines no tool or base, or defines one twice; the error names the line.
        """
        tools, bases = read_config_dat(path)
        return cls(tools, bases, in_world=frozenset(bases))

    @classmethod
    def from_cell(
        cls, cell: Cell, config_dat: str | Path | None = None, tool: Key | None = None, base: Key | None = None
    ) -> Self:
        """Return the frames of a cell file and of its ``$config.dat``; those of the cell file take precedence.

        Parameters
        ----------
        cell : Cell
            The cell.
        config_dat : str or Path, optional
            Another ``$config.dat``, which takes precedence over that of the cell.
        tool, base : int or str, optional
            The tool and the base in force where a program sets none.
        """
        known = [cls.from_config_dat(path) for path in (cell.config_dat, config_dat) if path is not None]
        tools = {key: tf for table in known for key, tf in table.tools.items()}
        bases = {key: tf for table in known for key, tf in table.bases.items()}
        own = {frame_key(key): tf for key, tf in cell.bases.items()}
        in_world = frozenset(key for table in known for key in table.in_world) - own.keys()
        groups = MotionGroups(cell.frames.groups.robot, frozenset(cell.frames.groups.independent))
        table = cls({**tools, **cell.tools}, {**bases, **own}, tool, base, in_world, groups=groups)
        return table.standing_at(invert_transform(own[0]), "[frames.bases.0] of the cell file") if 0 in own else table

    def standing_at(self, tf_world_base: FloatArray, where: str) -> Self:
        """Return the frames relative to the base of a robot that has a place in its controller's world.

        Base 0, which is the world, and the bases that are given in the world change; those of a cell file do not.

        Parameters
        ----------
        tf_world_base : (4, 4) array [mm]
            The transform from the world to the robot's base.
        where : str
            The file or setting that states the place, for messages.

        Raises
        ------
        DataError
            If another place is known already.
        """
        if self.tf_world_base is not None:
            if not np.allclose(self.tf_world_base, tf_world_base, rtol=0.0, atol=_SAME_MM):
                known, new = (
                    ", ".join(f"{x:g}" for x in tf[:3, 3].round(3) + 0.0) for tf in (self.tf_world_base, tf_world_base)
                )
                raise DataError(
                    f"{where}: places the robot at ({new}) mm in its controller's world, or turned, but ({known}) mm "
                    "was stated before; make them agree ([frames.bases.0] of the cell file is the world relative to "
                    "the robot's base)"
                )
            return self
        tf_base_world = invert_transform(check_transforms(where, tf_world_base))
        bases = {key: tf_base_world @ tf if key in self.in_world else tf for key, tf in self.bases.items()}
        return replace(self, bases={**bases, 0: tf_base_world}, in_world=frozenset(), tf_world_base=tf_world_base)

    def with_config_dat(self, path: Path) -> Self:
        """Return these frames with those of a project's ``$config.dat`` added; these take precedence."""
        tools, bases = read_config_dat(path)
        bases = {key: self.bases[0] @ tf for key, tf in bases.items()}  # the file gives them in the world
        return replace(self, tools={**tools, **self.tools}, bases={**bases, **self.bases})


def _listed(table: Mapping[Key, FloatArray]) -> str:
    """Return the first keys of a table."""
    more = f", … ({len(table)} in all)" if len(table) > _SHOWN else ""
    return ", ".join(map(str, list(table)[:_SHOWN])) + more
