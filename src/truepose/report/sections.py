"""The sections of a report: evidence and texts of a language give a document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._version import version
from truepose.error_map.judgement import reflector
from truepose.geometry import ANGLES, euler
from truepose.report import conformity, headline, identity, records, scene, verification
from truepose.report.arm import rods
from truepose.report.document import Attachment, Block, Document, Facts, Picture, Section, Signatures, Table, Text
from truepose.report.evidence import SEED, Evidence
from truepose.report.findings import findings, title
from truepose.report.locale import MISSING, Locale
from truepose.report.plots import figures

_FIGURES: Final = ("mean", "rms", "std", "p95", "max")
_STATES: Final = ("before", "after")
_LISTED: Final = 12
"""The number of excluded samples, and of records, listed one by one."""
_FEW: Final = 8
"""The largest number of values of a parameter that is printed."""
_HASH: Final = 12
_NARROW: Final = 0.7
"""The width of a single plot, as a share of the page's width."""


def document(evidence: Evidence, say: Locale, *, interactive: bool = False) -> Document:
    """Return the document of a report in a language, for a page also with an interactive view."""
    error_map = evidence.error_map
    verified = verification.section(evidence.verifications, error_map.hash, say)
    logo, warned = identity.logo(evidence, say)
    decided = headline.headline(evidence)
    sections = [
        headline.section(evidence, decided, say),
        identity.section(evidence, say),
        conformity.section(evidence, say),
        _accuracy(evidence, say),
        _signatures(evidence, say),
        _cell(evidence, say),
        _errors(evidence, say, interactive),
        _maps(evidence, say),
        _registration(evidence, say),
        _similarity(evidence, say),
        _facts(evidence, say),
        _model(evidence, say),
        records.section(evidence.records, error_map.hash, say),
        *([] if verified is None else [verified]),
        _provenance(evidence, say),
    ]
    robot = f"{error_map.robot.maker} {error_map.robot.model}".strip() or error_map.robot.name
    return Document(
        language=say.name,
        fonts=say.fonts,
        title=say("report.of", robot=robot),
        stamp=say("report.stamp", date=_date(evidence), hash=error_map.hash[:_HASH], version=version()),
        page=say("report.page"),
        attached=say("report.attached"),
        tiles=[headline.tile(decided, say), *_tiles(evidence, say)],
        lead=[*_lead(evidence, say), *warned, *_missing(sections, say)],
        sections=sections,
        logo=logo,
        attachments=[
            _poses(evidence, say),
            *records.attachment(evidence.records, say),
            *verification.attachment(evidence.verifications, say),
        ],
    )


def _poses(evidence: Evidence, say: Locale) -> Attachment:
    """Return the evaluated poses with their errors as CSV, to attach."""
    parts = {"cmd": evidence.p, "before": evidence.before, "after": evidence.after, "std": evidence.std}
    names = [f"{axis}_{kind}_mm" for kind in parts for axis in "xyz"]
    rows = np.column_stack(list(parts.values())).tolist()
    lines = [",".join(("pose", *names)), *(f"{k},{','.join(f'{v:.6f}' for v in row)}" for k, row in enumerate(rows, 1))]
    return Attachment("poses.csv", say("errors.attached"), "\n".join(lines) + "\n")


def _missing(sections: Sequence[Section], say: Locale) -> list[Text]:
    """Return a warning that names the missing facts of all sections; `_lead` says that the arm was not checked."""
    listed = [block for section in sections for block in section.blocks if isinstance(block, Facts)]
    names = [name for block in listed for k in block.missing if (name := block.rows[k][0]) != say("cell.arm")]
    return [Text(say("report.missing_facts", names=say("finding.list").join(names)), warns=True)] if names else []


