"""Error models: every parameter of every convention against the complex step, conversions, ranks, named columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.robots.arms import ARMS

from truepose.errors import DataError, RobotError
from truepose.robots import (
    CONVENTIONS,
    error_model,
    find_branches,
    joint_terms,
    load_robot,
    thermal_columns,
    to_mdh,
)
from truepose.robots.nongeometric import GRAVITY, Load, gravity_torque

TOOL = np.array([110.0, -20.0, 360.0])
FOUR = ("kuka-kr210-r2700-extra", "abb-irb6640-185-280", "staubli-tx2-90", "universal-robots-ur10")


def perturbed(robot, rng):
    """An arm with errors of ordinary size in every parameter of equation (1)."""
    size = {"alpha": 3e-4, "offset": 3e-4, "beta": 3e-4, "a": 0.3, "d": 0.3}
    mdh = to_mdh(robot)
    return replace(mdh, **{key: getattr(mdh, key) + rng.normal(scale=s, size=mdh.dof) for key, s in size.items()})


# An independent forward kinematics of complex numbers, from the formulas of each convention.


def turn(axis, angle):
    tf = np.eye(4, dtype=complex)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    tf[i, i] = tf[j, j] = np.cos(angle)
    tf[j, i], tf[i, j] = np.sin(angle), -np.sin(angle)
    return tf


def shift(axis, length):
    tf = np.eye(4, dtype=complex)
    tf[axis, 3] = length
    return tf


def tilt(b):
    """The rotation about z × b by the angle between them, Rodrigues."""
    k = np.array([[0, 0, b[0]], [0, 0, b[1]], [-b[0], -b[1], 0]])
    tf = np.eye(4, dtype=complex)
    tf[:3, :3] += k + k @ k / (1 + b[2])
    return tf


def complex_link(model, k, values):
    """Link k as the convention's own formula says; constant parts are taken from the model."""
    v = dict(zip(model.names, values, strict=True))
    tf = np.eye(4, dtype=complex)
    fixed = [motion.tf for motion in model.links[k] if motion.kind == "fixed"]
    dof = model.robot.dof
    if k == 0:
        tf = shift(0, v["base x"]) @ shift(1, v["base y"]) @ shift(2, v["base z"])
        tf = tf @ turn(0, v["base rx"]) @ turn(1, v["base ry"]) @ turn(2, v["base rz"])
    if model.convention == "hayati":
        if k > 0:
            tf = tf @ turn(2, v[f"theta{k}"]) @ shift(2, v[f"d{k}"]) @ turn(1, v[f"beta{k}"])
        if k in (0, dof):
            tf = tf @ fixed[0]
        if k < dof:
            tf = tf @ turn(0, v[f"alpha{k + 1}"]) @ shift(0, v[f"a{k + 1}"])
    elif model.convention == "poe":
        if k > 0:
            at = (v[f"{name}{k}"] for name in ("x", "y", "rx", "ry"))
            x, y, rx, ry = at
            tf = tf @ np.linalg.inv(shift(0, x) @ shift(1, y) @ turn(0, rx) @ turn(1, ry))
        tf = tf @ fixed[0]
        if k < dof:
            x, y, rx, ry = (v[f"{name}{k + 1}"] for name in ("x", "y", "rx", "ry"))
            tf = tf @ shift(0, x) @ shift(1, y) @ turn(0, rx) @ turn(1, ry)
    elif k == 0:
        tf = tf @ fixed[0]
    else:
        if model.links[k][0].kind == "fixed":
            tf = tf @ fixed.pop(0)
        tf = tf @ FORMULA[model.convention](v, k)
        if k == dof:
            tf = tf @ fixed[-1]
    if k == dof:
        tf = tf @ shift(0, v["tool x"]) @ shift(1, v["tool y"]) @ shift(2, v["tool z"])
        tf = tf @ turn(0, v["tool rx"]) @ turn(1, v["tool ry"]) @ turn(2, v["tool rz"])
    return tf


def dh(v, k):
    tf = turn(2, v[f"theta{k}"]) @ shift(2, v.get(f"d{k}", 0.0)) @ shift(0, v[f"a{k}"]) @ turn(0, v[f"alpha{k}"])
    return tf @ turn(1, v.get(f"beta{k}", 0.0))


def s_model(v, k):
    tf = turn(2, v[f"beta{k}"]) @ shift(2, v[f"d{k}"]) @ shift(0, v[f"a{k}"]) @ turn(0, v[f"alpha{k}"])
    return tf @ turn(2, v[f"gamma{k}"]) @ shift(2, v[f"b{k}"])


def mcpc(v, k):
    return turn(0, v[f"alpha{k}"]) @ turn(1, v[f"beta{k}"]) @ shift(0, v[f"x{k}"]) @ shift(1, v[f"y{k}"])


def cpc(v, k):
    b = [v.get(f"b{axis}{k}") for axis in "xyz"]
    lost = b.index(None)
    b[lost] = v["sign"][k] * np.sqrt(1 - sum(x * x for x in b if x is not None))
    return tilt(b) @ shift(0, v[f"x{k}"]) @ shift(1, v[f"y{k}"])


