"""Predictors by name: options, former names, errors."""

import numpy as np
import pytest

import truepose as tp
from truepose._io import archive
from truepose.errors import DataError
from truepose.predictors import FORMER_NAMES, PREDICTORS, ArmContext, make_predictor, predictor_spec

ARM = ArmContext(tp.load_robot("kuka-kr150-2"), np.eye(4))


def test_every_class_has_one_name_and_only_the_coordinates_differ():
    families = {}
    for spec in PREDICTORS.values():
        families.setdefault(spec.family, []).append(spec.space)
    assert all(len(spaces) == len(set(spaces)) for spaces in families.values())


@pytest.mark.parametrize("name", [*PREDICTORS, *FORMER_NAMES.values()])
def test_every_name_makes_a_predictor(name):
    assert isinstance(make_predictor(name, arm=ARM), predictor_spec(name).family)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("idw:power=3:neighbours=8", {"power": 3.0, "neighbours": 8}),
        ("calibration:terms=sin1+cos1:method=ukf", {"terms": ("sin1", "cos1"), "method": "ukf"}),
        ("calibration:parameters=theta+base", {"parameters": ("theta", "base")}),
        ("kinematic-kriging:geometry=no:compliance=No", {"geometry": False, "compliance": False}),
        ("calibration-network:terms=", {"terms": ()}),
    ],
)
def test_options_are_parameters(name, parameters):
    found = make_predictor(name, arm=ARM).get_params(deep=False)
    assert {key: found[key] for key in parameters} == parameters
    assert {key: type(found[key]) for key in parameters} == {key: type(value) for key, value in parameters.items()}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("idv", "no predictor 'idv'; did you mean 'idw'"),
        ("idw:power", "has the option 'power' without a value"),
        ("idw:pover=3", "has no option 'pover'; did you mean 'power'"),
        ("idw:power=three", "power is 'three'; expected a number"),
        ("idw:neighbours=2.5", "neighbours is '2.5'; expected an integer"),
        ("idw:space=polar", "space is 'polar'; expected cartesian or joint"),
        ("calibration:space=cartesian", "has no option 'space'"),
        ("kinematic-kriging:robust=perhaps", "robust is 'perhaps'; expected yes or no"),
        ("kinematic-kriging:hyper=1", "has no option 'hyper'"),
        ("kinematic-kriging:inflation=1", "has no option 'inflation'"),
        ("kinematic-kriging:robot=x", "has no option 'robot'"),
        ("calibration-ekf", "'calibration-ekf' is now an option of its class; write calibration:method=ekf"),
    ],
)
def test_wrong_names(name, message):
    with pytest.raises(DataError, match=message):
        make_predictor(name, arm=ARM)


def test_an_arm_is_needed():
    with pytest.raises(DataError, match="predictor 'calibration' needs the arm: its robot and tool"):
        make_predictor("calibration")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("former", ["idw-joint", "calibration-ekf"])
def test_maps_with_former_names_load(former, tmp_path):
    virtual = tp.VirtualCell("paper", seed=1)
    fitted = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(40, seed=1), seed=1), FORMER_NAMES[former])
    fitted.save(tmp_path / "m.truepose")
    content, arrays = archive.unpack((tmp_path / "m.truepose").read_bytes(), "m.truepose")
    content["predictor"]["name"] = former
    content["ranking"] = [{"predictor": former}, {"predictor": "calibration-ls", "note": "failed"}]
    (tmp_path / "old.truepose").write_bytes(archive.pack(content, arrays))
    old = tp.load_map(tmp_path / "old.truepose")
    assert old.predictor_name == FORMER_NAMES[former]
    assert [row["predictor"] for row in old.ranking] == [FORMER_NAMES[former], "calibration:method=ls"]
    q = virtual.design(5, seed=2)
    np.testing.assert_allclose(old.predict_measured(q), fitted.predict_measured(q), atol=1e-9)