def _tiles(evidence: Evidence, say: Locale) -> list[tuple[str, str]]:
    found = evidence.accuracy
    before, after = (found[state] for state in _STATES)
    change = {
        key: say("report.change", before=before[f"{key}_mm"], after=after[f"{key}_mm"]) for key in ("mean", "max")
    }
    return [
        (change["mean"], say("report.tile_mean")),
        (change["max"], say("report.tile_max")),
        (say("report.percent", share=found["reduction_mean_percent"]), say("report.tile_reduction")),
        (str(before["n"]), say("report.tile_left_out" if evidence.held_out is None else "report.tile_held_out")),
    ]


def _lead(evidence: Evidence, say: Locale) -> list[Text]:
    found, held_out = evidence.accuracy, evidence.held_out
    low, high = found["intervals_95"]["after_mean_mm"]
    summary = say(
        "report.summary_left_out" if held_out is None else "report.summary_held_out",
        n=found["before"]["n"],
        before=found["before"]["mean_mm"],
        after=found["after"]["mean_mm"],
        worst=found["before"]["max_mm"],
        left=found["after"]["max_mm"],
        low=low,
        high=high,
    )
    texts = [Text(say("report.after_left_out" if held_out is None else "report.after_held_out")), Text(summary)]
    if evidence.store is not None and evidence.store.map_state != "released":
        texts.append(Text(say(f"report.map_{evidence.store.map_state}"), warns=True))
    if evidence.error_map.worth.weak:
        texts.append(Text(say("report.weak"), warns=True))
    if held_out is None:
        texts.append(Text(say("report.not_held_out"), warns=True))
    elif found["seen"]:
        texts.append(Text(say("report.seen", n=found["seen"]), warns=True))
    if not evidence.error_map.arm_check.checked:
        texts.append(Text(say("cell.arm_not_checked"), warns=True))
    return texts + identity.overdue(evidence, say)


def _cell(evidence: Evidence, say: Locale) -> Section:
    error_map, held_out = evidence.error_map, evidence.held_out
    robot, samples, load = error_map.robot, error_map.samples, error_map.cell.payload
    low, high = error_map.p_cmd.min(axis=0).tolist(), error_map.p_cmd.max(axis=0).tolist()
    payload = None
    if "mass_kg" in load.model_fields_set:
        payload = say("cell.payload_text", mass=load.mass_kg, x=load.x_mm, y=load.y_mm, z=load.z_mm)
    with_joints = "cell.samples_positions" if samples.q is None else "cell.samples_joints"
    tested = None
    if held_out is not None:
        tested = say("cell.held_out_text", n=len(held_out), source=held_out.source)
    excluded = [say("cell.excluded_text", sample=_sample(row, say), reason=row["reason"]) for row in error_map.excluded]
    if len(excluded) > _LISTED:
        excluded = [*excluded[:_LISTED], say("cell.more", n=len(excluded) - _LISTED)]
    bounds = {
        f"{axis}{k}": value for k, ends in enumerate((low, high)) for axis, value in zip("xyz", ends, strict=True)
    }
    rows: dict[str, str | None] = {
        "robot": f"{robot.maker} {robot.model} ({robot.name})",
        "dimensions": robot.source,
        "payload": payload,
        "tracker": _tracker(evidence, say),
        "samples": say(with_joints, n=len(samples), source=samples.source),
        "arm": _arm(evidence, say),
        "reflector": _reflector(evidence, say),
        "held_out": tested,
        "region": say("cell.region_text", **bounds),
        "campaign": _campaign(error_map.campaign, say),
        "excluded": "; ".join(excluded) or say("cell.excluded_none"),
    }
    return Section(say("cell.title"), [identity.facts("cell", rows, say)])


def _campaign(campaign: Mapping[str, Any], say: Locale) -> str | None:
    """Return the faults of the measuring campaign, or that none was found; None if it was not tested."""
    if not campaign.get("tested"):
        return None
    parts = {"turn": 1e3, "turn_std": 1e3, "scale": 100.0, "scale_std": 100.0}
    faults = [
        say(
            f"cell.campaign_{fault['kind']}",
            **{name: factor * fault[name] for name, factor in {"shift": 1.0, "shift_std": 1.0, **parts}.items()},
            **dict(zip(("first", "last"), _ends(fault, say), strict=True)),
            points=fault["points"],
        )
        for fault in campaign["faults"]
    ]
    return "; ".join(faults) or say("cell.campaign_none", n=campaign["tested"])


