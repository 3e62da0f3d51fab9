"""Maps that are not shown to be better than none, limits that a bad campaign cannot raise, and orientations."""

import json
import zipfile
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import truepose as tp
from truepose._io import archive
from truepose.cli import app
from truepose.compensation import BELOW
from truepose.error_map.worth import FEW, LeftOut, Worth, worth
from truepose.errors import RefusedError
from truepose.geometry import make_transform
from truepose.predictors.folds import split_samples
from truepose.samples import write_samples


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=100)


def fitted(virtual, n, seed=1, predictor="ordinary-kriging"):
    return tp.fit_cell(virtual.cell, virtual.measure(virtual.design(n, seed=seed), seed=seed), predictor)


@pytest.fixture(scope="module")
def good(virtual) -> tp.ErrorMap:
    return fitted(virtual, 60)


@pytest.fixture(scope="module")
def weak(virtual) -> tp.ErrorMap:
    return fitted(virtual, 6)


@pytest.fixture(scope="module")
def targets(virtual):
    p = np.asarray(virtual.preset.centre_mm) + np.random.default_rng(0).uniform(-200, 200, size=(20, 3))
    return make_transform(tp.euler("kuka", virtual.preset.abc_deg), p)


@pytest.mark.promise("A map that is not better than registration alone, beyond its interval, is refused.")
def test_maps_of_few_samples_are_refused(virtual, targets, record_property):
    cases = [(kind, seed) for kind in ("paper", "hard") for seed in range(4)]
    for kind, seed in cases:
        error_map = fitted(tp.VirtualCell(kind, seed=100 + seed), 6, seed)
        assert error_map.worth.weak
        with pytest.raises(RefusedError, match=r"better than none.*; measure more samples.*--accept-weak-map"):
            error_map.correct(targets)
    record_property("cases", len(cases))


def test_a_weak_map_can_be_accepted(weak, good, targets):
    accepted = weak.correct(targets, accept_weak_map=True, on_guard="skip")
    assert len(accepted.verdict) == len(targets)
    np.testing.assert_array_equal(
        good.correct(targets).p_command, good.correct(targets, accept_weak_map=True).p_command
    )


def test_good_maps_are_not_weak(good):
    worth = good.worth
    assert not worth.weak
    assert worth.left_mm < 0.3 * worth.nothing_mm <= 0.3 * worth.registration_mm
    assert worth.gain_over_nothing[0] < worth.nothing_mm - worth.left_mm < worth.gain_over_nothing[1]
    assert "weak" not in repr(good)
    assert "better than none: it leaves" in worth.words


def along_x(lengths):
    return np.outer(lengths, [1.0, 0.0, 0.0])


@pytest.mark.parametrize(("n", "again"), [(40, True), (41, False)])
def test_a_map_of_40_samples_is_fitted_again_without_each_block(virtual, n, again):
    """With its own hyperparameters, which the block took part in, few samples look better than they are."""
    found = fitted(virtual, n)
    blocks = split_samples(["blocks"], {"cartesian": found.p_cmd}, folds=5)["blocks"]
    kept = np.linalg.norm(found.predictor.leave_blocks_out(blocks).residual, axis=1).mean()
    assert (found.worth.left_mm == pytest.approx(kept, rel=1e-9)) == (not again)


def test_the_intervals_are_those_of_student():
    """Gains of 1 to 10 mm: mean 5.5, S = √(55/6), t(9; 0.975) = 2.262157; over registration alone half of that."""
    rng = np.random.default_rng(0)
    gain = np.arange(1.0, 11.0)
    found = worth(
        rng.uniform(size=(10, 3)), along_x(gain + 1), lambda _: LeftOut(along_x([1.0] * 10), along_x(1 + gain / 2))
    )
    half = 2.262157163 * np.sqrt(55.0 / 6.0 / 10.0)
    assert found.gain_over_nothing == pytest.approx((5.5 - half, 5.5 + half), rel=1e-8)
    assert found.gain_over_registration == pytest.approx((2.75 - half / 2, 2.75 + half / 2), rel=1e-8)
    assert (found.n, found.nothing_mm, found.left_mm, found.registration_mm) == (10, 6.5, 1.0, 3.75)
    assert not found.weak


@pytest.mark.parametrize(("over_nothing", "over_registration"), [(1.01, 1.01), (0.99, 1.01), (1.01, 0.99)])
def test_a_map_is_weak_unless_both_intervals_are_above_zero(over_nothing, over_registration):
    """The mean gain is 1 % above or below half of its interval."""
    spread = np.arange(10.0) - 4.5
    half = 2.262157163 * spread.std(ddof=1) / np.sqrt(10)
    left, p = np.full(10, 20.0), np.random.default_rng(0).uniform(size=(10, 3))
    lengths = [left + spread + share * half for share in (over_nothing, over_registration)]
    found = worth(p, along_x(lengths[0]), lambda _: LeftOut(along_x(left), along_x(lengths[1])))
    assert found.weak == (min(over_nothing, over_registration) < 1.0)
    assert ("not better than none beyond its interval" in found.words) == found.weak
    assert found.brief.startswith(
        "weak map, not shown to be better" if found.weak else "better than none: 20.000 mm left"
    )
    assert Worth.from_dict(found.to_dict()) == found
    assert found.to_dict()["weak"] == found.weak


