"""Corrections that are smoothed along a path, inside their uncertainty."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.tiers import examples

from truepose.cell.sections import Correction, FramesSection
from truepose.errors import RefusedError
from truepose.programs import correct_program, read_program
from truepose.programs.core.smoothing import Bends, smoothed

STD = 0.05
"""Of each component of the maps here [mm]; the length of the three is 0.087 mm."""


def seam(folder: Path, points: np.ndarray, name: str = "seam.src") -> Path:
    """Write straight motions through points (n, 3) [mm], in a base that is turned and off."""
    lines = [f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A 0,B 0,C 0}}\n" for x, y, z in points]
    head = "$TOOL=$NULLFRAME\n$BASE={X 800,Y 100,Z 300,A 30,B 0,C 180}\n"
    (folder / name).write_text(f"DEF seam()\n{head}{''.join(lines)}END\n")
    return folder / name


def bends_of(done: Any) -> np.ndarray:
    """Return the bends of consecutive corrections [mm] from the written numbers, points at equal distances."""
    change = np.array([target.correction for target in done.targets])
    return np.linalg.norm(change[1:-1] - (change[:-2] + change[2:]) / 2, axis=1)


@pytest.fixture
def limited(tmp_path: Path) -> Any:
    """Return a function that corrects with a stated largest bend."""

    def correct(path: Path, error_map: Any, limit: float, **more: Any) -> Any:
        correction = Correction(max_bend_mm=limit)
        cell = SimpleNamespace(
            correction=correction, config_dat=None, tools={}, bases={}, frames=FramesSection(), robot_id=None
        )
        return correct_program(path, error_map, cell, on_guard="refuse", **more)

    return correct


def uneven(n: int, size: float) -> np.ndarray:
    """Return corrections that rise evenly, with a zigzag."""
    change = np.linspace(0, 0.8, n)[:, None] * [1.0, -0.5, 0.2]
    change[:, 2] += size * (-1.0) ** np.arange(n)
    return change


@pytest.mark.promise("Corrections of a path are smoothed to its largest bend, by at most their standard deviation.")
def test_an_uneven_map_gives_an_even_path(tmp_path: Path, make_map: Any, limited: Any) -> None:
    n, limit = 40, 0.05
    path = seam(tmp_path, np.arange(n)[:, None] * [5.0, 0.0, 0.0])
    done = limited(path, make_map(uneven(n, 0.04), std=STD), limit)
    assert done.coverage.corrected == n
    assert bends_of(done).max() <= limit
    summary = done.to_dict()["continuity"]
    assert (summary["smoothed"], summary["max_bend_mm"]) == (n, limit)
    plain = limited(path, make_map(uneven(n, 0.04), std=STD), 10.0)
    moved = np.array([a.p_after - b.p_after for a, b in zip(done.targets, plain.targets, strict=True)])
    size = np.linalg.norm(moved, axis=1)
    assert 0.01 < size.max() <= np.sqrt(3) * STD + 1e-3
    assert summary["largest_smoothing_mm"] == pytest.approx(size.max(), abs=1.5e-3)
    assert all(re.fullmatch(r"smoothed along its path by 0\.\d{3} mm", note) for note in done.targets.notes.values())
    assert "smoothed along its path by" in done.to_csv()


def test_what_the_uncertainty_does_not_allow_is_refused(tmp_path: Path, make_map: Any, limited: Any) -> None:
    path = seam(tmp_path, np.arange(40)[:, None] * [5.0, 0.0, 0.0])
    with pytest.raises(RefusedError, match=r"would bend the path by 0\.400 mm .* limit 0\.050 mm"):
        limited(path, make_map(uneven(40, 0.2), std=STD), 0.05)


def test_a_path_within_the_limit_is_not_touched(tmp_path: Path, make_map: Any, limited: Any) -> None:
    path = seam(tmp_path, np.arange(40)[:, None] * [5.0, 0.0, 0.0])
    near, far = (limited(path, make_map(uneven(40, 0.04), std=STD), limit) for limit in (0.17, 10.0))
    assert near.files == far.files
    assert not near.continuity.smoothed


def test_nominal_targets_of_a_path_stay_where_they_are(tmp_path: Path, make_map: Any) -> None:
    """The first point is guarded: the others come near to it as far as they may."""
    path = seam(tmp_path, np.arange(12)[:, None] * [5.0, 0.0, 0.0])
    small = np.full((12, 3), 0.06)
    done = correct_program(path, make_map(small, {0: "far away"}, std=STD), on_guard="skip")
    assert not done.continuity.smoothed  # within the default limit
    np.testing.assert_array_equal(done.targets[0].correction, 0.0)


def test_paths_that_share_a_point_agree_on_it(tmp_path: Path, make_map: Any, limited: Any) -> None:
    """Two seams go through one point by name; both are even in the end, or the program is refused."""
    points = [f"DECL E6POS XP{i}={{X {5 * i},Y 0,Z 0,A 0,B 0,C 0}}\n" for i in range(9)]
    moves = [*(f"LIN XP{i}\n" for i in range(9)), "PTP XP4\n", *(f"LIN XP{i}\n" for i in (5, 6, 7, 8))]
    (tmp_path / "two.src").write_text(f"DEF two()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{''.join(moves)}END\n")
    (tmp_path / "two.dat").write_text(f"DEFDAT two\n{''.join(points)}ENDDAT\n")
    done = limited(tmp_path / "two.src", make_map(uneven(9, 0.04), std=STD), 0.06)
    assert bends_of(done).max() <= 0.06
    assert done.coverage.corrected == 9
    assert read_program(tmp_path / "two.src").counts()["correct"] == 9


@settings(max_examples=examples(60))
@given(st.integers(3, 30), st.integers(0, 10**6), st.floats(0.005, 0.2))
def test_smoothed_corrections_keep_both_limits(n: int, seed: int, limit: float) -> None:
    rng = np.random.default_rng(seed)
    change, std = rng.normal(0, 0.05, (n, 3)), rng.uniform(0.01, 0.15, n)
    free = rng.random(n) < 0.8
    at = np.arange(1, n - 1)
    bends = Bends(at, at - 1, at + 1, rng.uniform(0.2, 0.8, n - 2), np.full(n - 2, limit))
    found = smoothed(change, free, std, bends)
    if found is None:
        return
    assert (np.linalg.norm(bends.matrix(n) @ found, axis=1) <= limit).all()
    assert (np.linalg.norm(found - change, axis=1) <= std * (1 + 1e-9)).all()
    np.testing.assert_array_equal(found[~free], change[~free])