FORMULA = {"dh": dh, "s-model": s_model, "mcpc": mcpc, "cpc": cpc}


def complex_forward(model, q, values):
    named = values
    if model.convention == "cpc":
        signs = {k: m.factor for k, link in enumerate(model.links) for m in link if m.kind == "tilt"}
        model_names = (*model.names, "sign")
        named = [*values, signs]
        model = _Named(model, model_names)
    tf = complex_link(model, 0, named)
    for k, (s, angle) in enumerate(zip(model.robot.sign, q, strict=True), start=1):
        tf = tf @ turn(2, s * angle) @ complex_link(model, k, named)
    return tf


class _Named:
    def __init__(self, model, names):
        self.names, self.links, self.robot, self.convention = names, model.links, model.robot, model.convention


@pytest.mark.parametrize("convention", CONVENTIONS)
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.sampled(8)
def test_jacobian_is_the_complex_step(name, convention, rng):
    model = error_model(perturbed(load_robot(name), rng), convention, TOOL)
    q = rng.uniform(-3, 3, (2, 6))
    jacobian = model.jacobian(q, outputs="pose")
    for i in range(len(q)):
        real = complex_forward(model, q[i], model.nominal.astype(complex)).real
        np.testing.assert_allclose(real, model.forward(q[i]), atol=1e-8)
        step = 1e-20
        for k, parameter in enumerate(model.parameters):
            values = model.nominal.astype(complex)
            values[k] += 1j * step
            slope = complex_forward(model, q[i], values).imag / step
            spin = slope[:3, :3] @ real[:3, :3].T
            wanted = np.concatenate([slope[:3, 3], [spin[2, 1], spin[0, 2], spin[1, 0]]])
            far = abs(model.nominal).max() if convention == "s-model" else 4000.0  # its common normals are far away
            limit = 1e-9 * np.array([*[np.abs(wanted[:3]).max() + 1e-6 * far] * 3, 1.0, 1.0, 1.0])
            assert (np.abs(jacobian[i, :, k] - wanted) <= limit).all(), (parameter.name, jacobian[i, :, k], wanted)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.sampled(2)
def test_conversions_keep_forward_kinematics(name, rng):
    q = rng.uniform(-np.pi, np.pi, (1000, 6))
    for robot in (load_robot(name), perturbed(load_robot(name), rng)):
        wanted = robot.forward(q, TOOL)
        for start in CONVENTIONS:
            model = error_model(robot, start, TOOL)
            for end in CONVENTIONS:
                found = model.converted(end).forward(q)
                assert np.abs(found[:, :3, 3] - wanted[:, :3, 3]).max() < 1e-9, (start, end)
                assert np.abs(found[:, :3, :3] - wanted[:, :3, :3]).max() < 1e-12
            assert np.abs(model.to_robot().forward(q) - wanted).max() < 1e-9


def rank(columns):
    scaled = columns.reshape(-1, columns.shape[-1])
    length = np.linalg.norm(scaled, axis=0)
    seen = length > 1e-6  # a turn about a line through the tool point leaves rounding only
    return np.linalg.matrix_rank(scaled[:, seen] / length[seen], tol=1e-8)


@pytest.mark.parametrize("name", FOUR)
def test_numbers_of_identifiable_parameters(name, rng):
    robot = load_robot(name)
    q = rng.uniform(-np.pi, np.pi, (200, 6))
    assert rank(robot.error_jacobian(q, tool=TOOL)) == 25
    for convention in ("hayati", "dh", "cpc", "mcpc", "poe"):
        model = error_model(robot, convention, TOOL)
        assert rank(model.jacobian(q)) == 27, convention
        assert rank(model.jacobian(q, outputs="pose")) == 30, convention


def test_s_model_is_complete_where_no_axes_are_parallel(rng):
    robot = perturbed(load_robot(FOUR[0]), rng)
    robot = replace(robot, alpha=robot.alpha + np.array([0, 0, 0.3, 0, 0, 0]))
    q = rng.uniform(-np.pi, np.pi, (200, 6))
    model = error_model(robot, "s-model", TOOL)
    assert rank(model.jacobian(q)) == 27
    assert rank(model.jacobian(q, outputs="pose")) == 30


def test_s_model_refuses_axes_that_are_almost_parallel():
    robot = to_mdh(load_robot(FOUR[0]))
    robot = replace(robot, beta=robot.beta + np.array([0, 1e-9, 0, 0, 0, 0]))
    with pytest.raises(RobotError, match=r'cannot describe axes 2 and 3, .* use "hayati"'):
        error_model(robot, "s-model")


