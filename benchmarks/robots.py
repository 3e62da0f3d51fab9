"""Forward and inverse kinematics of arrays of poses, one core.

Peers: pinocchio, called pose by pose as its Python face has it; roboticstoolbox's batch (ETS.eval, its compiled way,
and DHRobot.fkine, its usual one); py-opw-kinematics, all branches of arrays.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmarks.harness import Call, Job
from truepose.geometry import invert_transform, make_transform
from truepose.robots import Robot, error_model, find_branches, load_robot
from truepose.robots.inverse.closed_form import ortho_parallel

TITLE = "Benchmarks: robots"
PACKAGES = ("truepose", "numpy", "pin", "roboticstoolbox-python", "py-opw-kinematics")


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n = 1_000 if quick else 100_000
    few = n // 10
    rng = np.random.default_rng(0)
    robot = load_robot("kuka-kr210-r2700-extra")
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], size=(n, 6))
    poses = robot.forward(q)

    yield Job(
        f"forward kinematics, {n:,} poses",
        {
            "truepose": lambda: robot.forward(q),
            "pinocchio, pose by pose": pinocchio_forward(robot, q[:few]),
            "roboticstoolbox, ETS.eval": toolbox_forward(robot, q, "ets"),
            "roboticstoolbox, fkine": toolbox_forward(robot, q[:few], "fkine"),
        },
        items=n,
        counts={"pinocchio, pose by pose": few, "roboticstoolbox, fkine": few},
        target="peers at 1 or more",
    )
    model = error_model(robot)
    kinematic = [name for name in model.names if not name.startswith("tool")]
    yield Job(
        f"error Jacobian of positions, {n:,} poses, {len(kinematic)} columns",
        {
            "truepose": lambda: model.jacobian(q, parameters=kinematic),
            "its forward kinematics": lambda: robot.forward(q),
        },
        items=n,
        target="its forward at 0.2 or more",
    )
    yield Job(
        f"all branches of the inverse, {n:,} poses",
        {"truepose": lambda: robot.inverse(poses), "py-opw-kinematics": opw_inverse(robot, poses)},
        items=n,
        target="below 12.5 µs, or its peer at 1 or more",
    )
    ur = load_robot("universal-robots-ur10")
    ur_poses = ur.forward(rng.uniform(-np.pi, np.pi, size=(n, 6)))
    yield Job(f"all branches of a UR arm, {n:,} poses", {"truepose": lambda: ur.inverse(ur_poses)}, items=n)
    calibrated = replace(robot, a=robot.a + rng.normal(scale=0.3, size=6), beta=rng.normal(scale=3e-4, size=6))
    real = calibrated.forward(q[:few])
    yield Job(
        f"all branches of a calibrated arm, {few:,} poses",
        {
            "truepose": lambda: calibrated.inverse(real),
            "with singularity and reach": lambda: find_branches(calibrated, real),
        },
        items=few,
    )


def peer(module: str) -> ModuleType | str:
    """Return a package, or why it is absent."""
    try:
        return importlib.import_module(module)
    except ImportError:
        return "not installed (uv sync --group bench)"


def pinocchio_forward(robot: Robot, q: np.ndarray[Any, np.dtype[np.float64]]) -> Call | str:
    """Return a loop over pinocchio.framesForwardKinematics of the same chain (m)."""
    pin: Any = peer("pinocchio")
    if isinstance(pin, str):
        return pin
    model = pin.Model()
    fixed = robot.fixed.copy()
    fixed[..., :3, 3] /= 1e3
    parent, after = 0, np.eye(4)
    for j in range(6):
        # Rz(sign q + offset) = Rz(offset) turn Rz(q) turn
        c, s = np.cos(robot.offset[j]), np.sin(robot.offset[j])
        turn = make_transform(np.diag([1.0, robot.sign[j], robot.sign[j]]))
        place = after @ fixed[j] @ make_transform([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ turn
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(place), f"joint {j + 1}")
        after = turn
    model.addFrame(pin.Frame("flange", parent, pin.SE3(after @ fixed[6]), pin.FrameType.OP_FRAME))
    data = model.createData()
    pin.framesForwardKinematics(model, data, q[0])
    ours = robot.forward(q[0])
    np.testing.assert_allclose(1e3 * data.oMf[1].translation, ours[:3, 3], atol=1e-6)
    np.testing.assert_allclose(data.oMf[1].rotation, ours[:3, :3], atol=1e-9)

    def call() -> None:
        for row in q:
            pin.framesForwardKinematics(model, data, row)

    return call


def toolbox_forward(robot: Robot, q: np.ndarray[Any, np.dtype[np.float64]], way: str) -> Call | str:
    """Return roboticstoolbox's batch of the same chain."""
    toolbox: Any = peer("roboticstoolbox")
    if isinstance(toolbox, str):
        return toolbox
    links = [
        toolbox.RevoluteMDH(alpha=alpha, a=a, d=d, offset=offset, flip=False)
        for alpha, a, d, offset in zip(robot.alpha, robot.a, robot.d, robot.offset, strict=True)
    ]
    arm = toolbox.DHRobot(links)
    theirs = q * robot.sign
    ets = arm.ets()
    np.testing.assert_allclose(ets.eval(theirs[:5]), robot.forward(q[:5]), atol=1e-6)
    return (lambda: ets.eval(theirs)) if way == "ets" else (lambda: arm.fkine(theirs))


def opw_inverse(robot: Robot, poses: np.ndarray[Any, np.dtype[np.float64]]) -> Call | str:
    """Return py-opw-kinematics' all branches of the same arm."""
    opw: Any = peer("py_opw_kinematics")
    if isinstance(opw, str):
        return opw
    arm = ortho_parallel(robot)
    model = opw.Robot(opw.KinematicModel(arm.a1, arm.a2, arm.b, arm.c1, arm.c2, arm.c3), degrees=False)
    theirs = invert_transform(arm.tf_base_root) @ poses @ invert_transform(arm.tf_wrist_flange)
    transforms = RigidTransform.from_matrix(theirs)
    return lambda: model.reach(transforms)
