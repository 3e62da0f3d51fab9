"""The day of the people who use it, click by click: from a new cell to a signed report."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

from tests.browser.opening import Browser, Server, give

from truepose.error_map import load_map
from truepose.samples import read_poses, read_samples
from truepose.simulation import VirtualCell
from truepose.trackers import write_readings


def test_a_metrologist_makes_a_cell_plans_imports_and_fits(
    browser: Browser, own_server: Server, virtual_cell: Path, tmp_path: Path
) -> None:
    with browser.opened(own_server) as app:
        page = app.page
        page.get_by_role("button", name="New cell").click()
        page.get_by_label("Name", exact=True).fill("Drilling <b>")
        robot = page.get_by_role("combobox", name="Robot")
        robot.click()
        robot.press_sequentially("R2700 extra")
        page.get_by_role("option", name="KR 210 R2700 extra").click()
        page.get_by_role("button", name="Create the cell").click()
        chosen = "document.querySelector('header select').selectedOptions[0].text"
        page.wait_for_function(f"() => {chosen}.includes('Drilling')")
        folder = own_server.workspace / "Drilling _b_"
        assert (folder / "cell.toml").is_file()

        page.get_by_role("tab", name="Text").click()
        page.get_by_label("Text", exact=True).fill((virtual_cell / "cell.toml").read_text("utf-8"))
        page.get_by_role("button", name="Save").click()
        page.get_by_text("The cell file is saved.").wait_for()
        assert (folder / "cell.toml").read_text("utf-8") == (virtual_cell / "cell.toml").read_text("utf-8")

        app.go("measure")
        page.get_by_label("Poses", exact=True).first.fill("30")
        page.get_by_role("button", name="Choose poses").click()
        page.get_by_role("link", name="Download plan.csv").wait_for()
        (plan,) = folder.glob("plans/**/plan.csv")
        poses = read_poses(plan)
        assert len(poses) == 30
        readings = tmp_path / "tracker.txt"
        measured = VirtualCell("paper", seed=0).measure(poses.q)
        write_readings(readings, replace(measured, name=poses.name), "spatial-analyzer")

        app.go("measure/import")
        give(app, "Drop the measurement file of the tracker here", readings)
        page.get_by_text("30 readings, 30 points of the plan, 30 samples").wait_for()
        page.get_by_role("button", name="Import", exact=True).click()
        page.get_by_text("30 samples are in").wait_for()
        (samples,) = folder.glob("samples/*.csv")
        assert len(read_samples(samples)) == 30

        app.go("map")
        page.get_by_role("button", name="Fit a map").click()
        page.get_by_label("Predictor").select_option("ordinary-kriging")
        page.get_by_role("button", name="Fit", exact=True).click()
        page.get_by_text("The map is fitted.").wait_for()
        page.get_by_role("tab", name="Variogram").wait_for()
        (made,) = folder.glob("maps/*.truepose")
        assert load_map(made).predictor_name == "ordinary-kriging"


def test_an_integrator_corrects_verifies_and_writes_the_report(
    browser: Browser, own_server: Server, virtual_cell: Path
) -> None:
    folder = own_server.workspace / "virtual-cell"
    with browser.opened(own_server) as app:
        page = app.page
        app.go("programs")
        program = [virtual_cell / "program" / name for name in ("panel.src", "panel.dat", "$config.dat")]
        give(app, "Drop programs", *program)
        page.get_by_role("button", name="Correct", exact=True).click()
        page.get_by_text("23 of 24 targets corrected").wait_for()
        page.get_by_role("tab", name="Difference").click()
        with page.expect_download() as download:
            page.get_by_role("link", name="Download the corrected files").click()
        with zipfile.ZipFile(download.value.path()) as files:
            (name,) = (name for name in files.namelist() if name.endswith("panel.dat"))
            assert files.read(name) == (virtual_cell / "corrected" / "panel.dat").read_bytes()

        app.go("verify")
        give(app, "Drop the readings of the corrected program", virtual_cell / "panel_corrected_readings.txt")
        page.get_by_role("button", name="Verify", exact=True).click()
        page.get_by_role("heading", name="pass panel").wait_for()
        page.get_by_text("24 pass, 0 undecided, 0 fail").wait_for()
        assert page.get_by_role("grid", name="Measured targets").get_attribute("aria-rowcount") == "25"
        (verified,) = folder.glob("verifications/*.json")
        command = page.locator("main code", has_text="truepose verify").inner_text()
        assert f"--out verifications/{verified.name}" in command

        page.get_by_role("spinbutton", name="Tolerance").or_(page.get_by_label("Tolerance [mm]")).first.fill("0.001")
        give(app, "Drop the readings of the corrected program", virtual_cell / "panel_corrected_readings.txt")
        page.get_by_role("button", name="Verify", exact=True).click()
        page.get_by_role("heading", name="fail panel").wait_for()

        app.go("report")
        page.get_by_label("Language", exact=True).last.select_option("de")
        page.get_by_role("checkbox", name="corrected/panel.corrections.json").wait_for()
        page.get_by_role("button", name="Write the report").click()
        page.frame_locator("iframe").get_by_role("heading", name="Positioniergenauigkeit").first.wait_for()
        with page.expect_download() as download:
            page.get_by_role("link", name="Download").click()
        assert Path(download.value.path()).read_bytes() == next(folder.glob("reports/*-de-*.html")).read_bytes()

        app.go("history")
        page.get_by_label("Show", exact=True).select_option("jobs")
        table = page.get_by_role("grid", name="Jobs and files")
        jobs = int(table.get_attribute("aria-rowcount") or 0)
        table.get_by_role("row").nth(1).click()
        page.get_by_role("button", name="Run again").click()
        counted = "document.querySelector('[role=grid]').getAttribute('aria-rowcount')"
        page.wait_for_function(f"() => {counted} === '{jobs + 1}'")
        with page.expect_download() as download:
            page.get_by_role("link", name="Export as CSV").click()
        assert "truepose report" in Path(download.value.path()).read_text("utf-8")
