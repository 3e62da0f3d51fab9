"""Meshes in a real browser: dropped, drawn in few calls instead of the shells, and removed again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.browser.opening import Browser, Opened, Server
from tests.web.arm_files import GOOD, sphere, stl, urdf, visual

from truepose.cell import load_cell

MARKUP = "<img src=x onerror=alert(1)>.stl"


@pytest.fixture
def folder(own_server: Server, tmp_path: Path) -> Path:
    """A URDF folder of the virtual cell's arm: a mesh on each body but the last one, whose mesh is missing."""
    robot = load_cell(own_server.workspace / "virtual-cell" / "cell.toml").load_robot()
    names = ["base_link", *(f"link_{k}" for k in range(1, robot.dof))]
    visuals = {name: visual("package://arm/meshes/box.stl") for name in names}
    points, faces = sphere(60)
    files = {
        "arm/urdf/arm.urdf": urdf(visuals | {f"link_{robot.dof}": visual(MARKUP)}, robot),
        "arm/meshes/box.stl": stl(0.2 * points, faces),
    }
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    return tmp_path / "arm"


def drawn(opened: Opened) -> dict[str, Any]:
    opened.page.wait_for_timeout(300)  # the next frame
    counters: dict[str, Any] = opened.page.evaluate("document.querySelector('.scene-host').scene.counters()")
    return counters


def test_meshes_replace_the_shells_and_go_again(browser: Browser, own_server: Server, folder: Path) -> None:
    with browser.opened(own_server) as opened:
        opened.go("cell")
        page = opened.page
        page.wait_for_function("() => document.querySelector('.scene-host')?.scene?.counters().triangles > 100")
        shells = drawn(opened)
        page.click("text=Meshes of the arm")
        page.set_input_files("input[webkitdirectory]", str(folder))
        page.wait_for_selector("text=Remove meshes", timeout=120_000)
        assert MARKUP in page.inner_text(".meshes li")
        meshes = drawn(opened)
        assert meshes["triangles"] > shells["triangles"] + 20_000
        assert meshes["calls"] <= shells["calls"] + 1 <= 20
        assert not opened.overflow()
        page.set_viewport_size({"width": 390, "height": 844})
        assert not opened.overflow()
        page.reload()
        opened.ready()
        page.wait_for_function("() => document.querySelector('.scene-host')?.scene?.counters().triangles > 20000")
        page.click("text=Meshes of the arm")
        page.click("text=Remove meshes")
        page.wait_for_selector("text=Remove meshes", state="detached")
        gone = drawn(opened)
        assert {key: gone[key] for key in ("triangles", "geometries", "gpuBytes")} == {
            key: shells[key] for key in ("triangles", "geometries", "gpuBytes")
        }


def test_meshes_of_another_robot_are_refused_in_words(browser: Browser, own_server: Server, tmp_path: Path) -> None:
    paths = []
    for name, content in GOOD.items():
        paths.append(tmp_path / Path(name).name)
        paths[-1].write_bytes(content)
    with browser.opened(own_server) as opened:
        opened.go("cell")
        opened.page.click("text=Meshes of the arm")
        opened.page.set_input_files(".meshes input[type=file] >> nth=0", [str(path) for path in paths])
        opened.page.wait_for_selector("text=upload the URDF of this arm", timeout=120_000)
        # the browser itself logs every answer that is not 2xx
        opened.complaints[:] = [one for one in opened.complaints if "status of 422" not in one]
