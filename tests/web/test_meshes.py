"""Meshes of arms: dropped URDF folders and .zip files, their bad cases, and what the pages get."""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from fastapi.testclient import TestClient
from scipy.spatial.transform import Rotation

from truepose.cell import load_cell, template
from truepose.geometry import make_transform
from truepose.robots import Robot, load_robot, to_urdf
from truepose.robots.io import triangles
from truepose.robots.io.mesh_files import read_mesh
from truepose.web import Workspace, create_app, mesh_build, mesh_store, uploads
from truepose.web.mesh_build import BUDGET, Task, build
from truepose.web.mesh_names import resolve
from truepose.web.mesh_reduction import areas, reduced, shares
from truepose.web.security import CSRF_HEADER, Guard

MODEL = "kuka-kr6-r900-sixx"
CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = [(a, *pair) for a, b, c, d in QUADS for pair in ((b, c), (c, d))]
BOX = CORNERS * [0.1, 0.2, 0.3]  # m
Files = dict[str, bytes]


def stl(points: np.ndarray = BOX, faces: Any = FACES, count: int | None = None) -> bytes:
    corners = np.asarray(points, "<f4")[np.array(faces)]
    body = b"".join(np.zeros(3, "<f4").tobytes() + one.tobytes() + b"\0\0" for one in corners)
    return b"solid by no text".ljust(80) + struct.pack("<I", len(faces) if count is None else count) + body


def ascii_stl(points: np.ndarray = BOX, faces: Any = FACES) -> bytes:
    lines = ["solid box"]
    for face in faces:
        lines += [" facet normal 0 0 0", "  outer loop"]
        lines += ["   vertex " + " ".join(f"{x:.6e}" for x in points[k]) for k in face]
        lines += ["  endloop", " endfacet"]
    return "\r\n".join([*lines, "endsolid box", ""]).encode()


def obj(points: np.ndarray = BOX, faces: Any = FACES) -> bytes:
    lines = ["# a box", "mtllib none.mtl"] + ["v " + " ".join(map(str, p)) for p in points]
    lines += ["vn 0 0 1", *("f " + " ".join(f"{k + 1}//1" for k in face) for face in faces[:6])]
    return "\n".join([*lines, *("f " + " ".join(str(k - 8) for k in face) for face in faces[6:])]).encode()


DAE = """<?xml version="1.0" encoding="utf-8"?>
{before}<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><unit name="millimeter" meter="0.001"/><up_axis>Y_UP</up_axis></asset>
 <library_effects><effect id="e"><profile_COMMON><technique sid="t"><phong>
  <diffuse><color>1 0.5 0 1</color></diffuse></phong>
 </technique></profile_COMMON></effect></library_effects>
 <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="pa" count="24">{points}</float_array><technique_common>
   <accessor source="#pa" count="8" stride="3"/></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <{kind} material="s" count="{count}"><input semantic="VERTEX" source="#v" offset="0"/>
   <input semantic="NORMAL" source="#p" offset="1"/>{vcount}<p>{indices}</p></{kind}>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="vs"><node id="n"><translate>0 0 100</translate><rotate>0 0 1 90</rotate>
  <instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m"/>
  </technique_common></bind_material></instance_geometry>{inside}</node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#vs"/></scene></COLLADA>"""


def dae(before: str = "", inside: str = "", points: str | None = None, quads: bool = False) -> bytes:
    words = " ".join(str(x) for x in (1000 * BOX).ravel()) if points is None else points
    faces: list[Any] = QUADS if quads else FACES
    return DAE.format(
        before=before,
        inside=inside,
        points=words,
        kind="polylist" if quads else "triangles",
        count=len(faces),
        vcount="<vcount>4 4 4 4 4 4</vcount>" if quads else "",
        indices=" ".join(f"{k} 0" for face in faces for k in face),
    ).encode()


def urdf(visuals: dict[str, str], robot: Robot | None = None, head: str = "") -> bytes:
    """Return the arm of the cell with the visuals of some links, as `to_urdf` names them."""
    text = to_urdf(load_robot(MODEL) if robot is None else robot)
    for link, inner in visuals.items():
        text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{inner}</link>')
    return text.replace("<link", f"{head}<link", 1).encode()


