"""Commands about programs: check without a map, and what keeps a user from losing a file."""

import pytest

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0}"
SRC = f"DEF a()\nBAS(#TOOL,0)\n$BASE=$NULLFRAME\nLIN {POSE}\nPTP XHOME\nBAS(#TOOL,9)\nLIN {POSE}\nEND\n"


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "a.src"
    path.write_text(SRC)
    return path


def test_check_lists_every_target(run, program):
    done = run("check", program, "--json")
    assert done.code == 0
    counts = {"correct": 1, "skip": 1, "refuse": 1, "following": 0, "without_tool": 0}
    assert done.json["programs"] == [{"file": str(program), **counts}]
    assert [(t["line"], t["name"], t["verdict"], t["motion"]) for t in done.json["targets"]] == [
        (4, "LIN:4", "correct", "LIN"),
        (5, "XHOME", "skip", "PTP"),
        (7, "LIN:7", "refuse", "LIN"),
    ]
    first, _, last = done.json["targets"]
    assert (first["frame"], first["tool"], first["reason"]) == ("BASE_DATA[0]", "TOOL_DATA[0]", "")
    assert "tool TOOL_DATA[9] is not known" in last["reason"]
    shown = run("check", program).out
    assert "1 to correct, 1 to skip, 1 refused" in shown
    assert "1 × refuse: tool TOOL_DATA[9] is not known; give it in [frames.tools.9]" in shown
    assert f"({program}:7 LIN:7)" in shown


def test_check_takes_frames_from_a_cell_or_the_controller(run, program, tmp_path):
    (tmp_path / "config.dat").write_text("TOOL_DATA[9]={X 1,Y 2,Z 3,A 0,B 0,C 0}\n")
    (tmp_path / "cell.toml").write_text(
        '[robot]\nmodel = "kuka-kr210-r2700-extra"\n[frames.tools.9]\nx_mm = 3\n[frames.bases.2]\n'
    )
    for option in (("--config-dat", tmp_path / "config.dat"), ("--cell", tmp_path / "cell.toml")):
        assert [t["verdict"] for t in run("check", program, *option, "--json").json["targets"]][2] == "correct"
    program.write_text(f"DEF a()\nLIN {POSE}\nEND\n")
    assert "no $TOOL is set" in run("check", program).out
    target = run("check", program, "--tool", "0", "--base", "0", "--json").json["targets"][0]
    assert (target["verdict"], target["frame"]) == ("correct", "BASE_DATA[0]")
    assert "tool 7 is not among those given" in run("check", program, "--tool", "7").failed()


def test_check_says_what_it_cannot_read(run, tmp_path):
    assert "no such file" in run("check", tmp_path / "absent.src").failed()
    assert "no such file" in run("check", tmp_path / "absent.xyz").failed()
    (tmp_path / "a.urp").write_bytes(b"\x1f\x8b")
    assert "is truncated" in run("check", tmp_path / "a.urp").failed()
    (tmp_path / "a.txt").write_text("LIN")
    assert "is not a robot program in a known language" in run("check", tmp_path / "a.txt").failed()
    (tmp_path / "loop.src").symlink_to(tmp_path / "loop.src")
    assert "loop.src" in run("check", tmp_path / "loop.src").failed()


def test_correct_in_place_keeps_the_original(run, cell_files, near_samples):
    path = near_samples[0]
    before = path.read_bytes()
    options = ("--config-dat", path.parents[1] / "config.dat", "--tool", "1", "--base", "0", "--on-guard", "skip")
    done = run("correct", cell_files.map, path, *options, "--in-place", "--json")
    assert done.code == 0, done.err
    assert path.read_bytes() != before
    assert path.with_name("a.src.original").read_bytes() == before
    assert "was corrected already" in run("correct", cell_files.map, path, *options, "--in-place").failed()
    path.write_bytes(before)
    assert "exists already" in run("correct", cell_files.map, path, *options, "--in-place").failed()
    assert path.read_bytes() == before


