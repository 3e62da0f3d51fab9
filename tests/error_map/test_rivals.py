"""A map whose predictor does far worse than another says so, and recommends that one."""

from __future__ import annotations

import numpy as np
import pytest

import truepose as tp
from truepose.error_map.rivals import FAR, better_predictor


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("hard", seed=3)


@pytest.fixture(scope="module")
def samples(virtual: tp.VirtualCell) -> tp.Samples:
    return virtual.measure(virtual.design(60))


@pytest.fixture(scope="module")
def held_out(virtual: tp.VirtualCell) -> tp.Samples:
    return virtual.measure(virtual.design(25, seed=1))


@pytest.mark.exhaustive
def test_kinematic_kriging_is_recommended(virtual: tp.VirtualCell, samples: tp.Samples, held_out: tp.Samples) -> None:
    error_map = tp.fit_cell(virtual.cell, samples, "ordinary-kriging")
    result = error_map.validate(held_out)
    better = result.better
    assert better is not None
    assert (better.predictor, better.rival) == ("ordinary-kriging", "kinematic-kriging")
    assert better.mean_mm == pytest.approx(result["after"]["mean_mm"])
    assert result["better"]["rival_mean_mm"] == better.rival_mean_mm
    assert better.words in repr(result)
    rival = tp.fit_cell(virtual.cell, samples, "kinematic-kriging").validate(held_out)
    assert better.rival_mean_mm == pytest.approx(rival["after"]["mean_mm"], rel=0.2)  # all of its samples were used
    assert rival.better is None
    assert error_map.validate(held_out, rivals=False).better is None
    among_themselves = better_predictor(error_map)
    assert among_themselves is not None
    own = np.linalg.norm(error_map.leave_one_out().residual, axis=1).mean()
    assert among_themselves.mean_mm == pytest.approx(own)
    assert among_themselves.rival_mean_mm < FAR * own


def test_ordinary_kriging_where_the_arm_is_not_known(virtual: tp.VirtualCell, samples: tp.Samples) -> None:
    q = samples.q
    assert q is not None
    p_cmd = virtual.cell.load_robot().forward(q, tool=virtual.cell.tf_flange_tool)[:, :3, 3]
    bare = tp.Samples(samples.p_meas, p_cmd=p_cmd)
    better = better_predictor(tp.fit_cell(virtual.cell, bare, "registration", accept_campaign=True))
    assert better is None or better.rival == "ordinary-kriging"


def test_a_choice_among_the_rivals_has_none(virtual: tp.VirtualCell, samples: tp.Samples) -> None:
    error_map = tp.fit_cell(virtual.cell, samples, "idw")
    assert better_predictor(error_map) is not None
    assert better_predictor(error_map.changed(ranking=[{"predictor": "kinematic-kriging"}])) is None


@pytest.mark.exhaustive
def test_commands_say_so(run, virtual: tp.VirtualCell, samples: tp.Samples, held_out: tp.Samples, tmp_path) -> None:
    cell, table, test, out = (tmp_path / name for name in ("cell.toml", "samples.csv", "test.csv", "map.truepose"))
    cell.write_text(virtual.cell.to_toml())
    tp.write_samples(table, samples)
    tp.write_samples(test, held_out)
    fitted = run("fit", cell, table, "--predictor", "idw", "--out", out)
    assert "kinematic-kriging leaves" in " ".join(fitted.out.split())
    assert run("validate", out, test, "--json").json["better"]["rival"] == "kinematic-kriging"
    shown = " ".join(run("validate", out, test).out.split())
    assert "another predictor would do far better" in shown
    assert "fit again with --predictor kinematic-kriging, or auto" in shown