def _ends(fault: Mapping[str, Any], say: Locale) -> list[str]:
    """Return the names of the first and the last sample of a fault; maps of earlier versions hold rows alone."""
    return [_sample(one, say) for one in fault.get("ends") or [{"row": row} for row in fault["rows"]]]


def _sample(known: Mapping[str, Any], say: Locale) -> str:
    """Return the name of a sample in the report's language."""
    where = "line" if known.get("line") is not None else "row"
    if known.get("point"):
        return say("cell.sample_line" if where == "line" else "cell.sample_point", **known)
    return say(f"cell.sample_{where}_only", **known)


def _arm(evidence: Evidence, say: Locale) -> str | None:
    found = evidence.error_map.arm_check
    if not found.checked or found.residual_mm is None:
        return None
    return say("cell.arm_checked", n=found.n, residual=found.residual_mm)


def _reflector(evidence: Evidence, say: Locale) -> str | None:
    """Return where the readings put the reflector; None where they do not tell."""
    found = reflector(evidence.error_map)
    if found.size is None or found.std is None:
        return None
    return say("cell.reflector_at", size=found.size, std=found.std)


def _tracker(evidence: Evidence, say: Locale) -> str | None:
    if evidence.reading_source == "table" and evidence.reading_std is not None:
        return say("cell.tracker_table", std=float(evidence.reading_std.max()))
    tracker = evidence.cell.tracker
    if tracker.reading_std(np.zeros((1, 3))) is None:
        tracker = evidence.error_map.cell.tracker
    if tracker.std_mm is not None:
        return say("cell.tracker_std", std=tracker.std_mm)
    terms = (tracker.range_um, tracker.range_um_per_m, tracker.angle_um, tracker.angle_um_per_m)
    if all(term is None for term in terms):
        return None
    along, along_m, across, across_m = (term or 0.0 for term in terms)
    return say("cell.tracker_terms", range=along, range_m=along_m, angle=across, angle_m=across_m)


def _accuracy(evidence: Evidence, say: Locale) -> Section:
    found = evidence.accuracy
    rows = _accuracy_rows(say("accuracy.length"), found, say)
    shares = (_reduction(found["before"][f"{key}_mm"], found["after"][f"{key}_mm"]) for key in _FIGURES)
    rows.append([say("accuracy.reduction"), "", *(f"{say.number(share, '.1f')} %" for share in shares)])
    blocks: list[Block] = [Text(say("accuracy.about")), Table(_accuracy_columns(say), rows)]
    values = {key: found["after"][key.removeprefix("after_")] for key in ("after_mean_mm", "after_max_mm")}
    values |= {key: found[key] for key in ("reduction_mean_percent", "reduction_max_percent")}
    intervals = [
        [say(f"accuracy.{key}"), *(say.number(v, ".3f" if key.endswith("mm") else ".1f") for v in (value, *ends))]
        for key, value in values.items()
        if (ends := found["intervals_95"].get(key)) is not None
    ]
    mean = found["after"]["mean_mm"]
    intervals += [
        [say(f"accuracy.group_{name}"), *(say.number(v, ".3f") for v in (mean, *ends))]
        for name, group in found["groups"].items()
        if (ends := group["interval_95_mean_mm"]) is not None
    ]
    few = [
        say(f"accuracy.few_{name}", n=len(group["parts"]))
        for name, group in found["groups"].items()
        if group["interval_95_mean_mm"] is None
    ]
    heads = [say(f"accuracy.column_{key}") for key in ("figure", "value", "low", "high")]
    blocks += [Text(say("accuracy.intervals")), Table(heads, intervals)]
    if few:
        blocks.append(Text(say("accuracy.few_groups", groups=say("finding.list").join(few))))
    blocks.append(_left_out(evidence, say))
    if "coverage" in found:
        cover = found["coverage"]
        shares_inside = {key: 100 * cover[key] for key in ("within_68", "within_95")}
        blocks.append(Text(say("accuracy.coverage", **shares_inside, rms=cover["standardised_rms"])))
    return Section(say("accuracy.title"), blocks)


