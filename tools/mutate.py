"""Show by mutation that the tests would notice a fault, and that the default tier notices as much as the complete one.

- ``python tools/mutate.py record`` runs the tests of both tiers once, and keeps which functions each test reaches.
- ``python tools/mutate.py run --number 120`` changes single places of the files of tools/mutants.toml, and runs the
  tests that reach each change: those of the default tier, the quickest first; if all of them pass, those of the second
  tier. Results are kept in build/mutants: a run that was stopped continues, and ``--again survived`` tries survivors
  again after tests were added and recorded. Delete the folder to start anew.
- ``python tools/mutate.py show`` prints the tables of docs/validation/tests.md.

No existing tool is used: mutmut and cosmic-ray run one test command for each mutant, while here the tests that reach a
function must be known, with their tier and time, to compare two tiers in minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path

from mutation.killing import Outcome, Result, failing, kill
from mutation.mutants import Mutant, mutants, sample
from mutation.recording import leave_out, record, recorded
from mutation.settings import Equivalent, Settings

SETTINGS = Path(__file__).with_name("mutants.toml")


def chosen(settings: Settings, seed: int, number: int) -> list[Mutant]:
    """Return the sample of changes."""
    sources = {file: settings.path(file).read_bytes() for file in settings.files()}
    changes = [one for file, source in sources.items() for one in mutants(file, source)]
    wanted = [one for one in changes if settings.wants(one.file, one.functions)]
    return sample(wanted, sources, seed, number)


def run(settings: Settings, changes: list[Mutant], jobs: int, again: set[str], *, second_tier: bool) -> None:
    """Run the tests that reach each change, unless its result is known."""
    known = {key: one for key, one in results(settings).items() if one.outcome not in again}
    reviewed = [(one, reason) for one in changes if (reason := equivalent(settings, one)) is not None]
    known |= {one.key: Result.of(one, "equivalent", reason) for one, reason in reviewed}
    left = [one for one in changes if one.key not in known]
    print(f"{len(changes)} mutants, {len(left)} of them to be tried", flush=True)

    def done(result: Result) -> None:
        known[result.key] = result
        _write(settings, known.values())
        tried = len(changes) - sum(one.key not in known for one in changes)
        where = f"{result.file}:{result.line}: {result.before} -> {result.after}"
        print(f"{tried}/{len(changes)} {result.outcome} {result.seconds:.0f} s {where} [{result.by}]", flush=True)

    _write(settings, known.values())
    if left:
        tests = recorded(settings)
        if not second_tier:
            tests = [replace(test, grows=False) for test in tests if not test.second]
        kill(settings, left, tests, jobs, done)
        _check(settings, [known[one.key] for one in left])


def _check(settings: Settings, found: list[Result]) -> None:
    """Require that the tests that killed mutants pass without a change; what others killed is to be tried again."""
    wrong: list[str] = []
    for outcome in ("default", "complete"):
        by = {one.by for one in found if one.outcome == outcome}
        killers = [test for test in recorded(settings) if test.id in by]
        wrong += failing(settings, killers, second=outcome == "complete") if killers else []
    if wrong:
        leave_out(settings, [name for name in wrong if "::" in name and not name.endswith(")")])
        _write(settings, [one for one in results(settings).values() if one.by not in wrong])
        print(f"Fail without a change, and are left out; run again: {', '.join(wrong)}")


def equivalent(settings: Settings, mutant: Mutant) -> str | None:
    """Return the reason why a change has no effect; None if it is not known to have none."""
    made = (mutant.file, mutant.before, mutant.after)
    return next((one.reason for one in settings.equivalent if (one.file, one.line, one.becomes) == made), None)


def unknown(settings: Settings) -> list[Equivalent]:
    """Return the changes in the settings that cannot be made any more."""
    changes = [one for file in settings.files() for one in mutants(file, settings.path(file).read_bytes())]
    made = {(one.file, one.before, one.after) for one in changes}
    return [one for one in settings.equivalent if (one.file, one.line, one.becomes) not in made]


def results(settings: Settings) -> dict[str, Result]:
    """Return the results that are known, by the keys of the mutants."""
    path = settings.folder / "results.json"
    rows = json.loads(path.read_text("utf-8")) if path.exists() else []
    return {row["key"]: Result(**row) for row in rows}


def _write(settings: Settings, found: Iterable[Result]) -> None:
    settings.folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps([asdict(one) for one in found], indent=1)
    path = settings.folder / "results.json"
    part = path.with_suffix(".part")
    part.write_text(text, "utf-8")
    part.replace(path)


def table(changes: list[Mutant], known: dict[str, Result]) -> str:
    """Return the results by file, and the mutants that only the complete tests kill, or none."""
    found = [known[one.key] for one in changes if one.key in known]
    lines = [
        "| file | mutants | without effect | killed by default | by their own room | by all tests | survived |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    files = [*dict.fromkeys(one.file for one in found)]
    for name, some in [*((file, [one for one in found if one.file == file]) for file in files), ("all", found)]:
        default, complete = _count(some, "default"), _count(some, "default", "complete")
        own = sum(one.own for one in some if one.outcome == "default")
        without, left = _count(some, "equivalent"), _count(some, "survived", "unreached")
        lines.append(f"| {name} | {len(some)} | {without} | {default} | {own} | {complete} | {left} |")
    effect = len(found) - _count(found, "equivalent")
    if effect:
        shares = [100.0 * _count(found, *some) / effect for some in (("default",), ("default", "complete"))]
        lines.append(f"\nOf {effect} mutants, the default tier kills {shares[0]:.1f} %, all tests {shares[1]:.1f} %.")
    for outcome, title in (("complete", "Killed by the second tier only"), ("survived", "Survived")):
        some = [one for one in found if one.outcome in (outcome, "unreached" if outcome == "survived" else outcome)]
        lines += [f"\n{title}:\n" if some else "", *map(_difference, some)]
    return "\n".join(lines)


def _count(some: list[Result], *outcomes: Outcome) -> int:
    return sum(one.outcome in outcomes for one in some)


def _difference(one: Result) -> str:
    tests = f"killed by {one.by}" if one.by else f"{one.tests} tests reach it"
    return f"- `{one.file}:{one.line}` ({one.key}; {tests})\n  ```diff\n  -{one.before}\n  +{one.after}\n  ```"


def main() -> int:
    """Run a command of this script; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=["record", "run", "show"])
    parser.add_argument("--settings", type=Path, default=SETTINGS, help="default: tools/mutants.toml")
    parser.add_argument("--seed", type=int, default=1, help="of the sample; default: 1")
    parser.add_argument("--number", type=int, default=120, help="size of the sample; default: 120")
    parser.add_argument("--jobs", "-j", type=int, default=os.cpu_count() or 1, help="processes; default: all")
    parser.add_argument("--tier", choices=["default", "all"], default="all", help="which tests count; default: all")
    parser.add_argument(
        "--again", nargs="*", default=[], help="outcomes to be tried again: survived, complete, unreached, default"
    )
    arguments, rest = parser.parse_known_args()
    settings = Settings.read(arguments.settings)
    if arguments.command == "record":
        workers = ["-n", str(arguments.jobs), "--dist", "worksteal"] if arguments.jobs > 1 else []
        return record(settings, [*workers, *rest], second_tier=arguments.tier == "all")
    changes = chosen(settings, arguments.seed, arguments.number)
    if arguments.command == "run":
        run(settings, changes, arguments.jobs, set(arguments.again), second_tier=arguments.tier == "all")
    print(table(changes, results(settings)))
    for one in unknown(settings):
        print(f"{arguments.settings.name}: {one.file} has no such change any more: {one.line} -> {one.becomes}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
