"""Each command as its user runs it."""

import csv
import json
import re
import subprocess
import sys
import warnings

import numpy as np
import openpyxl
import pytest
import typer
from tests.report.test_headline import verified

import truepose as tp
from truepose.cli import app
from truepose.geometry import apply_transform, invert_transform
from truepose.predictors import PREDICTORS
from truepose.predictors.selection.choice import QUICK
from truepose.samples import write_samples


def test_help_lists_the_commands(run):
    done = run("--help")
    assert done.code == 0
    for command in (
        "demo",
        "robots",
        "init",
        "import",
        "similarity",
        "fit",
        "predict",
        "validate",
        "correct",
        "report",
    ):
        assert f" {command} " in done.out


def test_as_a_process():
    """The console script's own code path: exit code and one line on stderr, stdout empty."""
    code = "import sys; sys.argv = ['truepose', 'robots', 'kuka']; from truepose.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (1, "", 1)


def test_no_help_text_loses_a_unit_in_brackets():
    """Rich reads brackets as markup and drops them."""
    commands = typer.main.get_command(app).commands
    texts = [option.help or "" for command in commands.values() for option in command.params]
    assert len(texts) > 100
    assert [text for text in texts if re.search(r"(?<!\\)\[", text)] == []


def test_help_lists_every_predictor_and_quick_candidate(run):
    text = " ".join(run("fit", "--help").out.replace("│", " ").split())
    names, quick = re.search(r"auto, or one of (.*?); with options", text), re.search(r"or quick \((.*?)\)", text)
    assert names[1].split(", ") == list(PREDICTORS)
    assert quick[1].split(", ") == list(QUICK)


def test_help_groups_the_commands_in_the_order_of_work(run):
    panels = re.findall(r"─ (\w+) ─", run("--help").out)
    assert panels == ["Options", "Start", "Measure", "Model", "Correct", "Report", "Browser", "Store"]


def test_help_is_light():
    """What makes a start slow is not imported for it."""
    code = "import sys, truepose.cli; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "scipy", "numba", "sklearn", "matplotlib", "pydantic"} & set(loaded)


