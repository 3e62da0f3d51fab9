"""Maps on planes through the work region."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from truepose.error_map.fit import fit_cell
from truepose.report.region import planes
from truepose.samples import Poses


def test_maps_are_what_the_map_predicts(error_map):
    found = planes(error_map)
    assert {frozenset((plane.i, plane.j)) for plane in found} == {frozenset(pair) for pair in ((0, 1), (0, 2), (1, 2))}
    middle = (error_map.p_cmd.min(axis=0) + error_map.p_cmd.max(axis=0)) / 2
    for plane in found:
        assert np.ptp(plane.u) >= np.ptp(plane.v)
        p = middle.copy()
        p[plane.i], p[plane.j] = plane.u[5], plane.v[20]
        e, std = error_map.predict_errors(Poses(p_cmd=p[None]))
        assert plane.error[20, 5] == pytest.approx(np.linalg.norm(e))
        assert plane.std[20, 5] == pytest.approx(np.linalg.norm(std))
        assert plane.std[16, 16] < plane.std[0, 0]  # surer in the middle than in a corner


def test_maps_of_joint_space_are_asked_by_inverse_kinematics(cell):
    virtual, samples, _ = cell
    error_map = fit_cell(virtual.cell, samples, "ordinary-kriging-joint")
    plane = planes(error_map)[0]
    assert np.isfinite(plane.error).mean() > 0.9
    assert plane.error[16, 16] == pytest.approx(np.linalg.norm(error_map.e, axis=1).mean(), rel=1.0)


def test_samples_on_a_line_have_no_maps(error_map):
    p = np.array([[0.0, 0.0, z] for z in range(5)])
    flat = replace(error_map)
    vars(flat)["p_cmd"] = p
    assert planes(flat) == []
