"""What forms write: motion groups of the cell, masks of samples, the options of a plan."""

from __future__ import annotations

import csv
import tomllib
from typing import Any

from tests.browser.opening import Browser, Server


def choose(control: Any, start: str) -> None:
    """Choose the option whose text starts so."""
    control.locator("option").filter(has_text=start).first.wait_for(state="attached")
    texts = control.locator("option").all_inner_texts()
    control.select_option(index=next(k for k, text in enumerate(texts) if text.startswith(start)))


def test_motion_groups_are_fields_of_the_cell(browser: Browser, own_server: Server) -> None:
    file = own_server.workspace / "virtual-cell" / "cell.toml"
    with browser.opened(own_server) as app:
        app.go("cell")
        page = app.page
        page.get_by_role("heading", name="Motion groups (FANUC)").click()
        page.get_by_label("Group of this robot").fill("1")
        page.get_by_label("Independent groups").fill("1 2")
        page.get_by_label("Independent groups").press("Tab")
        page.get_by_text("group 1 is this robot").first.wait_for()
        page.get_by_label("Independent groups").fill("2, 3")
        page.get_by_label("Independent groups").press("Tab")
        page.get_by_text("group 1 is this robot").first.wait_for(state="detached")
        with page.expect_response(lambda answer: answer.request.method == "PUT") as saved:
            page.get_by_role("button", name="Save", exact=True).click()
        assert saved.value.ok
    assert tomllib.loads(file.read_text("utf-8"))["frames"]["groups"]["independent"] == [2, 3]


def test_samples_are_left_out_and_count_again_by_keys(browser: Browser, own_server: Server) -> None:
    cell = own_server.workspace / "virtual-cell"
    before = (cell / "fit_samples.csv").read_bytes()
    with browser.opened(own_server) as app:
        app.go("measure/samples")
        page = app.page
        choose(page.get_by_role("combobox", name="Samples"), "fit_samples")
        grid = page.get_by_role("grid", name="Samples")
        grid.get_by_text("P1", exact=True).wait_for()
        grid.focus()
        for key in ("ArrowDown", "ArrowDown", "m"):
            page.keyboard.press(key)
        page.get_by_label("Reason").fill("beam was cut")
        page.keyboard.press("Enter")
        page.get_by_text("1 left out").wait_for()
        page.get_by_role("button", name="Undo").click()
        page.get_by_text("1 left out").wait_for(state="detached")
        grid.focus()
        page.keyboard.press("m")
        page.get_by_label("Reason").fill("vibration")
        page.keyboard.press("Enter")
        assert page.get_by_text("truepose mask fit_samples.csv --out samples/fit_samples.csv").count()
        page.get_by_role("button", name="Write the new table").click()
        page.get_by_text("samples are in samples/fit_samples.csv").wait_for(timeout=120_000)
    with (cell / "samples" / "fit_samples.csv").open(encoding="utf-8") as file:
        masked = [row["masked"] for row in csv.DictReader(file)]
    assert [(k, reason) for k, reason in enumerate(masked) if reason] == [(1, "vibration")]
    assert (cell / "fit_samples.csv").read_bytes() == before


def test_a_plan_states_what_was_measured_and_what_to_choose_from(browser: Browser, own_server: Server) -> None:
    with browser.opened(own_server) as app:
        app.go("measure/plans")
        page = app.page
        page.get_by_label("After an earlier series").select_option("map.truepose")
        choose(page.get_by_label("Candidates"), "held_out_plan")
        command = "--after=map.truepose --candidates=held_out_plan.csv --out plans/posterior-60"
        assert page.get_by_text(command).count()


def test_a_change_does_not_send_the_measurement_file_again(browser: Browser, own_server: Server) -> None:
    readings = own_server.workspace / "virtual-cell" / "held_out_readings.txt"
    asked: list[Any] = []
    with browser.opened(own_server) as app:
        page = app.page
        page.on("requestfinished", lambda one: "preview=true" in one.url and asked.append(one))
        app.go("measure/import")
        page.locator("input[type=file]:not([webkitdirectory])").first.set_input_files(str(readings))
        choose(page.get_by_role("combobox", name="Plan", exact=True), "held_out_plan")
        page.get_by_role("grid", name="Errors after registration").wait_for()
        with page.expect_request_finished(lambda one: "preview=true" in one.url):
            page.get_by_label("accept another order").check()
        kept = asked[0].response().json()["stored"]
        later = [one.post_data or "" for one in asked[1:]]
    assert later
    assert all(kept in body and "filename=" not in body for body in later)