def test_programs_in_which_nothing_is_corrected_are_not_called_corrected(run, cell_files, near_samples, tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.src").write_text(f"DEF {name}()\nLIN {{X 9999,Y 0,Z 0,A 0,B 0,C 0}}\nEND\n")
    frames = ("--config-dat", near_samples[0].parents[1] / "config.dat", "--tool", "1", "--base", "0")
    options = (*frames, "--on-guard", "skip", "--out", tmp_path / "out")
    shown = run("correct", cell_files.map, tmp_path / "a.src", tmp_path / "b.src", *options).out
    assert "2 programs without a corrected target, 0 refused" in shown
    assert "0 of 2 motion targets corrected" in shown


def test_programs_of_one_name_are_not_written_over_each_other(run, cell_files, near_samples, tmp_path):
    options = ("--config-dat", tmp_path / "config.dat", "--tool", "1", "--base", "0", "--on-guard", "skip")
    refused = run("correct", cell_files.map, *near_samples, *options, "--out", tmp_path / "out")
    assert "would both be written as a.src" in refused.failed()
    assert not (tmp_path / "out").exists()
    assert run("correct", cell_files.map, *near_samples, *options, "--in-place").code == 0


def test_check_goes_on_behind_programs_that_it_cannot_read(run, program, tmp_path):
    (tmp_path / "b.src").write_text("DEF b()\nLIN {X 1.2.3}\nEND\n")
    paths = (tmp_path / "b.src", program, tmp_path / "c.urp")
    done = run("check", *paths)
    assert done.code == 1
    assert "1 to correct, 1 to skip, 1 refused" in done.out
    assert "2 programs cannot be read: " in done.err
    assert "b.src:2: X 1.2.3 is not a number" in done.err
    assert "c.urp: no such file" in done.err
    assert done.err.count("\n") == 1
    listed = run("check", *paths, "--json")
    assert (listed.code, len(listed.json["programs"]), len(listed.json["unreadable"])) == (1, 1, 2)


def test_check_groups_reasons_and_adds_up(run, program, tmp_path):
    other = tmp_path / "b.src"
    other.write_text(f"DEF b()\n$BASE=$NULLFRAME\nBAS(#TOOL,8)\nLIN {POSE}\nLIN {POSE}\nEND\n")
    shown = run("check", program, other).out
    assert "2 × refuse: tool TOOL_DATA[8] is not known" in shown
    assert f"{other}:4 LIN:4, {other}:5 LIN:5)" in shown
    assert f"[frames.tools.8]  # TOOL_DATA[8]: 2 targets in {other.name}\nx_mm = ?" in shown
    assert "2 programs: 1 to correct, 1 to skip, 3 refused" in shown


@pytest.fixture
def approach(tmp_path):
    """A folder of two programs, in one of which a motion follows a corrected point, and another one that is left."""
    folder = tmp_path / "approach"
    folder.mkdir()
    points = f"DECL E6POS XP1={POSE}\nDECL E6POS XP2={POSE[:-1]},E1 5}}\nDECL E6POS XAP\nDECL E6POS XAQ\n"
    near, left = (f"{a}={p}\n{a}.Z={a}.Z+50\nLIN {a}\nLIN {p}\n" for a, p in (("XAP", "XP1"), ("XAQ", "XP2")))
    (folder / "a.dat").write_text(f"DEFDAT A\n{points}ENDDAT\n")
    (folder / "a.src").write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n{near}{left}LIN_REL {{X 1}}\nEND\n")
    (folder / "b.src").write_text(f"DEF b()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {POSE}\nEND\n")
    return folder


def test_check_counts_what_follows_a_corrected_point_apart(run, approach):
    shown = run("check", approach, "--derived").out
    assert f"{approach}: 2 to correct, 1 follows a corrected point, 2 to skip, 1 refused\n" in shown
    assert f"{approach}/a.src: 1 to correct, 1 follows a corrected point, 2 to skip, 1 refused\n" in shown
    assert f"{approach}/b.src: 1 to correct, 0 to skip, 0 refused\n" in shown
    assert "2 programs: 2 to correct, 1 follows a corrected point, 2 to skip, 1 refused" in shown
    assert "gets the correction" not in shown
    assert "derived from XP2 (line 3), which is left out: external axis E1" in shown
    assert "corrected point" not in run("check", approach).out


def test_check_tells_programs_how_many_targets_follow(run, approach):
    done = run("check", approach, "--derived", "--json").json
    (project,) = done["programs"]
    assert project == {"file": str(approach), "correct": 2, "skip": 3, "refuse": 1, "following": 1, "without_tool": 0}
    assert len([one for one in done["targets"] if one["verdict"] == "skip"]) == 3
    assert done["coverage"]["correctable"] == 3


def test_frames_lists_what_is_not_known_first(run, program):
    shown = run("frames", program)
    assert shown.code == 0
    assert shown.out.index("tool 9") < shown.out.index("base 0")
    assert "[frames.tools.9]  # TOOL_DATA[9]: 1 target in" in shown.out
    (found,) = run("frames", program, "--json").json["controllers"]
    assert [(one["kind"], one["key"], one["state"], one["targets"]) for one in found["frames"]] == [
        ("tool", 9, "unknown", 1),
        ("base", 0, "known", 2),
        ("tool", 0, "known", 1),
    ]


def test_keep_going_corrects_the_others_and_names_the_refused(run, cell_files, near_samples, tmp_path):
    options = ("--config-dat", tmp_path / "config.dat", "--tool", "1", "--base", "0", "--out", tmp_path / "out")
    good = near_samples[0]
    bad = tmp_path / "bad.src"
    bad.write_text("DEF bad()\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n")
    broken = tmp_path / "broken.src"
    broken.write_text("DEF broken()\nLIN {X 1.2.3}\nEND\n")
    for others in ((bad,), (broken,)):
        failed = run("correct", cell_files.map, good, *others, *options).failed()
        assert failed.endswith("; --keep-going corrects the other programs\n")
    assert "--keep-going" not in run("correct", cell_files.map, bad, *options).failed()
    assert not (tmp_path / "out").exists()
    done = run("correct", cell_files.map, good, bad, broken, *options, "--keep-going")
    assert done.code == 1
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "a.corrections.csv", "a.corrections.json", "a.src"
    ]  # fmt: skip
    assert "1 program corrected, 2 refused" in done.out
    assert "2 programs are refused: " in done.err
    assert f"{bad}:2: LIN:2" in done.err
    assert f"{broken}:2: X 1.2.3 is not a number" in done.err
    listed = run("correct", cell_files.map, good, bad, *options, "--keep-going", "--dry-run", "--json")
    assert (listed.code, [one["file"] for one in listed.json["refused"]]) == (1, [str(bad)])


