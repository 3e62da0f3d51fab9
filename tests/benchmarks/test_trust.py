"""The page of promises and of corrected targets that got worse, in small."""

import pytest

from benchmarks import trust, trust_cells, trust_faults

TESTS = """
import pytest

@pytest.mark.promise("Numbers add up.")
@pytest.mark.parametrize("n", [1, 2])
def test_sums(n, record_property):
    record_property("cases", 10 * n)
    assert n + n == 2 * n

@pytest.mark.promise("Nothing fails.")
def test_fails():
    assert False

@pytest.mark.promise("Skipped tests show nothing.")
def test_skipped():
    pytest.skip("absent")

def test_of_no_promise():
    pass
"""


def test_promises_are_listed_with_cases_and_failures(tmp_path):
    (tmp_path / "test_them.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = promise(text): a promise\n")
    found = trust.run_promises(["."], tmp_path)
    assert found == [
        ("Numbers add up.", "test_them.py::test_sums", 30, 0),
        ("Nothing fails.", "test_them.py::test_fails", 1, 1),
    ]


def test_every_kind_of_troubled_cell_is_in_the_study():
    assert len(trust_cells.KINDS) == 10


@pytest.mark.exhaustive
def test_the_fate_of_targets():
    good, weak = trust_cells.fates("paper", 100, samples=40, predictors=("ordinary-kriging", "registration"))
    assert good.corrected > 90
    assert good.worse <= 1
    assert 0.8 < good.coverage <= 1.0
    assert good.after_mm < 0.2 * good.before_mm
    assert not good.refused
    assert "better than none" in weak.refused
    assert weak.corrected == 0
    row = trust.Row.of([good, weak])
    assert row.corrected == good.corrected / 200
    assert row.refused == "1 of 2"
    assert row.cells()[0].endswith(" %")


@pytest.mark.sampled(3)
@pytest.mark.parametrize("fault", trust_faults.FAULTS)
def test_the_fate_of_targets_under_a_fault(fault):
    """No fault makes targets worse by more than twice the repeatability."""
    (fate,) = trust_faults.fates_of_fault(fault, 100, predictors=("kinematic-kriging",))
    assert fate.worse <= 0.01 * fate.corrected


def test_a_run_is_resumed(tmp_path, monkeypatch):
    calls = []

    def fates(kind, seed, predictors):
        calls.append(seed)
        return [trust_cells.Fate(kind, seed, name, corrected=50, worse=seed) for name in predictors]

    class Here:
        """Runs in this process what `ProcessPoolExecutor` would run in others."""

        def __init__(self, *_):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def submit(self, call, *args, **more):
            done = trust.Future()
            done.set_result(call(*args, **more))
            return done

    monkeypatch.setattr(trust, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(trust, "ProcessPoolExecutor", Here)
    first = trust._of_kind(fates, "paper", range(2), ("idw",))
    again = trust._of_kind(fates, "paper", range(3), ("idw",))
    assert calls == [0, 1, 2]
    assert [fate.worse for fate in again] == [0, 1, 2]
    assert [fate.worse for fate in first] == [0, 1]