def joined(parent: str, child: str, kind: str = "fixed", origin: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{parent} {child}" type="{kind}">{ends}{origin}</joint>'


def visual(name: str, origin: str = "", scale: str = "", material: str = "") -> str:
    scaled = f' scale="{scale}"' if scale else ""
    return f"<visual>{origin}<geometry><mesh filename={quoteattr(name)}{scaled}/></geometry>{material}</visual>"


def written(folder: Path, files: Files) -> dict[str, Path]:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return {name: folder / name for name in files}


def built(folder: Path, files: Files, robot: str | Robot = MODEL) -> tuple[Any, np.ndarray, np.ndarray]:
    """Return the index of an upload, its points and its triangles."""
    out = io.BytesIO()
    arm = load_robot(robot) if isinstance(robot, str) else robot
    index = build(arm, written(folder, files), out)
    data, count = out.getvalue(), sum(part.points for part in index.parts)
    assert len(data) == index.size
    return index, np.frombuffer(data, "<f4", 3 * count).reshape(-1, 3), np.frombuffer(data, "<u4", -1, 12 * count)


def world(robot: Robot, body: int, q: np.ndarray) -> np.ndarray:
    """Return the frame of a body as the pages move it: L_0 Rz(s_1 q_1) L_1 …"""
    tf, links = np.eye(4), robot.links(np.eye(4))
    for k in range(body):
        tf = tf @ links[k] @ make_transform(Rotation.from_rotvec([0.0, 0.0, robot.sign[k] * q[k]]))
    return tf


READERS = {"stl": stl(), "text.stl": ascii_stl(), "obj": obj(), "dae": dae(), "quads.dae": dae(quads=True)}


@pytest.mark.parametrize("name", READERS)
def test_every_format_gives_the_same_box(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"box.{name}"
    path.write_bytes(READERS[name])
    (mesh,) = read_mesh(path)
    assert areas(mesh.points, mesh.triangles) == pytest.approx(2 * (0.02 + 0.03 + 0.06), rel=1e-5)
    if name.endswith("dae"):  # unit, place in the scene and colour; the axis that is "up" is not applied
        assert mesh.points.min(axis=0) == pytest.approx([-0.2, 0.0, 0.1])
        assert mesh.points.max(axis=0) == pytest.approx([0.0, 0.1, 0.4])
        assert mesh.colour == (1.0, 0.5, 0.0)
    else:
        assert mesh.points.min(axis=0) == pytest.approx([0, 0, 0])
        assert mesh.points.max(axis=0) == pytest.approx([0.1, 0.2, 0.3])


LAUGHS = '<!ENTITY l0 "ha">' + "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
BAD = {
    "nan.stl": (stl(np.where(BOX > 0.25, np.nan, BOX)), "not finite"),
    "inf.obj": (obj().replace(b"v 0.1", b"v inf", 1), "not finite"),
    "word.obj": (obj().replace(b"v 0.1", b"v x", 1), "not a number"),
    "long.obj": (obj().replace(b"v 0.1", b"v 0." + b"1" * 10_000, 1), "not a number"),
    "less.stl": (stl(count=13), "states 13 triangles, but its size is that of 12"),
    "more.stl": (stl(count=4), "states 4 triangles"),
    "huge.stl": (stl(count=2**32 - 1), r"states 4,294,967,295 triangles"),
    "zero.stl": (stl(count=0), "states 0 triangles"),
    "none.stl": (stl(faces=np.empty((0, 3), int)), "no triangles"),
    "short.stl": (b"abc", "damaged"),
    "cut.stl": (ascii_stl()[:-200], "truncated"),
    "two.stl": (ascii_stl().replace(b"vertex", b"edge", 1), "truncated"),
    "corner.obj": (obj() + b"\nf 1 2 99", "does not exist"),
    "zero.obj": (obj() + b"\nf 0 1 2", "does not exist"),
    "before.obj": (obj() + b"\nf -9 1 2", "does not exist"),
    "xxe.dae": (dae('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>', points="&x;"), "DOCTYPE or ENTITY"),
    "laughs.dae": (dae(f"<!DOCTYPE r [{LAUGHS}]>", points="&l9;"), "DOCTYPE or ENTITY"),
    "utf16.dae": ('<!DOCTYPE r [<!ENTITY x "1">]>'.encode("utf-16"), "UTF-8"),
    "loop.dae": (dae(inside='<instance_node url="#n"/>'), "contain themselves"),
    "many.dae": (dae(inside='<instance_geometry url="#g"/>' * 10 + "<node/>" * 10_000), "more than 10,000 nodes"),
    "refers.dae": (dae(inside='<instance_geometry url="other.dae#g"/>'), "not in the file"),
    "few.dae": (dae(points="1 2 3"), "does not exist"),
    "nan.dae": (dae(points="nan " * 24), "not finite"),
    "not.dae": (b"<html/>", "is not COLLADA"),
    "cut.dae": (dae()[:900], "not XML"),
    "box.step": (b"ISO-10303-21;", "expected .stl, .obj or .dae"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_mesh_that_cannot_be_read_leaves_the_shell_and_a_note_that_names_it(tmp_path: Path, name: str) -> None:
    content, words = BAD[name]
    arm = urdf({"base_link": visual("box.stl"), "link_2": visual(f"package://arm/{name}")})
    index, _, _ = built(tmp_path, {"arm/a.urdf": arm, f"arm/{name}": content, "arm/box.stl": stl()})
    (note,) = index.notes
    assert note.kind == "unreadable"
    assert name in note.name
    assert words.replace("\\", "") in note.detail
    assert str(tmp_path) not in note.detail
    assert {part.body for part in index.parts} == {0}
    assert index.placeholders == [1, 2, 3, 4, 5, 6]


def test_meshes_of_ten_million_triangles_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(triangles, "MOST_TRIANGLES", 1000)
    fan = b"v 0 0 0\nv 0 0 1\nv 0 1 0\nf " + b"1 2 3 " * 1000
    files = {
        "a.urdf": urdf({"link_1": visual("large.stl"), "link_2": visual("many.obj"), "link_3": visual("many.dae")})
    }
    faces = " ".join("0 0 1 1 2 2" for _ in range(1001))
    many = dae().replace(b"<p>", b"<p>" + faces.encode() + b" ")
    paths = written(tmp_path, files | {"large.stl": b"", "many.obj": fan, "many.dae": many})
    with paths["large.stl"].open("r+b") as file:
        file.seek(80)
        file.write(struct.pack("<I", 10**7))
        file.truncate(84 + 50 * 10**7)  # no disk is used for the zeros
    index = build(load_robot(MODEL), paths, io.BytesIO())
    details = [note.detail for note in index.notes]
    assert "expected at most 64 MiB" in details[0]
    assert ["at most 1,000 are read" in one for one in details] == [False, True, True]


@pytest.mark.parametrize("q", [np.zeros(6), np.deg2rad([10.0, -80.0, 95.0, 15.0, 40.0, -25.0])])
def test_meshes_move_with_the_links_of_the_urdf(tmp_path: Path, q: np.ndarray) -> None:
    """The visual's origin, the unit and the scale are right, whatever the frames of the cell's own convention are."""
    robot = load_robot(MODEL)
    origin = '<origin xyz="0.01 -0.02 0.05" rpy="0.3 -0.2 1.1"/>'
    names = [*(f"link_{k}" for k in range(1, 7))]
    arm = urdf({name: visual("m/box.stl", origin, "0.001 0.002 -0.003") for name in names})
    index, points, _ = built(tmp_path, {"a.urdf": arm, "m/box.stl": stl(1000 * BOX)})
    local = (1000 * BOX) * [1.0, 2.0, -3.0]
    tf_link_visual = make_transform(Rotation.from_euler("xyz", [0.3, -0.2, 1.1]), np.array([10.0, -20.0, 50.0]))
    assert [part.body for part in index.parts] == [1, 2, 3, 4, 5, 6]
    fixed = robot.fixed.copy()
    fixed[:-1] = fixed[:-1] @ make_transform(Rotation.from_rotvec(np.array([[0.0, 0.0, o] for o in robot.offset])))
    tf = np.eye(4)
    for part in index.parts:
        k = part.body - 1
        tf = tf @ fixed[k] @ make_transform(Rotation.from_rotvec([0.0, 0.0, robot.sign[k] * q[k]]))
        expected = (tf @ tf_link_visual @ np.column_stack([local, np.ones(8)]).T)[:3].T
        got = points[part.first_point : part.first_point + part.points]
        shown = (world(robot, part.body, q) @ np.column_stack([got, np.ones(len(got))]).T)[:3].T
        assert np.array(sorted(shown.round(2).tolist())) == pytest.approx(
            np.array(sorted(expected.round(2).tolist())), abs=0.02
        )


def test_the_base_of_ros_may_be_turned_and_lie_lower(tmp_path: Path) -> None:
    tf = make_transform(Rotation.from_rotvec([0.0, 0.0, np.pi]), np.array([0.0, 0.0, 450.0]))
    robot = load_robot(MODEL)
    text = to_urdf(robot).replace('<link name="base_link"/>', '<link name="base_link"/><link name="world"/>')
    x, y, z = tf[:3, 3] / 1000
    origin = f'<origin xyz="{x} {y} {z}" rpy="0 0 {np.pi}"/>'
    joint = joined("world", "base_link", origin=origin)
    text = text.replace('<link name="link_1"/>', f'<link name="link_1">{visual("box.stl")}</link>')
    text = text.replace("</robot>", joint + "</robot>")
    moved, points, _ = built(tmp_path / "a", {"a.urdf": text.encode(), "box.stl": stl()})
    plain, same, _ = built(tmp_path / "b", {"a.urdf": urdf({"link_1": visual("box.stl")}), "box.stl": stl()})
    assert [note.kind for note in moved.notes] == ["base_moved"]
    assert "-450.0 mm" in moved.notes[0].detail
    assert plain.notes == []
    assert points == pytest.approx(same, abs=1e-3)
    base = '<link name="base"/>' + joint + joined("world", "base", origin=origin)
    named = text.replace(joint, "").replace("</robot>", f"{base}</robot>")
    stated, again, _ = built(tmp_path / "c", {"a.urdf": named.encode(), "box.stl": stl()})
    assert stated.notes == []
    assert again == pytest.approx(same, abs=1e-3)


def test_another_arm_is_refused_with_the_differences(tmp_path: Path) -> None:
    five = Robot("five", alpha=np.zeros(5), a=np.full(5, 200.0), d=np.zeros(5), offset=np.zeros(5))
    with pytest.raises(ValueError, match=r"a\.urdf: the arm has 5 turning joints, that of this cell .* has 6"):
        built(tmp_path / "1", {"a.urdf": urdf({}, five)})
    with pytest.raises(ValueError, match=r"joint 3: \d+\.\d mm, .*upload the URDF of this arm"):
        built(tmp_path / "2", {"a.urdf": urdf({}, load_robot("kuka-kr210-r2700-extra"))})


@pytest.mark.parametrize(("shift", "notes"), [(0.5, 0), (4.0, 1), (40.0, None)])
def test_differences_of_some_mm_are_shown(tmp_path: Path, shift: float, notes: int | None) -> None:
    robot = load_robot(MODEL)
    a = robot.a.copy()
    a[2] += shift
    other = Robot(
        "other",
        alpha=robot.alpha,
        a=a,
        d=robot.d,
        offset=robot.offset,
        beta=robot.beta,
        sign=robot.sign,
        limits=robot.limits,
        tf_base_first=robot.tf_base_first,
        tf_last_flange=robot.tf_last_flange,
    )
    files = {"a.urdf": urdf({"link_1": visual("box.stl")}, other), "box.stl": stl()}
    if notes is None:
        with pytest.raises(ValueError, match=r"joint 3: 40\.0 mm"):
            built(tmp_path, files)
        return
    index, _, _ = built(tmp_path, files)
    assert index.joints[2].distance_mm == pytest.approx(shift)
    assert ("differs" in {note.kind for note in index.notes}) == bool(notes)


@pytest.mark.parametrize(
    ("reference", "found"),
    [
        ("package://my_arm/meshes/visual/a.stl", ["repo/my_arm/meshes/visual/a.stl"]),
        ("package://MY_ARM/Meshes/visual/A.STL", ["repo/my_arm/meshes/visual/a.stl"]),
        ("package://renamed/meshes/visual/a.stl", ["repo/my_arm/meshes/visual/a.stl"]),
        ("$(find my_arm)/meshes/visual/a.stl", ["repo/my_arm/meshes/visual/a.stl"]),
        ("../meshes/collision/a.stl", ["repo/my_arm/meshes/collision/a.stl"]),
        ("..\\meshes\\visual\\a.stl", ["repo/my_arm/meshes/visual/a.stl"]),
        ("C:\\ros\\my_arm\\meshes\\visual\\a.stl", ["repo/my_arm/meshes/visual/a.stl"]),
        ("file:///home/me/my_arm/meshes/visual/a.stl", ["repo/my_arm/meshes/visual/a.stl"]),
        ("package://my_arm/meshes/with%20blank.stl", ["repo/my_arm/meshes/with blank.stl"]),
        ("../../../../../../etc/passwd", []),
        ("package://my_arm/meshes/b.stl", []),
        ("", []),
        ("..", []),
    ],
)
def test_a_reference_is_resolved_among_the_uploaded_names_only(reference: str, found: list[str]) -> None:
    names = ["meshes/visual/a.stl", "meshes/collision/a.stl", "meshes/with blank.stl", "urdf/arm.urdf"]
    files = {f"repo/my_arm/{name}": Path() for name in names}
    assert resolve(reference, "repo/my_arm/urdf/arm.urdf", files) == found


def test_of_equal_names_that_beside_the_urdf_is_meant_and_others_are_ambiguous(tmp_path: Path) -> None:
    arm = urdf({"link_1": visual("package://gone/box.stl")})
    index, _, _ = built(tmp_path / "1", {"x/a.urdf": arm, "x/box.stl": stl(), "y/box.stl": stl(2 * BOX)})
    assert index.notes == []
    index, _, _ = built(tmp_path / "2", {"a.urdf": arm, "x/box.stl": stl(), "y/box.stl": stl(2 * BOX)})
    (note,) = index.notes
    assert (note.kind, note.detail) == ("ambiguous", "x/box.stl, y/box.stl")
    assert index.placeholders == list(range(7))


def test_missing_meshes_become_placeholders(tmp_path: Path) -> None:
    markup = "<img src=x onerror=alert(1)>.stl"
    arm = urdf({"link_1": visual("box.stl") + visual(markup), "link_2": visual("box.stl")})
    index, _, _ = built(tmp_path, {"a.urdf": arm, "box.stl": stl()})
    assert [(note.kind, note.name) for note in index.notes] == [("missing", markup)]
    assert index.placeholders == [0, 1, 3, 4, 5, 6]
    assert {part.body for part in index.parts} == {1, 2}


def test_solids_colours_and_links_beside_the_arm(tmp_path: Path) -> None:
    solids = {
        "base_link": '<visual><geometry><box size="0.2 0.4 0.6"/></geometry><material name="orange"/></visual>',
        "link_1": '<visual><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.1" length="0.5"/></geometry></visual>',
        "link_2": '<visual><geometry><sphere radius="0.1"/></geometry></visual>',
        "link_3": visual("box.dae"),
        "link_4": visual("box.dae", material='<material name="own"><color rgba="0 0 1 1"/></material>'),
    }
    head = '<material name="orange"><color rgba="1 0.4 0 1"/></material>'
    text = urdf(solids, head=head).decode()
    finger = f'<link name="finger">{visual("box.stl")}</link>' + joined("tool0", "finger", "prismatic")
    shelf = f'<link name="shelf">{visual("box.stl")}</link>' + joined("link_3", "shelf")
    text = text.replace("</robot>", f"{finger}{shelf}</robot>")
    index, points, indices = built(tmp_path, {"a.urdf": text.encode(), "box.dae": dae(), "box.stl": stl()})
    of = {
        part.body: points[part.first_point : part.first_point + part.points] for part in index.parts if part.body != 3
    }
    colours = {part.body: part.colour for part in index.parts if part.body != 3}
    assert colours == {0: "#ff6600", 1: None, 2: None, 4: "#0000ff"}
    assert sorted(str(part.colour) for part in index.parts if part.body == 3) == ["#ff8000", "None"]
    assert np.ptp(of[0], axis=0) == pytest.approx([200, 400, 600], abs=1e-3)
    assert np.linalg.norm(of[2] - of[2].mean(axis=0), axis=1) == pytest.approx(100, abs=1e-3)
    assert [(note.kind, note.name) for note in index.notes] == [("apart", "finger")]
    part = next(part for part in index.parts if part.body == 1)
    used = indices[part.first_index : part.first_index + part.indices].reshape(-1, 3) - part.first_point
    assert areas(of[1].astype(float), used) == pytest.approx(2 * np.pi * 100 * 100 + 2 * np.pi * 100 * 500, rel=0.01)


def looped(name: str, kind: str) -> bytes:
    """Return a URDF file of two links, each on the other one."""
    joints = joined(name, "b", kind) + joined("b", name, kind)
    return f'<robot name="r"><link name="{name}"/><link name="b"/>{joints}</robot>'.encode()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.urdf.xacro", b"<robot/>", "xacro files must be expanded first"),
        (
            "a.urdf",
            b'<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="m"/></robot>',
            "expand them",
        ),
        ("a.urdf", b'<robot name="r"><xacro:macro name="m"/></robot>', "not XML: unbound prefix"),
        ("box.stl", stl(), "no .urdf file among 1 files"),
        ("a.urdf", b'<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot>&x;</robot>', "DOCTYPE"),
        ("a.urdf", looped("a", "revolute"), "a loop of links"),
        ("a.urdf", looped("tool0", "fixed"), "loop"),
        ("a.urdf", urdf({"link_1": visual("a.stl", scale="1 nan 1")}), "mesh scale must be 3 finite numbers"),
        ("a.urdf", urdf({"link_1": "<visual/>"}), "without geometry"),
        ("a.urdf", urdf({"link_1": visual("a.stl") * 300}), "at most 200"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_refused(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=r"(?s).") as raised:
        built(tmp_path, {name: content})
    assert words in str(raised.value)
    assert str(tmp_path) not in str(raised.value)


def test_a_loop_of_links_apart_from_the_arm_is_not_followed(tmp_path: Path) -> None:
    loop = f'<link name="p">{visual("box.stl")}</link><link name="q"/>' + joined("p", "q") + joined("q", "p")
    text = urdf({"link_1": visual("box.stl")}).decode().replace("</robot>", f"{loop}</robot>")
    index, _, _ = built(tmp_path, {"a.urdf": text.encode(), "box.stl": stl()})
    assert [(note.kind, note.name) for note in index.notes] == [("apart", "p")]


def test_the_urdf_of_the_cells_arm_is_chosen_among_several(tmp_path: Path) -> None:
    files = {
        "a/other.urdf": urdf({"link_1": visual("box.stl")}, load_robot("kuka-kr210-r2700-extra")),
        "a/broken.urdf": b"<robot>",
        "a/this.urdf": urdf({"link_1": visual("box.stl")}),
        "a/box.stl": stl(),
    }
    index, _, _ = built(tmp_path, files)
    assert index.urdf == "a/this.urdf"


def test_a_mesh_in_millimetres_without_a_scale_is_not_shown_as_a_tower(tmp_path: Path) -> None:
    files = {"a.urdf": urdf({"link_1": visual("box.stl")}), "box.stl": stl(1000 * BOX)}
    (note,) = built(tmp_path, files)[0].notes
    assert (note.kind, note.name) == ("too_large", "box.stl")


def sphere(steps: int) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, steps))
    points = np.column_stack(
        [np.sin(u.ravel()) * np.cos(v.ravel()), np.sin(u.ravel()) * np.sin(v.ravel()), np.cos(u.ravel())]
    )
    k = (np.arange(steps - 1)[:, None] * steps + np.arange(steps - 1)).ravel()
    return points, np.vstack(
        [np.column_stack([k, k + 1, k + steps]), np.column_stack([k + 1, k + steps + 1, k + steps])]
    )


def test_reduction_keeps_the_shape_within_the_budget(tmp_path: Path) -> None:
    points, faces = sphere(200)
    fewer, used = reduced(points, faces.astype(np.int32), 2000)
    assert 0 < len(used) <= 2000
    assert np.linalg.norm(fewer, axis=1) == pytest.approx(1.0, abs=0.01)
    assert areas(fewer, used) == pytest.approx(4 * np.pi, rel=0.01)
    # poles, where hundreds of edges meet, do not collapse by themselves
    few, least = reduced(points, faces.astype(np.int32), 200)
    assert 0 < len(least) <= 240
    assert areas(few, least) == pytest.approx(4 * np.pi, rel=0.05)
    soup = np.random.default_rng(0).uniform(size=(30_000, 3))
    _, left = reduced(soup, np.arange(30_000, dtype=np.int32).reshape(-1, 3), 500)
    assert len(left) <= 600
    files = {"a.urdf": urdf({f"link_{k}": visual("ball.stl", scale="0.1 0.1 0.1") for k in range(1, 7)})}
    index, shown, used = built(tmp_path, files | {"ball.stl": stl(points, faces)})
    assert index.source_triangles == 6 * len(faces)
    assert 0.8 * BUDGET < index.triangles <= BUDGET
    assert used.max() == len(shown) - 1


def test_meshes_without_area_or_with_equal_points_do_not_break_the_reduction() -> None:
    flat = np.zeros((300, 3))
    faces = np.random.default_rng(1).integers(0, 300, (3000, 3)).astype(np.int32)
    assert reduced(flat, faces, 10)[1].shape == (0, 3)
    line = np.column_stack([np.arange(300.0), np.zeros(300), np.zeros(300)])
    points, left = reduced(line, faces, 100)
    assert np.isfinite(points).all()
    assert len(left) <= 120
    for most in range(4):
        assert len(reduced(*sphere(20)[:1], sphere(20)[1].astype(np.int32), most)[1]) <= 4
    assert shares(100, [0, 5, 1000], [0.0, 0.0, 0.0])[:2] == [0, 5]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "cell.toml").write_text(template(MODEL), "utf-8")
    return tmp_path


@pytest.fixture
def client(root: Path) -> TestClient:
    guard = Guard(port=8765)
    client = TestClient(
        create_app(Workspace(root), guard), base_url="http://127.0.0.1:8765", raise_server_exceptions=False
    )
    client.get(f"/?token={guard.token}")
    client.headers[CSRF_HEADER] = guard.csrf
    return client


@pytest.fixture
def address(root: Path) -> str:
    return f"/api/v1/cells/{Workspace(root).cells()[0].id}/meshes"


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[Task]:
    """Compute in this process; return the tasks."""
    tasks = []

    def run(task: Task) -> Any:
        tasks.append(task)
        with task.out.open("xb") as out:
            return build(load_cell(task.cell).load_robot(), task.files, out)

    monkeypatch.setattr(mesh_store, "_in_own_process", run)
    return tasks


def send(client: TestClient, address: str, files: Files) -> Any:
    return client.post(address, files=[("files", (name, content)) for name, content in files.items()])


def zipped(files: Files, **how: Any) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return file.getvalue()


GOOD = {"arm/urdf/a.urdf": urdf({"link_1": visual("package://arm/meshes/box.stl")}), "arm/meshes/box.stl": stl()}


def kept(root: Path) -> list[str]:
    folder = root / ".truepose" / "meshes"
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_upload_again_and_remove(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    assert client.get(address).json()["hash"] is None
    assert client.get(f"{address}.bin").status_code == 404
    answer = send(client, address, GOOD)
    assert answer.status_code == 201
    index = answer.json()
    assert client.get(address).json() == index
    data = client.get(f"{address}.bin", params={"version": index["hash"]})
    assert len(data.content) == index["size"]
    assert "immutable" in data.headers["cache-control"]
    assert "immutable" not in client.get(f"{address}.bin", params={"version": "0"}).headers["cache-control"]
    assert send(client, address, GOOD).json() == index
    assert len(here) == 1
    assert len(kept(root)) == 3
    other = send(client, address, {"arm.zip": zipped(GOOD)}).json()
    assert other["hash"] != index["hash"]
    assert other["parts"] == index["parts"]
    assert len(kept(root)) == 3  # those that no cell uses are gone
    assert client.delete(address).status_code == 204
    assert client.delete(address).status_code == 204
    assert client.get(address).json()["hash"] is None
    assert kept(root) == []


def test_a_refused_upload_changes_nothing(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    index = send(client, address, GOOD).json()
    before = kept(root)
    answer = send(client, address, {"a.urdf": b"<robot>"})
    assert answer.status_code == 422
    assert answer.json()["line"] == 1
    assert str(root) not in answer.text
    assert client.get(address).json() == index
    assert kept(root) == before


@pytest.mark.parametrize("damage", ["index", "data", "pointer"])
def test_damaged_caches_are_as_good_as_none(
    client: TestClient, address: str, root: Path, here: list[Task], damage: str
) -> None:
    index = send(client, address, GOOD).json()
    folder = root / ".truepose" / "meshes"
    pointer = next((folder / "cells").iterdir())
    path = {
        "index": folder / index["hash"] / "index.json",
        "data": folder / index["hash"] / "mesh.bin",
        "pointer": pointer,
    }
    path[damage].write_bytes(b"../../../one" if damage == "pointer" else b"[")
    assert client.get(address).json()["hash"] is None
    assert client.get(f"{address}.bin").status_code == 404
    assert send(client, address, GOOD).json() == index
    assert len(client.get(f"{address}.bin").content) == index["size"]


def test_meshes_of_another_robot_are_stale(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    index = send(client, address, GOOD).json()
    file = root / "one" / "cell.toml"
    text = file.read_text("utf-8")
    file.write_text(text.replace(MODEL, "kuka-kr210-r2700-extra"), "utf-8")
    now = client.get(address).json()
    assert (now["hash"], now["stale"], now["parts"]) == (None, True, [])
    assert client.get(f"{address}.bin").status_code == 404
    file.write_text(text, "utf-8")
    assert client.get(address).json() == index


def test_two_cells_share_meshes(client: TestClient, address: str, root: Path, here: list[Task]) -> None:
    (root / "two").mkdir()
    (root / "two" / "cell.toml").write_text(template(MODEL), "utf-8")
    first, second = (f"/api/v1/cells/{cell.id}/meshes" for cell in Workspace(root).cells())
    assert send(client, first, GOOD).json() == send(client, second, GOOD).json()
    assert len(here) == 1
    client.delete(first)
    assert client.get(second).json()["hash"] is not None


def bad_zip(name: str, content: bytes = stl(), *, link: bool = False) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for given, data in GOOD.items():
            archive.writestr(given, data)
        info = zipfile.ZipInfo(name)
        info.compress_type = zipfile.ZIP_DEFLATED
        if link:
            info.create_system, info.external_attr = 3, 0o120777 << 16
        archive.writestr(info, content)
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (bad_zip("../up.stl"), "leads out of the .zip"),
        (bad_zip("/etc/up.stl"), "leads out of the .zip"),
        (bad_zip("C:\\up.stl"), "leads out of the .zip"),
        (bad_zip("arm/meshes/BOX.stl"), "differ only in case"),
        (bad_zip("bomb.stl", bytes(200 << 20)), "more than 100 times its size"),
        (b"PK", "is no .zip"),
    ],
)
def test_a_bad_zip_is_refused_whole(
    client: TestClient, address: str, root: Path, here: list[Task], content: bytes, words: str
) -> None:
    answer = send(client, address, {"arm.zip": content})
    assert answer.status_code == 422
    assert words in answer.json()["detail"]
    assert kept(root) == []


def test_a_link_in_a_zip_is_not_followed(client: TestClient, address: str, here: list[Task]) -> None:
    files = {"a.urdf": urdf({"link_1": visual("secret.stl"), "link_2": visual("box.stl")}), "box.stl": stl()}
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
        info = zipfile.ZipInfo("secret.stl")
        info.create_system, info.external_attr = 3, 0o120777 << 16
        archive.writestr(info, "/etc/passwd")
    notes = send(client, address, {"arm.zip": file.getvalue()}).json()["notes"]
    assert [note["kind"] for note in notes] == ["link", "missing"]
    assert "secret.stl" in notes[0]["name"]


def test_names_of_a_dropped_folder_are_never_paths(
    client: TestClient, address: str, root: Path, here: list[Task]
) -> None:
    files = {"../../arm/urdf/a.urdf": GOOD["arm/urdf/a.urdf"], "C:\\x\\arm\\meshes\\box.stl": stl()}
    before = {path for path in root.parent.rglob("*") if ".truepose" not in path.parts}
    index = send(client, address, files).json()
    assert index["notes"] == []
    assert {path for path in root.parent.rglob("*") if ".truepose" not in path.parts} == before
    answer = send(client, address, {"a/x.urdf": b"1", "a/X.urdf": b"2"})
    assert answer.status_code == 422
    assert "case" in answer.json()["detail"]


def test_a_large_upload_is_refused(client: TestClient, address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "LARGEST_FILE", 1000)
    answer = send(client, address, {"a.stl": bytes(2000)})
    assert answer.status_code == 413


def test_the_work_is_done_in_another_process(
    client: TestClient, address: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readers and the reduction hold Python's lock for seconds, in which a server would answer nobody."""

    def here(*_: Any) -> None:
        raise AssertionError("computed in the process of the server")

    monkeypatch.setattr(mesh_build, "build", here)
    points, faces = sphere(250)  # more than the budget
    answer = send(client, address, GOOD | {"arm/meshes/box.stl": stl(points, faces)})
    assert answer.status_code == 201
    index = answer.json()
    assert index["source_triangles"] == len(faces)
    assert 0 < index["triangles"] <= BUDGET
    assert len(client.get(f"{address}.bin").content) == index["size"]
    broken = send(client, address, {"a.urdf": b"<robot>"})
    assert (broken.status_code, broken.json()["file"], broken.json()["line"]) == (422, "a.urdf", 1)
    assert broken.json()["detail"].count("a.urdf") == 1


def test_a_process_that_dies_or_hangs_is_told(
    client: TestClient, address: str, root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_store, "_DEADLINE_S", 0.01)
    answer = send(client, address, GOOD)
    assert answer.status_code == 422
    assert "take more than" in answer.json()["detail"]
    monkeypatch.undo()
    monkeypatch.setattr(mesh_store.sys, "executable", "/bin/false")
    answer = send(client, address, GOOD)
    assert answer.status_code == 422
    assert "lower resolution" in answer.json()["detail"]
    assert kept(root) == []
