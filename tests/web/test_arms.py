"""Pictures of arms: parts that hang together, moved as the pages move them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from scipy.spatial.transform import Rotation

from truepose.cell import template
from truepose.geometry import make_transform
from truepose.robots import list_robots, load_robot
from truepose.web import Workspace, create_app
from truepose.web.arms.shells import body_transforms, resting_pose, shells
from truepose.web.security import Guard

REGION = """
[region]
x_mm = 800.0
y_mm = 100.0
z_mm = 600.0
a_deg = 90.0
size_mm = [300.0, 200.0, 100.0]
home_deg = [0.0, -90.0, 90.0, 0.0, 45.0, 0.0]

[obstacles.table]
x_mm = [500.0, 900.0]
y_mm = [-400.0, 400.0]
z_mm = [0.0, 300.0]
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "cell.toml").write_text(template("kuka-kr6-r900-sixx") + REGION, "utf-8")
    return tmp_path


@pytest.fixture
def client(root: Path) -> TestClient:
    guard = Guard(port=8765)
    client = TestClient(create_app(Workspace(root), guard), base_url="http://127.0.0.1:8765")
    client.get(f"/?token={guard.token}")
    return client


def moved(picture: dict, q: np.ndarray) -> np.ndarray:
    """Return the poses of all bodies and of the tool, as the pages compute them."""
    links, poses = np.array(picture["bodies"]), [np.eye(4)]
    for k, turn in enumerate(np.array(picture["sign"]) * q):
        poses.append(poses[-1] @ links[k] @ make_transform(Rotation.from_rotvec([0.0, 0.0, turn])))
    return np.array([*poses, poses[-1] @ links[-1]])


@pytest.mark.parametrize("name", list_robots())
def test_the_parts_of_every_arm_reach_from_joint_to_joint(name: str) -> None:
    robot = load_robot(name)
    tool = make_transform(Rotation.from_rotvec([0.3, 0.2, 0.1]), np.array([30.0, -20.0, 150.0]))
    bodies, parts = body_transforms(robot), shells(robot, tool)
    for body, link in enumerate(bodies):
        way = [part for part in parts if part.body == body and part.kind == "link"]
        start = np.zeros(3)
        for part in way:
            assert part.start == pytest.approx(start)
            start = part.end
        assert start == pytest.approx(link[:3, 3], abs=5.0)  # a link of some mm is not drawn
    assert [part.body for part in parts if part.kind == "drum"] == list(range(1, robot.dof + 1))
    assert parts[-1].end == pytest.approx((bodies[-1] @ tool)[:3, 3])
    assert min(min(part.radii) for part in parts) > 0
    radii = [radius for part in parts if part.kind == "link" for radius in part.radii]
    assert radii == sorted(radii, reverse=True)
    assert robot.within_limits(resting_pose(robot)).all()


@pytest.mark.parametrize("name", ["kuka-kr6-r900-sixx", "universal-robots-ur10"])
def test_a_page_that_moves_the_bodies_gets_the_poses_of_the_chain(client: TestClient, name: str) -> None:
    q = np.deg2rad([10.0, -80.0, 95.0, 15.0, 40.0, -25.0])
    asked = ",".join(map(str, np.rad2deg(q)))
    picture = client.get(f"/api/v1/robots/{name}/arm", params={"q": asked}).json()
    robot = load_robot(name)
    poses = moved(picture, q)
    assert poses[-1] == pytest.approx(robot.forward(q))
    assert np.array(picture["frames"])[-1] == pytest.approx(robot.forward(q))
    if robot.convention == "mdh":
        assert poses[1:-1, :3, 2] == pytest.approx(np.array(picture["frames"])[:6, :3, 2])


def test_a_cell_shows_tool_region_and_obstacles_in_the_base_frame(client: TestClient, root: Path) -> None:
    cell = Workspace(root).cells()[0]
    picture = client.get(f"/api/v1/cells/{cell.id}/arm").json()
    stated = cell.load()
    assert picture["q_deg"] == pytest.approx(stated.region.home_deg)
    tool = stated.load_robot().forward(np.deg2rad(picture["q_deg"]), tool=stated.tf_flange_tool)
    assert moved(picture, np.deg2rad(picture["q_deg"]))[-1] == pytest.approx(tool)
    region = np.array(picture["region"]["tf_base_box"])
    assert region[:3, 3] == pytest.approx([800, 100, 600])
    assert region[:3, 0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert picture["region"]["size_mm"] == [300, 200, 100]
    (table,) = picture["obstacles"]
    assert table["name"] == "table"
    assert np.array(table["tf_base_box"])[:3, 3] == pytest.approx([700, 0, 150])
    assert table["size_mm"] == [400, 800, 300]


@pytest.mark.parametrize("q", ["", "1,2", "a,b,c,d,e,f", "nan,0,0,0,0,0", "9999,0,0,0,0,0", "1,2,3,4,5,6,7"])
def test_joints_that_are_none_are_refused(client: TestClient, q: str) -> None:
    answer = client.get("/api/v1/robots/kuka-kr6-r900-sixx/arm", params={"q": q})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("name", ["none", "..%2F..%2Fcell.toml", "one/cell.toml"])
def test_only_robots_of_the_library_have_a_picture_by_name(client: TestClient, name: str) -> None:
    assert client.get(f"/api/v1/robots/{name}/arm").status_code == 404


def test_a_broken_cell_file_is_told_with_its_line(client: TestClient, root: Path) -> None:
    file = root / "one" / "cell.toml"
    file.write_text(file.read_text("utf-8").replace("x_mm = 800.0", "x_mm = true"), "utf-8")
    answer = client.get(f"/api/v1/cells/{Workspace(root).cells()[0].id}/arm")
    assert answer.status_code == 422
    assert answer.json()["line"] > 1
