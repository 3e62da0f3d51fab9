"""From files to the meshes of an arm: formats, places of links, other arms, names, and the reduction."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.web.arm_files import (
    BOX,
    MODEL,
    ascii_stl,
    built,
    dae,
    joined,
    obj,
    sphere,
    stl,
    urdf,
    visual,
    world,
    written,
)

from truepose.errors import FileError
from truepose.geometry import make_transform
from truepose.robots import Robot, load_robot, to_urdf
from truepose.robots.io import triangles
from truepose.robots.io.mesh_files import read_mesh
from truepose.web.meshes.build import BUDGET, build
from truepose.web.meshes.names import resolve
from truepose.web.meshes.reduction import areas, reduced, shares

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
    "signal.stl": (stl()[:96] + b"\x01\x00\x80\x7f" + stl()[100:], "not finite"),
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
    "far.dae": (dae(inside="<node><scale>1e200 1e200 1e200</scale></node>"), "impossibly large"),
    "inf.dae": (dae(points="1e999 " * 24), "not finite"),
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


@pytest.mark.parametrize("name", READERS)
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path: Path, name: str) -> None:
    rng, path = np.random.default_rng(0), tmp_path / f"box.{name}"
    pieces = [b"nan", b"-1", b"1e308", b"-1e999", b"99999999999", b"\0", b"<", b"/>", b'"', b" ", b"\n", b"//"]
    for _ in range(300):
        data = bytearray(READERS[name])
        for _ in range(rng.integers(1, 4)):
            start = int(rng.integers(len(data)))
            data[start : start + int(rng.integers(0, 20))] = pieces[rng.integers(len(pieces))]
        path.write_bytes(data)
        try:
            meshes = read_mesh(path)
        except FileError:
            continue
        assert all(np.isfinite(mesh.points).all() for mesh in meshes)


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


@pytest.mark.exhaustive
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