@pytest.mark.parametrize("n", [4, 5])
def test_four_samples_are_too_few_for_a_comparison(n):
    p = np.random.default_rng(0).uniform(size=(n, 3))
    found = worth(p, along_x(np.arange(n) + 9.0), lambda _: LeftOut(along_x(np.zeros(n)), along_x([9.0] * n)))
    assert found.weak == (n < 5)
    assert ("4 samples are too few" in found.note) == (n < 5)


def test_a_block_that_cannot_be_left_out_leaves_a_weak_map():
    def without(_):
        raise RefusedError("no")

    found = worth(np.random.default_rng(0).uniform(size=(9, 3)), along_x(np.ones(9)), without)
    assert found.weak
    assert found.note == "without a block of samples it cannot be fitted (no)"
    assert found.words == f"nothing shows that the map is better than none: {found.note}"
    assert found.brief == f"weak map: {found.note}"


@pytest.mark.promise("Registration alone, or nothing but noise, never makes a map that is used unasked.")
def test_noise_and_registration_alone_are_weak(virtual, record_property):
    ideal = tp.VirtualCell("ideal", seed=3)
    samples = ideal.measure(ideal.design(60))
    maps = [fitted(virtual, 60, predictor="registration")]
    maps += [tp.fit_cell(ideal.cell, samples, name) for name in ("ordinary-kriging", "idw", "kinematic-kriging")]
    assert [one.worth.weak for one in maps] == [True] * 4
    assert "weak" in repr(maps[0])
    record_property("cases", len(maps))


def test_the_mark_is_kept_in_the_file_and_found_for_files_without(weak, targets, tmp_path):
    path, old = tmp_path / "m.truepose", tmp_path / "old.truepose"
    weak.save(path)
    again = tp.load_map(path)
    assert again.known_worth == weak.worth
    assert again.hash == weak.hash
    content, arrays = archive.unpack(path.read_bytes(), path)
    assert content.pop("worth")["weak"] is True
    old.write_bytes(archive.pack(content, arrays))
    earlier = tp.load_map(old)
    assert earlier.known_worth is None
    with pytest.raises(RefusedError, match="better than none"):
        earlier.correct(targets)
    assert zipfile.is_zipfile(path)


def test_new_samples_may_make_a_weak_map_a_good_one(virtual, weak):
    more = tp.update_map(weak, virtual.measure(virtual.design(60, seed=5), seed=5))
    assert more.known_worth is None
    assert not more.worth.weak


@pytest.mark.exhaustive
@pytest.mark.promise("`fit`, `validate` and `correct` say that a map is weak; `--accept-weak-map` overrides.")
def test_the_commands_say_it(virtual, targets, tmp_path):
    cell, table, path, program = (tmp_path / name for name in ("cell.toml", "s.csv", "m.truepose", "a.src"))
    cell.write_text(virtual.cell.to_toml())
    write_samples(table, virtual.measure(virtual.design(6, seed=1), seed=1))
    run = CliRunner()
    done = run.invoke(app, ["fit", str(cell), str(table), "--predictor", "ordinary-kriging", "--out", str(path)])
    assert "Weak map: Nothing shows that the map is better than none" in " ".join(done.output.split()), done.output
    told = run.invoke(app, ["validate", str(path), str(table), "--json"])
    assert json.loads(told.output)["worth"]["weak"] is True
    assert "Weak map" in run.invoke(app, ["validate", str(path), str(table)]).output
    lines = [
        "LIN {" + ",".join(f"{k} {v:.3f}" for k, v in zip("XYZABC", [*p[:3, 3], *abc], strict=True)) + "}"
        for p, abc in zip(targets, np.tile(virtual.preset.abc_deg, (20, 1)), strict=True)
    ]
    x, _, z = virtual.tf_flange_tool[:3, 3]
    frames = f"$BASE=$NULLFRAME\n$TOOL={{X {x},Y 0,Z {z},A 0,B 0,C 0}}\n"
    program.write_text("DEF a()\n" + frames + "\n".join(lines) + "\nEND\n")
    arguments = ["correct", str(path), str(program), "--on-guard", "skip", "--out", str(tmp_path / "out")]
    refused = run.invoke(app, arguments)
    assert refused.exit_code != 0
    assert isinstance(refused.exception, RefusedError)
    accepted = run.invoke(app, [*arguments, "--accept-weak-map"])
    assert accepted.exit_code == 0, accepted.output
    assert "a weak map was accepted" in " ".join(accepted.output.split())
    record = json.loads((tmp_path / "out" / "a.corrections.json").read_text())
    assert "below_uncertainty" in record["summary"]
    assert record["limits"]["min_correction_stds"]["value"] == 2.0