def _left_out(evidence: Evidence, say: Locale) -> Text:
    """Return how many readings took no part in the figures: those of the fit, and those of the held-out table."""
    n = len(evidence.error_map.excluded)
    if evidence.held_out is None:
        return Text(say("accuracy.left_out", n=n))
    return Text(say("accuracy.left_out_of_both", n=n, held_out=len(evidence.held_out.excluded)))


def _errors(evidence: Evidence, say: Locale, interactive: bool) -> Section:
    rows: list[list[str]] = []
    for axis, both in evidence.accuracy["axes"].items():
        rows += _accuracy_rows(say("accuracy.component", axis=axis), both, say)
    blocks: list[Block] = [
        *([scene.view(evidence, say)] if interactive else []),
        Picture(
            figures.error_arrows(evidence.p, evidence.before, evidence.after, rods(evidence.error_map), say),
            say("figure.arrows"),
        ),
        Picture(figures.histogram(evidence.before, evidence.after, say), say("figure.histogram"), _NARROW),
        Table(_accuracy_columns(say), rows),
    ]
    return Section(say("errors.title"), blocks)


def _accuracy_columns(say: Locale) -> list[str]:
    return ["", *(say(f"accuracy.column_{key}") for key in ("n", *_FIGURES))]


def _accuracy_rows(quantity: str, both: Mapping[str, Any], say: Locale) -> list[list[str]]:
    return [
        [
            say("accuracy.row", quantity=quantity, state=say(f"report.{state}")),
            str(both[state]["n"]),
            *(say.number(both[state][f"{key}_mm"], ".3f") for key in _FIGURES),
        ]
        for state in _STATES
    ]


def _reduction(before: float, after: float) -> float | None:
    return 100 * (1 - after / before) if before > 0 else None


def _maps(evidence: Evidence, say: Locale) -> Section:
    title, error_map = say("maps.title"), evidence.error_map
    if not evidence.planes:
        return Section(title, [Text(say("maps.none"))])
    middle = (error_map.p_cmd.min(axis=0) + error_map.p_cmd.max(axis=0)) / 2
    caption = say("maps.caption", **dict(zip("xyz", middle.tolist(), strict=True)))
    if error_map.space != "cartesian":
        caption = f"{caption} {say('maps.oriented')}"
    return Section(title, [Picture(figures.maps(evidence.planes, error_map.p_cmd, say), caption)])


def _registration(evidence: Evidence, say: Locale) -> Section:
    error_map, found = evidence.error_map, evidence.error_map.registration
    std = np.sqrt(np.diag(found.covariance))
    tf, fitted = found.tf_base_tracker, error_map.cell.station_fitted
    rows: dict[str, str | None] = {
        "station": _position(tf[:3, 3], std[:3] if fitted else None, say),
        "rotation": controller_angles(Rotation.from_matrix(tf[:3, :3]), error_map.cell.controller, say),
    }
    tool = error_map.tf_flange_tool[:3, 3]
    if error_map.tool_fitted:
        rows["tool_fitted"] = _position(tool, std[6:9], say)
    else:
        rows["tool_stated"] = _position(tool, None, say)
    rows["residual"] = say("registration.residual_text", std=found.noise_std)
    if found.hint:
        rows["hint"] = found.hint
    about = say("registration.about" if fitted else "registration.known")
    return Section(say("registration.title"), [Text(about), identity.facts("registration", rows, say)])


def controller_angles(rotation: Rotation, controller: str | None, say: Locale) -> str:
    """Return a rotation in the controller's own angles; as a quaternion w, x, y, z if the maker is not known."""
    names = ANGLES[controller or "abb"].names
    form, unit = {"abb": (".7f", ""), None: (".7f", ""), "ur": (".7f", " rad")}.get(controller, (".5f", "°"))
    values = zip(names, euler(controller or "abb", rotation).tolist(), strict=True)
    text = "; ".join(f"{name} {say.number(value, form)}{unit}" for name, value in values)
    return text if unit else f"{text} ({say('registration.quaternion')})"