def test_version(run):
    assert run("--version").out.startswith("truepose ")
    done = subprocess.run([sys.executable, "-m", "truepose", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == run("--version").out == f"truepose {tp.__version__}\n"


def test_wrong_usage_exits_2(run):
    assert run("fit").code == 2
    assert run("no-such-command").code == 2


def test_robots(run):
    names = run("robots", "--json").json["robots"]
    assert "kuka-kr210-r2700-extra" in names
    shown = run("robots", "kuka-kr210-r2700-extra", "--json").json
    assert shown["joints"][1]["a_mm"] == 350.0
    assert shown["joints"][0]["max_deg"] == pytest.approx(185.0)
    assert "KUKA" in run("robots", "kuka-kr210-r2700-extra").out
    assert "kuka-kr210-r2700-extra" in run("robots", "kuka-kr210").failed()


def test_the_list_of_robots_fits_80_columns_by_maker(run):
    lines = run("robots").out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "KUKA" in lines
    assert any(line.startswith("  kuka-kr150-2 ") for line in lines)
    makers = [line for line in lines[:-1] if not line.startswith(" ")]
    assert makers == sorted(makers, key=str.lower)
    assert len(set(makers)) == len(makers)


@pytest.mark.parametrize("suffix", [".toml", ".csv"])
def test_a_robot_of_ones_own_from_file_to_cell(run, tmp_path, monkeypatch, suffix):
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "arms" / f"my{suffix}"
    own.parent.mkdir()
    table = "# convention = mdh\nalpha_deg,a_mm,d_mm,offset_deg\n0,0,400,0\n-90,25,0,0\n"
    own.write_text(run("robots", "--template").out if suffix == ".toml" else table, "utf-8")
    assert run("init", "lab/cell", "--robot", f"arms/my{suffix}").code == 0
    assert f'model = "../../arms/my{suffix}"' in (tmp_path / "lab" / "cell" / "cell.toml").read_text("utf-8")
    monkeypatch.chdir(tmp_path / "arms")
    robot = tp.load_cell("../lab/cell/cell.toml").load_robot()
    assert robot.name == ("my-arm" if suffix == ".toml" else "my")
    (tmp_path / "copy.toml").write_text(run("robots", f"my{suffix}", "--toml").out, "utf-8")
    q = np.full((1, robot.dof), 0.3)
    np.testing.assert_allclose(tp.load_robot(tmp_path / "copy.toml").forward(q), robot.forward(q), atol=1e-9)
    assert run("robots", f"my{suffix}", "--json").json["name"] == robot.name


def test_init_writes_a_cell_that_loads(run, tmp_path):
    done = run("init", tmp_path / "new", "--robot", "abb-irb120", "--json")
    assert done.code == 0
    from truepose.cell import load_cell

    assert load_cell(done.json["cell"]).load_robot().name == "abb-irb120"
    assert "exists already" in run("init", tmp_path / "new", "--robot", "abb-irb120").failed()
    assert "did you mean" in run("init", tmp_path / "other", "--robot", "abb-irb12").failed()
    assert not (tmp_path / "other").exists()


def test_fit_and_validate(run, cell_files):
    done = run("validate", cell_files.map, cell_files.test, "--json").json
    assert done["before"].keys() == {"n", "mean_mm", "rms_mm", "std_mm", "p95_mm", "max_mm"}
    assert done["before"]["n"] == 40
    assert done["reduction_mean_percent"] > 70
    assert done["after"]["mean_mm"] > 0.8 * cell_files.virtual.noise_floor  # nothing beats the noise
    assert done["seen"] == 0
    assert run("validate", cell_files.map, cell_files.samples, "--json").json["seen"] == 80
    assert "too favourable" in run("validate", cell_files.map, cell_files.samples).out


@pytest.mark.exhaustive
def test_fit_auto_ranks_the_candidates(run, cell_files, tmp_path):
    few = (
        "--candidates",
        "registration,idw,ordinary-kriging",
        "--workers",
        "1",
        "--out",
        tmp_path / "m.truepose",
    )
    shown = run("fit", cell_files.cell, cell_files.samples, "--splits", "points", *few).out
    assert "Cross-validation of the candidates over points" in shown
    assert "Mean error of samples outside both the fit and the choice: 0.0" in shown
    done = run("fit", cell_files.cell, cell_files.samples, *few, "--force", "--json").json
    assert done["ranking"][0]["splits"].keys() == {"points", "blocks"}
    means = [row["mean_mm"] for row in done["ranking"][1:]]
    assert means == sorted(means)
    assert done["expected"]["mean_mm"] < 1.2 * done["ranking"][0]["mean_mm"]
    assert done["predictor"] == done["ranking"][0]["predictor"]
    assert done["ranking"][-1]["predictor"] == "registration"
    assert done["leave_one_out"]["mean_mm"] < 0.5 * done["registered"]["mean_mm"]


@pytest.mark.exhaustive
def test_fit_is_reproducible_to_the_byte(run, cell_files, tmp_path):
    again = tmp_path / "again.truepose"
    run("fit", cell_files.cell, cell_files.samples, "--predictor", "ordinary-kriging", "--out", again)
    assert again.read_bytes() == cell_files.map.read_bytes()


def test_predict_where_the_tracker_sees_it(run, cell_files, tmp_path):
    out = tmp_path / "predicted.csv"
    assert run("predict", cell_files.map, cell_files.test, "--out", out, "--json").json["n"] == 40
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert {"q1_deg", "x_pred_mm", "y_pred_mm", "z_pred_mm", "std_mm"} <= rows[0].keys()
    predicted = np.array([[float(row[f"{axis}_pred_mm"]) for axis in "xyz"] for row in rows])
    virtual = cell_files.virtual
    q = np.deg2rad([[float(row[f"q{i}_deg"]) for i in range(1, 7)] for row in rows])
    truth = apply_transform(invert_transform(virtual.truth.tf_base_tracker), virtual.true_position(q))
    assert np.linalg.norm(predicted - truth, axis=1).mean() < 0.1
    assert all(0 < float(row["std_mm"]) < 0.5 for row in rows)


def test_warnings_are_one_line(run, monkeypatch):
    monkeypatch.setattr("truepose.cli.app", lambda: warnings.warn("few digits\nleft", stacklevel=1))
    assert run().err == "truepose: warning: few digits left\n"


@pytest.mark.exhaustive
def test_similarity(run, cell_files, tmp_path):
    plot = tmp_path / "similarity.svg"
    done = run("similarity", cell_files.cell, cell_files.samples, "--plot", plot, "--json").json
    cartesian, joint = done["variograms"]
    assert cartesian["lag_unit"] == "mm"
    assert joint["lag_unit"] == "rad"
    assert cartesian["verdict"].startswith("Yes")
    assert np.shape(cartesian["semivariance_mm2"]) == (15, 3)
    assert plot.read_text().lstrip().startswith("<?xml")
    assert 0 < cartesian["kinematics"]["explains"] < 1
    assert set(cartesian["directions"]) == set(cartesian["practical_ranges"]) == set("xyz")
    assert set(joint["practical_ranges"]) == {f"q{k}" for k in range(1, 7)}
    shown = " ".join(run("similarity", cell_files.cell, cell_files.samples).out.split())
    for words in (
        "Yes, near points",
        "The standard deviation of one component",
        "Does it depend on the direction?",
        "kinematic",
    ):
        assert words in shown
    nothing = tmp_path / "no.toml", tmp_path / "no.csv"  # the ending is looked at before they are
    assert "use .svg, .png or .pdf" in run("similarity", *nothing, "--plot", "a.xyz").failed()


@pytest.mark.exhaustive
def test_similarity_with_choices_of_ones_own(run, cell_files):
    only = ("similarity", cell_files.cell, cell_files.samples, "--space", "cartesian", "--json")
    chosen = ("--bins", "0,100,200,400,800", "--estimator", "cressie", "--direction", "1,1,0", "--tolerance", "45")
    [part] = run(*only, *chosen, "--nugget", "0.01", "--range", "150").json["variograms"]
    assert len(part["lag"]) == 4
    assert (part["model"]["nugget_mm2"], part["model"]["range"], part["model"]["by_hand"]) == (0.01, 150, True)
    assert part["model"]["fitted"]["range"] != 150
    assert "Set by hand; the fitted values were" in part["findings"]["Which curve fits?"]
    [held] = run(*only, "--nugget", "0.01", "--hold", "--weights", "pairs/h2").json["variograms"]
    assert (held["model"]["nugget_mm2"], held["model"]["by_hand"]) == (0.01, False)
    whole = run(*only, "--equal-counts", "--bins", "5", "--max-lag", "500").json["variograms"][0]
    assert np.ptp(whole["pairs"]) <= 0.05 * np.max(whole["pairs"])
    assert np.sum(part["pairs"]) < np.sum(whole["pairs"])
    for wrong, message in (
        (("--bins", "1"), "--bins: expected a whole number of at least 2"),
        (("--direction", "up"), "--direction: 'up' is not a number; write numbers"),
        (("--space", "tool"), "expected a space of these samples (cartesian, joint) or both, got 'tool'"),
        (("--space", "both", "--nugget", "1"), "apply to one space only; choose it with space"),
        (("--hold",), "--hold has no effect without --nugget, --sill or --range"),
        (("--weights", "n"), "weights is 'n'; expected one of cressie, pairs, pairs/h2, equal"),
    ):
        assert message in run("similarity", cell_files.cell, cell_files.samples, *wrong).failed()


@pytest.mark.exhaustive
def test_joint_wise_similarity(run, cell_files, tmp_path):
    """The virtual cell's joints have errors of their own, of some tenths of a milliradian."""
    plot = tmp_path / "joints.png"
    command = ("similarity", cell_files.cell, cell_files.samples, "--joint-wise", "--plot", plot)
    joints = run(*command, "--json").json["joints"]
    assert {one["joint"] for one in joints} <= set(range(1, 7))
    for one in joints:
        assert 0 < one["std_mrad"] < 3
        assert 0 < one["reach_deg"] <= 180
        assert one["semivariance_mrad2"][0] == one["found_mrad2"][0] == 0
        assert one["semivariance_mrad2"][-1] <= one["std_mrad"] ** 2 * (1 + 1e-9)
    assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("decision", "code"), [("fail", 1), ("not assessed", 0), ("pass", 0)])
def test_a_report_tells_its_decision_and_exits_with_1_on_fail(run, cell_files, tmp_path, decision, code):
    path = tmp_path / "verification.json"
    path.write_text(json.dumps(verified(decision).to_dict()))
    command = ("report", cell_files.map, "--verification", path, "--force", "--out", tmp_path / "report.html")
    done = run(*command, "--json")
    assert (done.code, done.json["decision"], done.json["tolerances_mm"]) == (code, decision, [0.2])
    done = run(*command)
    assert (done.code, f"{decision.upper()}: the worst of" in done.out) == (code, True)


@pytest.mark.exhaustive
def test_report_is_one_page_that_asks_for_nothing(run, cell_files, tmp_path):
    out = tmp_path / "report.html"
    assert run("report", cell_files.map, "--test", cell_files.test, "--out", out).code == 0
    page = out.read_text()
    assert page.count("<svg") >= 5
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    assert "<script" not in page
    assert "held-out poses" in page
    assert run("report", cell_files.map, "--out", out, "--force").code == 0
    assert "leave-one-out" in out.read_text()


@pytest.fixture
def plan_and_readings(cell_files, tmp_path):
    virtual = cell_files.virtual
    measured = virtual.measure(virtual.design(30, seed=5))
    plan, readings = tmp_path / "plan.csv", tmp_path / "readings.txt"
    write_samples(plan, measured)
    lines = [f"{i}, {x:.4f}, {y:.4f}, {z:.4f}" for i, (x, y, z) in enumerate(measured.p_meas, 1)]
    readings.write_text("\n".join(lines) + "\n")
    return plan, readings, lines


def test_import_of_workbooks(run, cell_files, plan_and_readings, tmp_path):
    plan, _, lines = plan_and_readings
    book = openpyxl.Workbook()
    book.create_sheet("Points").append(["Point", "X [mm]", "Y [mm]", "Z [mm]"])
    for line in lines:
        name, *p = line.split(", ")
        book["Points"].append([name, *map(float, p)])
    book.save(tmp_path / "readings.xlsx")
    out, csv_out = tmp_path / "samples.xlsx", tmp_path / "samples.csv"
    readings = f"{tmp_path / 'readings.xlsx'}#Points"
    for path in (out, csv_out):
        run("import", cell_files.cell, readings, "--plan", plan, "--out", path, "--json")
    np.testing.assert_allclose(tp.read_samples(out).p_meas, tp.read_samples(csv_out).p_meas)
    refused = run("import", cell_files.cell, readings, "--plan", plan, "--out", tmp_path / "readings.xlsx", "--force")
    assert "is an input, and inputs are never overwritten" in refused.failed()


def test_import(run, cell_files, plan_and_readings, tmp_path):
    plan, readings, lines = plan_and_readings
    out = tmp_path / "samples.csv"
    done = run("import", cell_files.cell, readings, "--plan", plan, "--out", out, "--json").json
    assert done["n"] == 30
    assert done["outliers"] == []
    assert 0.1 < done["registration"]["mean_mm"] < 1.5
    assert len(out.read_text().splitlines()) == 31
    lines[7] = "8, " + ", ".join(f"{float(v) + 30.0:.4f}" for v in lines[7].split(",")[1:])
    readings.write_text("\n".join(lines))
    done = run("import", cell_files.cell, readings, "--plan", plan, "--out", out, "--force", "--json").json
    assert [outlier["row"] for outlier in done["outliers"]] == [7]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda rows: rows[:-3], "27 readings for 30 points"),
        (
            lambda rows: [*rows[:3], rows[9], *rows[4:9], rows[3], *rows[10:]],
            r"lines 5, 11 of .*plan\.csv are swapped \(read in lines",
        ),
        (
            lambda rows: [
                ",".join([r.split(",")[0], *(f"{float(v) / 1000:.7f}" for v in r.split(",")[1:])]) for r in rows
            ],
            "metres",
        ),
        (lambda rows: [*rows[:4], "5, nan, 1.0, 2.0", *rows[5:]], r"line 6 of .*plan\.csv"),
        (lambda rows: [*rows[:4], "5, 0.0, 0.0, 0.0", *rows[5:]], r"line 6 of .*plan\.csv"),
        (lambda rows: ["what is this", *rows], "line|layout"),
    ],
    ids=["missing", "swapped", "metres", "nan", "all-zero", "layout"],
)
def test_import_of_bad_readings(run, cell_files, plan_and_readings, tmp_path, damage, message):
    plan, readings, lines = plan_and_readings
    readings.write_text("\n".join(damage(lines)) + "\n")
    out = tmp_path / "samples.csv"
    assert re.search(message, run("import", cell_files.cell, readings, "--plan", plan, "--out", out).failed())
    assert not out.exists()