@pytest.mark.promise("The report says that a map is weak, in every language.")
def test_the_report_says_it(weak, good, record_property):
    from truepose.report.locale import load_locale
    from truepose.report.sections import _lead

    languages = ("en", "de", "zh")
    for language in languages:
        say = load_locale(language)
        for error_map in (weak, good):
            evidence = SimpleNamespace(
                error_map=error_map,
                cell=error_map.cell,
                date=datetime(2026, 1, 2),
                held_out=None,
                store=None,
                accuracy=error_map.validate(error_map.samples).to_dict(),
            )
            told = say("report.weak") in [text.text for text in _lead(evidence, say)]
            assert told == error_map.worth.weak
    record_property("cases", len(languages))


@pytest.mark.exhaustive
@pytest.mark.promise("A bad campaign cannot raise the largest standard deviation; the record says where it is from.")
def test_the_largest_deviation_does_not_depend_on_the_samples(virtual, targets, record_property):
    bare = virtual.cell.model_copy(update={"robot": virtual.cell.robot.model_copy(update={"repeatability_mm": None})})

    def with_tolerance(cell, tolerance):
        correction = tp.Cell.from_toml(f"{cell.to_toml()}\n[correction]\ntolerance_mm = {tolerance}\n").correction
        return cell.model_copy(update={"correction": correction})

    cases = [
        (virtual.cell, 4 * virtual.cell.robot.repeatability_mm, "default: 4 times the robot's repeatability_mm"),
        (bare, 0.24, "default: 4 times 0.06 mm, since no repeatability_mm is stated"),
        (with_tolerance(virtual.cell, 0.3), 0.15, "default: half of tolerance_mm"),
        (with_tolerance(bare, 0.3), 0.15, "default: half of tolerance_mm"),
    ]
    samples = virtual.measure(virtual.design(FEW + 1, seed=1), seed=1)  # more: no fit anew for each block
    noisy = samples.p_meas + np.random.default_rng(0).normal(scale=0.8, size=samples.p_meas.shape)
    bad = tp.Samples(noisy, q=samples.q, source="bad")
    for cell, value, origin in cases:
        for campaign in (samples, bad):
            limits = tp.fit_cell(cell, campaign, "ordinary-kriging").limits_in_force()
            assert limits.values["max_std_mm"] == pytest.approx(value)
            assert limits.origin["max_std_mm"] == origin
    refused = tp.fit_cell(virtual.cell, bad, "ordinary-kriging").correct(targets, accept_weak_map=True)
    assert set(refused.verdict) <= {"refuse", BELOW}
    record_property("cases", 2 * len(cases))


@pytest.mark.exhaustive
@pytest.mark.promise("A drift that the campaign shows, also one below the limit, widens the deviation of corrections.")
def test_a_drift_below_the_limit_widens_the_deviation(record_property):
    seeds = (102, 103)
    for seed in seeds:
        cold, warm = (tp.VirtualCell(kind, seed=seed) for kind in ("cold-start", "hard"))
        cold, warm = (
            tp.fit_cell(cell.cell, cell.measure(cell.design(100, seed=seed), seed=seed), "registration")
            for cell in (cold, warm)
        )
        (drift,) = [fault["size"] for fault in cold.campaign["faults"]]
        assert 0.05 < drift < cold.campaign["limit_mm"]
        assert warm.campaign["faults"] == []
        beyond = cold.unexplained - np.maximum(cold.predictor.nugget_ - (0.051 / 3.6) ** 2, 0.0)
        assert beyond.sum() == pytest.approx((2 * drift) ** 2, rel=0.05)
    record_property("cases", len(seeds))


@pytest.mark.promise("Samples at one orientation support targets within 2° of it, whatever max_angle_deg says.")
def test_one_orientation_supports_no_other(good, virtual, targets):
    turned = targets.copy()
    tilt = tp.euler("kuka", (0.0, 3.0, 0.0)).as_matrix()
    turned[10:, :3, :3] = turned[10:, :3, :3] @ tilt
    assert good.limits_in_force().values["max_angle_deg"] == pytest.approx(2.0)
    found = good.correct(turned, limits=good.limits_in_force(max_angle_deg=90.0))
    assert set(found.verdict[:10]) == {"correct"}
    assert set(found.verdict[10:]) == {"refuse"}
    assert "orientation is 3.0° from that of any sample, limit 2°" in found.reason[10]
    assert good.limits_in_force(max_angle_deg=1.0).values["max_angle_deg"] == 1.0


@pytest.mark.sampled(2)
@pytest.mark.promise("A map with one standard deviation for all poses corrects nothing unless that is accepted")
@pytest.mark.parametrize(
    "name", ["idw", "idw:space=joint", "nearest", "nearest:space=joint", "grid-cell", "radial-basis"]
)
def test_interpolators_do_not_correct_unasked(name):
    virtual = tp.VirtualCell("paper", seed=3)
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(60)), name)
    targets = virtual.robot.forward(virtual.design(5, seed=9), tool=error_map.tf_flange_tool)
    if not error_map.worth.weak:
        with pytest.raises(RefusedError, match=f"{name} has one standard deviation for all poses.*--accept-weak-map"):
            error_map.correct(targets)
    assert len(error_map.correct(targets, accept_weak_map=True).verdict) == 5