def test_programs_of_folders_are_counted_one_by_one(run, tmp_path):
    for name in ("a", "b", "c"):
        folder = tmp_path / name
        folder.mkdir()
        for k in range(2):
            point = "DECL E6POS XP1={X 812.5,Y -40.25,Z 1033.0,A 90.0,B 0.0,C -180.0}"
            (folder / f"{name}{k}.src").write_text(
                f"DEF {name}{k}()\nBAS(#TOOL,0)\n$BASE=$NULLFRAME\nLIN XP1\nLIN {POSE}\nEND\n"
            )
            (folder / f"{name}{k}.dat").write_text(f"DEFDAT {name}{k}\n{point}\nENDDAT\n")
    (tmp_path / "b" / "b0.dat").write_text("DEFDAT b0\nDECL E6POS XP1={X 1.2.3}\nENDDAT\n")
    done = run("check", *(tmp_path / name for name in ("a", "b", "c")))
    assert done.code == 1
    assert done.out.count(".src: 2 to correct, 0 to skip, 0 refused") == 4
    assert "5 programs: 10 to correct, 0 to skip, 0 refused; 1 more cannot be read" in done.out
    assert "b0.dat:2: X 1.2.3 is not a number" in done.err


def test_limits_and_warnings_of_many_programs_are_shown_once(run, cell_files, near_samples, tmp_path):
    options = (
        "--config-dat",
        tmp_path / "config.dat",
        "--tool",
        "1",
        "--base",
        "0",
        "--out",
        tmp_path / "out",
        "--dry-run",
    )
    one, other = near_samples
    other = other.rename(other.with_name("b.src"))
    alone = run("correct", cell_files.map, one, *options).out
    both = run("correct", cell_files.map, one, other, *options).out
    assert alone.count("Limits in force: ") == both.count("Limits in force: ") == 1
    assert "max_bend_mm as in each record (default: " in both
    assert "max_bend_mm 0." in alone
    warnings = [line for line in alone.splitlines() if "check-point" in line]
    assert warnings
    assert [line for line in both.splitlines() if "check-point" in line] == warnings