def test_damaged_map(run, cell_files, tmp_path):
    damaged = tmp_path / "m.truepose"
    damaged.write_bytes(cell_files.map.read_bytes()[:-500])
    assert "truncated" in run("validate", damaged, cell_files.test).failed()
    assert "no such file" in run("validate", tmp_path / "none.truepose", cell_files.test).failed()
    assert "not a map file" in run("validate", cell_files.cell, cell_files.test).failed()


def test_unwritable_output(run, cell_files, tmp_path):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "m.truepose"
    assert "cannot be written" in run("fit", cell_files.cell, cell_files.samples, "--out", out).failed()
    # before anything is read or fitted
    assert "cannot be written" in run("fit", tmp_path / "no.toml", tmp_path / "no.csv", "--out", out).failed()


def test_unknown_predictor(run, cell_files, tmp_path):
    message = run("fit", cell_files.cell, cell_files.samples, "--predictor", "ordinary-krigging").failed()
    assert "did you mean 'ordinary-kriging'" in message


def test_too_few_samples(run, cell_files, tmp_path):
    few = tmp_path / "few.csv"
    few.write_text("\n".join(cell_files.samples.read_text().splitlines()[:3]))
    assert "too few" in run("fit", cell_files.cell, few, "--out", tmp_path / "m").failed()