def test_shapes_and_names():
    robot = load_robot(FOUR[3])
    q = np.linspace(-1, 1, 12).reshape(2, 6)
    assert robot.error_jacobian(q).shape == (2, 3, len(robot.parameter_names)) == (2, 3, 30)
    assert robot.error_jacobian(q, "pose").shape == (2, 6, 30)
    assert robot.error_jacobian(q[0], parameters=["theta", "base", "d4"]).shape == (3, 13)
    some = robot.error_jacobian(q, parameters=["beta3", "theta2"])
    np.testing.assert_array_equal(some, robot.error_jacobian(q)[..., [26, 1]])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (
            {"parameters": ["theta9"]},
            RobotError,
            'no parameter "theta9" in the convention "hayati"; expected a name such as theta1, or a group: theta',
        ),
        ({"convention": "denavit"}, RobotError, 'unknown convention "denavit"; expected one of hayati, dh'),
        ({"outputs": "velocity"}, DataError, 'unknown outputs "velocity"'),
    ],
)
def test_bad_requests(options, error, message):
    with pytest.raises(error, match=message):
        load_robot(FOUR[0]).error_jacobian(np.zeros((1, 6)), **options)


def test_joint_jacobian(rng):
    robot = load_robot("kuka-kr150-2")
    q, step = rng.uniform(-2, 2, (5, 6)), 1e-6
    found = robot.joint_jacobian(q, tool=TOOL)
    for j in range(6):
        move = step * np.eye(6)[j]
        slope = (robot.forward(q + move, TOOL) - robot.forward(q - move, TOOL))[:, :3, 3] / (2 * step)
        np.testing.assert_allclose(found[:, :, j], slope, atol=1e-5)


def test_gravity_torque_is_the_gradient_of_the_potential(rng):
    robot = load_robot("kuka-kr210-r2700-extra")
    kg = np.array([200.0, 150, 120, 40, 30, 20])
    load = Load(210.0, np.array([50.0, 0, 300]), kg)
    q, step = rng.uniform(-2, 2, (4, 6)), 1e-6

    def potential(q):
        frames = robot.frames(q)
        joints = (frames[:, :-1] @ robot.link_before)[:, :, 2, 3]
        flange = frames[:, -1] @ robot.tf_last_flange
        height = np.concatenate([joints, flange[:, 2, 3][:, None]], axis=1)
        middle = (height[:, :-1] + height[:, 1:]) / 2
        payload = flange[:, 2, 3] + flange[:, 2, :3] @ load.p_flange_payload
        return 1e-3 * GRAVITY * (middle @ kg + 210.0 * payload)

    found = gravity_torque(robot, q, load)
    for j in range(6):
        move = step * np.eye(6)[j]
        np.testing.assert_allclose(found[:, j], -(potential(q + move) - potential(q - move)) / (2 * step), atol=1e-4)


def test_terms_by_name(rng):
    robot = load_robot("kuka-kr150-2")
    terms = joint_terms(robot, ["sin1", "cos2 q3", "gearsin1 q2", "backlash q6"], gear_ratio=np.full(6, 100.0))
    assert [p.name for p in terms.parameters][5:] == ["sin1 q6", "cos2 q3", "gearsin1 q2", "backlash q6"]
    q, approach = rng.uniform(-2, 2, (7, 6)), rng.choice([-1.0, 1.0], (7, 6))
    basis = terms.basis(q, approach)
    np.testing.assert_allclose(
        basis[:, 6:], np.column_stack([np.cos(2 * q[:, 2]), np.sin(100 * q[:, 1]), approach[:, 5]])
    )
    columns = terms.jacobian(q, robot.joint_jacobian(q), approach)
    np.testing.assert_allclose(columns[:, :, 6], robot.joint_jacobian(q)[:, :, 2] * basis[:, 6, None])
    with pytest.raises(DataError, match="backlash needs the approach signs"):
        terms.basis(q)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sin0", 'unknown term "sin0"; expected compliance'),
        ("backlash q7", '"backlash q7": kuka-kr150-2 has 6 joints'),
        ("gearcos1", "needs gear_ratio"),
    ],
)
def test_bad_terms(name, message):
    with pytest.raises(RobotError, match=message):
        joint_terms(load_robot("kuka-kr150-2"), [name])


def test_thermal_growth_of_all_lengths_is_a_larger_arm(rng):
    robot = load_robot("kuka-kr150-2")
    q = rng.uniform(-2, 2, (5, 6))
    parameters, columns = thermal_columns(error_model(robot), q, np.full(5, 10.0))
    assert [p.name for p in parameters] == [f"thermal {x}" for x in ("d1", "d4", "d6", "a2", "a3", "a4")]
    np.testing.assert_allclose(columns.sum(axis=2), 10.0 * robot.forward(q)[:, :3, 3], atol=1e-9)


def test_reprs_fit_a_screen():
    robot = load_robot("kuka-kr150-2")
    groups = "theta, d, a, alpha, beta, base, tool"
    assert repr(error_model(robot)) == f"<ErrorModel of kuka-kr150-2: hayati, 42 parameters ({groups})>"
    assert repr(joint_terms(robot, ["sin1 q2", "backlash q3"])) == "<JointTerms of kuka-kr150-2: sin1 q2, backlash q3>"
    found = find_branches(robot, robot.forward(np.deg2rad([[0, -90, 90, 0, 45, 0]])))
    assert repr(found) == "<Branches of 1 poses of kuka-kr150-2: 1 reached, 1 within limits>"