def test_check_takes_a_folder(run, tmp_path):
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "$config.dat").write_text("TOOL_DATA[9]={X 1,Y 2,Z 3,A 0,B 0,C 0}\n")
    (folder / "a.src").write_text(SRC)
    assert run("check", folder, "--json").json["programs"] == [
        {"file": str(folder), "correct": 2, "skip": 1, "refuse": 0, "following": 0, "without_tool": 0}
    ]
    (tmp_path / "empty").mkdir()
    assert "holds no robot program" in run("check", tmp_path / "empty").failed()


def test_an_interrupt_is_told_and_leaves_nothing(run, program, monkeypatch):
    def interrupted(*_args, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr("truepose.programs.read_programs", interrupted)
    done = run("check", program)
    assert (done.code, done.out) == (130, "")
    assert done.err == "truepose: interrupted; no file was written\n"


@pytest.mark.promise("An interrupt after files were written says which they are")
def test_an_interrupt_after_the_commit_names_what_was_written(run, tmp_path, monkeypatch):
    def interrupted(*_args):
        raise KeyboardInterrupt

    monkeypatch.setattr("truepose.cli.setup.say", interrupted)
    cell = tmp_path / "cell"
    done = run("init", cell, "--robot", "kuka-kr150-2")
    assert done.code == 130
    assert "interrupted; these files were written before and are complete" in done.err
    assert str(cell / "cell.toml") in done.err
    assert (cell / "cell.toml").read_text("utf-8").startswith("#")


@pytest.mark.promise("The last line of correct says how many motion targets are corrected and how many stay nominal.")
def test_correct_ends_with_the_coverage(run, cell_files, near_samples, tmp_path):
    options = ("--config-dat", tmp_path / "config.dat", "--tool", "1", "--base", "0", "--in-place", "--dry-run")
    done = run("correct", cell_files.map, *near_samples, *options)
    assert done.out.strip().splitlines()[-1] == "4 of 4 motion targets corrected, 0 stay nominal"
    json = run("correct", cell_files.map, *near_samples, *options, "--json").json
    assert json["coverage"] == {"corrected": 4, "targets": 4}


@pytest.mark.promise("Nothing is written when a program misses the required share.")
def test_correct_requires_a_share(run, cell_files, tmp_path):
    path = tmp_path / "a.src"
    path.write_text("DEF a()\nPTP {A1 0}\nEND\n")
    out = tmp_path / "out"
    failed = run("correct", cell_files.map, path, "--require", "95%", "--out", out).failed()
    assert "0 of 1 motion targets corrected, 1 stays nominal, but 95 % must be corrected" in failed
    assert not out.exists()
    assert "expected a share" in run("correct", cell_files.map, path, "--require", "many", "--out", out).failed()


def test_watch_corrects_a_folder_once(run, cell_files, near_samples, tmp_path):
    options = ("--config-dat", tmp_path / "config.dat", "--tool", "1", "--base", "0", "--once", "--settle", "0.05")
    done = run("watch", cell_files.map, tmp_path / "one", tmp_path / "out", *options, "--json")
    assert done.code == 0, done.err
    assert [one["coverage"] for one in done.json["programs"]] == [{"corrected": 2, "targets": 2}]
    assert (tmp_path / "out" / "a.corrections.json").is_file()
    same = run("watch", cell_files.map, tmp_path / "one", tmp_path / "out", *options)
    assert (same.code, same.out.strip()) == (
        0, f"Nothing to correct in {tmp_path / 'one'}: 1 programs, none of them new or changed"
    )  # fmt: skip
    (tmp_path / "one" / "b.src").write_text("DEF b()\nLIN {X 1.2.3}\nEND\n")
    again = run("watch", cell_files.map, tmp_path / "one", tmp_path / "out", *options)
    assert again.code == 1
    assert "1 of 2 programs are refused" in again.err
    assert "--json needs --once" in run("watch", cell_files.map, tmp_path, tmp_path / "o", "--json").failed()