def test_fitted_tool_at_one_orientation_is_told(run, cell_files, tmp_path):
    cell = tmp_path / "cell.toml"
    cell.write_text(cell_files.cell.read_text().replace("[tool]\n", '[tool]\nfit = "position"\n'))
    message = run("fit", cell, cell_files.samples, "--out", tmp_path / "m").failed()
    assert "tool" in message
    assert not (tmp_path / "m").exists()


def test_degrees_for_radians_in_python(cell_files):
    import truepose as tp

    with pytest.raises(tp.TrueposeError, match="degrees"):
        tp.load_map(cell_files.map).predict_measured(np.array([[0.0, -75.0, 95.0, 0.0, -20.0, 0.0]]))


def test_titles_of_tables_are_whole_in_a_narrow_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from truepose.cli.output import say, table

    monkeypatch.setenv("COLUMNS", "40")
    title = "after registration, and predicted without the sample itself (n = 80)"
    say(table(title, ["", "before [mm]"], [["mean", 0.5]]))
    assert title in capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("head", ["Achse1", "A1 [°]", "q1_deg"])
def test_predict_takes_poses_as_a_plan_has_them(run, cell_files, tmp_path, head):
    poses = tmp_path / "poses.csv"
    names = ["Point", *(head.replace("1", str(k)) for k in range(1, 7))]
    poses.write_text(";".join(names) + "\nP1;0,5;-75;95;1;50;2\nP2;-3;-70;92;1;50;2\n")
    done = run("predict", cell_files.map, poses, "--out", tmp_path / "out.csv")
    assert done.code == 0, done.err
    rows = list(csv.DictReader((tmp_path / "out.csv").open(encoding="utf-8"), delimiter=";"))
    assert [row["Point"] for row in rows] == ["P1", "P2"]
    assert all(float(row["std_mm"]) > 0 for row in rows)
