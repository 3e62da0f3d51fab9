"""Every term of kinematic Kriging can be switched off, and its option is in the documentation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truepose.predictors import ArmContext, make_predictor
from truepose.predictors.conditions import joined
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.robots import load_robot

ROBOT = replace(load_robot("kuka-kr210-r2700-extra"), gear_ratio=np.full(6, 101.0))
TOOL = np.array([[1.0, 0, 0, 110], [0, 1, 0, 20], [0, 0, 1, 360], [0, 0, 0, 1]])
NAME = "kinematic-kriging"
CONDITIONS = ("approach", "temperature", "payload", "time")
PAGE = Path(__file__).parents[3] / "docs" / "kinematic-kriging.md"


def terms_of(options):
    """Return the names of the terms in a fit with given hyperparameters: nothing is searched."""
    rng, n = np.random.default_rng(0), 20
    q = rng.uniform(-1, 1, (n, 6)) * np.deg2rad([40, 25, 25, 60, 40, 90]) + np.deg2rad([0, -75, 95, 10, 50, 20])
    given = {
        "approach": rng.choice([-1.0, 1.0], (n, 6)),
        "temperature": rng.uniform(20, 26, (n, 1)),
        "payload": rng.uniform(20, 90, (n, 1)),
        "time": np.arange(n, dtype=float)[:, None],
    }
    model = make_predictor(NAME + options, arm=ArmContext(ROBOT, TOOL))
    known = CONDITIONS if model.conditions == () and "conditions" not in options else model.conditions
    known = tuple(one for one in known if one in given)
    effects = {"approach": 1 + model.backlash_shape, "temperature": 1, "time": 3}
    scaled = sum(effects.get(one, 0) for one in known) + model.gear_harmonics
    joints, ranges = (range(6) if model.joint_errors else ()), {"joint": 6, "none": 0}[model.residual]
    hyper = Hyperparameters.start(len(joints), ranges, scaled).to_dict()
    model.set_params(conditions=known, hyper=hyper, joints=joints)
    model.fit(joined(q, known, given), rng.normal(0, 0.1, (n, 3)))
    found = {row["group"] for row in model.parameters_}
    found |= {"payload" for row in model.parameters_ if "under payload" in row["name"]}
    found |= {"joint errors"} if len(model.joints_) else set()
    return found | ({"rest"} if len(model.hyper_.rest_range) else set())


EVERY = {
    "registration", "geometry", "compliance", "payload", "station", "warming", "backlash", "expansion", "gear",
    "joint errors", "rest", "offset", "backlash shape",
}  # fmt: skip
OFF = {
    "": set(),
    "geometry=no": {"geometry"},
    "compliance=no": {"compliance", "payload"},
    "joint_errors=no": {"joint errors"},
    "residual=none": {"rest"},
    "gear_harmonics=no": {"gear"},
    "backlash_shape=no": {"backlash shape"},
    "conditions=none": {"backlash", "backlash shape", "expansion", "payload", "station", "warming", "offset"},
    "conditions=temperature+payload+time": {"backlash", "backlash shape"},
    "conditions=approach+payload+time": {"expansion"},
    "conditions=approach+temperature+time": {"payload"},
    "conditions=approach+temperature+payload": {"station", "warming", "offset"},
}


@pytest.mark.parametrize("option", OFF)
def test_a_term_is_switched_off(option):
    assert terms_of(f":{option}" if option else "") == EVERY - OFF[option]


def test_each_option_is_documented():
    text = PAGE.read_text("utf-8")
    assert [one for one in OFF if not one.startswith("conditions=a") and "+" not in one and one not in text] == []
