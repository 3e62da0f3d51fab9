"""URDF folders of our own making, for tests of meshes: the arm of a cell with boxes and spheres."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.geometry import make_transform
from truepose.robots import Robot, load_robot, to_urdf
from truepose.web.meshes.build import build

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


def sphere(steps: int) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, steps))
    points = np.column_stack(
        [np.sin(u.ravel()) * np.cos(v.ravel()), np.sin(u.ravel()) * np.sin(v.ravel()), np.cos(u.ravel())]
    )
    k = (np.arange(steps - 1)[:, None] * steps + np.arange(steps - 1)).ravel()
    return points, np.vstack(
        [np.column_stack([k, k + 1, k + steps]), np.column_stack([k + 1, k + steps + 1, k + steps])]
    )


GOOD = {"arm/urdf/a.urdf": urdf({"link_1": visual("package://arm/meshes/box.stl")}), "arm/meshes/box.stl": stl()}