def _position(p: Any, std: Any, say: Locale) -> str:
    values = dict(zip("xyz", np.asarray(p).tolist(), strict=True))
    if std is None:
        return say("registration.position", **values)
    deviations = dict(zip(("sx", "sy", "sz"), np.asarray(std).tolist(), strict=True))
    return say("registration.position_std", **values, **deviations)


def _similarity(evidence: Evidence, say: Locale) -> Section:
    blocks: list[Block] = [Text(say("similarity_section.about"))]
    for part in evidence.study.parts:
        blocks += [Picture(figures.variogram(part, say), title(part, say), _NARROW), Facts(findings(part, say))]
    return Section(say("similarity_section.title"), blocks)


def _facts(evidence: Evidence, say: Locale) -> Section:
    """Return what is known about the map beside its predictions, each with its effect on corrections."""
    rows = [[fact.code, say(f"facts.{fact.effect}"), fact.words] for fact in evidence.error_map.facts]
    columns = [say(f"facts.{name}") for name in ("code", "effect", "words")]
    return Section(say("facts.title"), [Text(say("facts.about")), Table(columns, rows, left=len(columns))])


def _model(evidence: Evidence, say: Locale) -> Section:
    error_map = evidence.error_map
    plain, tables = _parameters(error_map.predictor.to_dict(), error_map.space, say)
    rows: dict[str, str | None] = {"predictor": error_map.predictor_name}
    if plain:
        rows["parameters"] = "; ".join(plain)
    blocks: list[Block] = [identity.facts("model", rows, say), *_better(evidence, say), *tables]
    if not error_map.ranking:
        return Section(say("model.title"), [*blocks, Text(say("model.named"))])
    splits = list(error_map.ranking[0].get("splits", {}))
    columns = ["predictor", "mean", "interval", *(f"{name}_mean" for name in splits), "p95", "inside", "note"]
    ranked = [_ranked(row, splits, say) for row in error_map.ranking]
    shown = [k for k in range(len(columns)) if any(row[k] not in ("", MISSING) for row in ranked)]
    heads = [say(f"model.column_{columns[k]}") for k in shown]
    noted = len(columns) - 1 in shown
    table = Table(heads, [[row[k] for k in shown] for row in ranked], last_left=int(noted))
    chosen = [Text(say("model.chosen")), _left_out(evidence, say)]
    return Section(say("model.title"), [*blocks, *chosen, table, *_expected(evidence, say)])


def _better(evidence: Evidence, say: Locale) -> list[Block]:
    """Return a warning that another predictor would do far better, if one does."""
    found = evidence.better
    if found is None:
        return []
    key = "model.better_left_out" if evidence.held_out is None else "model.better_held_out"
    values = {"theirs": found.rival_mean_mm, "own": found.mean_mm}
    return [Text(say(key, rival=found.rival, predictor=found.predictor, **values), warns=True)]


def _ranked(row: Mapping[str, Any], splits: list[str], say: Locale) -> list[str]:
    """Return a row of the ranking; a failed candidate has a note instead of figures."""
    return [
        row["predictor"],
        say.number(row.get("mean_mm"), ".3f"),
        _interval(row.get("mean_interval_mm"), say),
        *(say.number(row.get("splits", {}).get(name, {}).get("mean_mm"), ".3f") for name in splits),
        say.number(row.get("p95_mm"), ".3f"),
        f"{say.number(100 * row['within_95'], '.0f')} %" if "within_95" in row else MISSING,
        row.get("note", "") or (say("model.level") if row.get("level") and row.get("worse_by_mm") else ""),
    ]


def _expected(evidence: Evidence, say: Locale) -> list[Block]:
    """Return the error on samples outside fit and choice, if the map contains it."""
    found = evidence.error_map.expected
    if not found:
        return []
    low, high = found["mean_interval_mm"]
    chosen = say("finding.list").join(f"{name} {count}" for name, count in found["chosen"].items())
    return [Text(say("model.expected", mean=found["mean_mm"], low=low, high=high, chosen=chosen))]


def _interval(ends: Any, say: Locale) -> str:
    return MISSING if ends is None else say("model.interval", low=float(ends[0]), high=float(ends[1]))


def _parameters(parameters: Mapping[str, Any], space: str, say: Locale) -> tuple[list[str], list[Block]]:
    """Return short parameters as text and lists of records as tables; longer values are left out."""
    plain: list[str] = []
    tables: list[Block] = []
    units = {"nugget": "mm²", "sill": "mm²", "range": "mm" if space == "cartesian" else "rad"}
    for name, value in parameters.items():
        if (
            isinstance(value, list)
            and value
            and all(isinstance(v, dict) and v.keys() == value[0].keys() for v in value)
        ):
            columns = [name, *(f"{key} [{units[key]}]" if key in units else key for key in value[0])]
            names = "xyz" if name == "variogram" and len(value) == 3 else range(1, len(value) + 1)
            rows = [[str(k), *(_value(v, say) for v in row.values())] for k, row in zip(names, value, strict=True)]
            words = takewhile(lambda v: isinstance(v, str), value[0].values())
            if name == "variogram":
                tables.append(Text(say("model.variograms", section=say("similarity_section.title"))))
            tables.append(Table(columns, rows, left=1 + len(list(words))))
        elif (text := _value(value, say)) != MISSING:
            plain.append(f"{name} = {text}")
    return plain, tables


def _value(value: Any, say: Locale) -> str:
    if isinstance(value, bool | str | int):
        return str(value)
    if isinstance(value, float):
        return say.number(value, ".4g")
    if isinstance(value, list) and 0 < len(value) <= _FEW and all(isinstance(v, float | int | str) for v in value):
        return "(" + "; ".join(_value(v, say) for v in value) + ")"
    return MISSING


def _provenance(evidence: Evidence, say: Locale) -> Section:
    rows = [
        (say("provenance.date"), _date(evidence)),
        (say("provenance.versions"), evidence.versions),
        (say("provenance.seeds"), say("provenance.seeds_text", permutations=SEED, bootstrap=SEED)),
        (say("provenance.map"), evidence.error_map.hash),
        *_store(evidence, say),
    ]
    if evidence.held_out is not None:
        rows.append((say("provenance.held_out"), evidence.held_out_sha256 or say("provenance.missing")))
    for record in evidence.records[:_LISTED]:
        rows.append((say("provenance.record", name=record.file), record.sha256))
        rows += [(say("provenance.program", name=name), after) for name, after in record.hashes]
    n = len(evidence.records)
    more = [Text(say("provenance.more", shown=_LISTED, n=n, table=records.HASHES))] if n > _LISTED else []
    return Section(say("provenance.title"), [Facts(rows), *more])


def _store(evidence: Evidence, say: Locale) -> list[tuple[str, str]]:
    """Return the state of the map in the store, and the head of its audit trail; nothing without a store."""
    if (found := evidence.store) is None:
        return []
    text = say(
        "provenance.store_text",
        state=say(f"provenance.state_{found.map_state}"),
        sequence=found.sequence,
        head=found.head,
    )
    return [(say("provenance.store"), text)]


def _signatures(evidence: Evidence, say: Locale) -> Section:
    columns = ["", *(say(f"signatures.{key}") for key in ("name", "date", "signature"))]
    rows = [say(f"signatures.{key}") for key in ("measured", "evaluated", "approved")]
    about = say("signatures.about", hash=evidence.error_map.hash, date=_date(evidence))
    return Section(say("signatures.title"), [Signatures(about, columns, rows)])


def _date(evidence: Evidence) -> str:
    return f"{evidence.date:%Y-%m-%d %H:%M} UTC"
