"""Put the targets and motions of a program in the order of the text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from truepose.programs.core.columns import NO_MOTIONS, Follow, Motions, ProgramTargets, Stretch
from truepose.programs.core.pieces import Piece, Section
from truepose.programs.core.program import linked
from truepose.programs.core.source import Source, Span
from truepose.programs.core.target import JOINT_MOTION, Target


class Visit(NamedTuple):
    """A motion to a target, with its place in the text.

    Attributes
    ----------
    file : str
        The name of the file; empty where there is one.
    line, order : int
        The line, and the place among the motions of the line.
    section : Section
        Where it stands. Control does not go from one section into the next.
    item : int
        The target, or the run of targets.
    word : str
        The word of the motion.
    """

    file: str
    line: int
    order: int
    section: Section
    item: int
    word: str


class Sweep(NamedTuple):
    """Motions of one word to consecutive targets, one to each; see `Visit` for the attributes.

    `line` is an array (n,); it need not ascend.
    """

    file: str
    line: NDArray[np.int32]
    order: int
    section: Section
    word: str

    @classmethod
    def of(cls, first: Visit, n: int) -> Sweep:
        """Return n motions line after line, from the first one."""
        lines = np.arange(first.line, first.line + n, dtype=np.int32)
        return cls(first.file, lines, first.order, first.section, first.word)


def in_order(
    items: Sequence[Target | Stretch],
    circles: Iterable[Sequence[int]],
    sources: Sequence[Source],
    visits: Iterable[Visit],
    sweeps: Sequence[tuple[Sweep, int]] = (),
    follows: Mapping[int, Follow] | None = None,
) -> tuple[ProgramTargets, tuple[tuple[int, ...], ...]]:
    """Return a program's targets in the order of the text, file by file, and its circles by their places there.

    A target whose circle has another point that is left out is left out, too. `circles`, `visits`, `sweeps` and
    `follows` refer to places in `items`; `sources` gives the order of the files. In a circle, the points that a target
    follows take its place.
    """
    follows = follows or {}
    circles = [[j for i in circle for j in (follows[i].sources if i in follows else (i,))] for circle in circles]
    rank = {source.path: k for k, source in enumerate(sources)}

    def key(i: int) -> tuple[int, int, tuple[Span, ...]]:
        first = item if isinstance(item := items[i], Target) else item.like
        return rank[first.path], first.line, first.spans

    order = sorted(range(len(items)), key=key)
    starts = accumulate([1 if isinstance(item := items[i], Target) else len(item) for i in order], initial=0)
    place = dict(zip(order, starts, strict=False))
    replaced = _joined(items, tuple([tuple(circle) for circle in circles]))
    replaced |= _followers(items, replaced, follows)
    motions = _motions(list(visits), sweeps, [place[i] for i in range(len(items))])
    followed = {place[i]: one._replace(sources=tuple([place[j] for j in one.sources])) for i, one in follows.items()}
    targets = ProgramTargets((replaced.get(i, items[i]) for i in order), motions, followed)
    return targets, tuple([tuple([place[i] for i in circle]) for circle in circles])


def _motions(visits: Sequence[Visit], sweeps: Sequence[tuple[Sweep, int]], places: Sequence[int]) -> Motions:
    """Return the motions in the order of the text.

    Parameters
    ----------
    visits : sequence of Visit
        Motions to single targets.
    sweeps : sequence of (Sweep, int)
        Motions to targets in a row, each with the item that they are.
    places : sequence of int
        The place of each item's first target.
    """
    if not visits and not sweeps:
        return NO_MOTIONS
    files = {name: k for k, name in enumerate(sorted({v.file for v in visits} | {s.file for s, _ in sweeps}))}
    words = {word: k for k, word in enumerate(sorted({v.word for v in visits} | {s.word for s, _ in sweeps}))}
    pieces: dict[Piece, int] = {}

    def where(at: Visit | Sweep) -> tuple[int, int]:
        return at.section.number, pieces.setdefault(at.section.piece.start, len(pieces))

    by_visit = [(files[v.file], v.line, v.order, *where(v), v.item, words[v.word]) for v in visits]
    singles = np.array(by_visit, np.int32).reshape(-1, 7).T
    targets = [np.array([places[v.item] for v in visits], np.int64)]
    keys: list[list[NDArray[np.int32]]] = [[key] for key in singles]
    for sweep, item in sweeps:
        n = len(sweep.line)
        one = (files[sweep.file], sweep.line, sweep.order, *where(sweep), item, words[sweep.word])
        for column, value in zip(keys, one, strict=True):
            column.append(np.broadcast_to(np.asarray(value, np.int32), n))
        targets.append(np.arange(places[item], places[item] + n))
    file, line, order, section, piece, item_, word = map(np.concatenate, keys)
    sequence = np.lexsort((word, item_, section, order, line, file))
    on_path = np.array([JOINT_MOTION.fullmatch(text) is None for text in words])[word[sequence]]
    file, section, piece = file[sequence], section[sequence], piece[sequence]
    follows = np.zeros(len(file), np.bool_)
    follows[1:] = (file[1:] == file[:-1]) & (section[1:] == section[:-1])
    goes_on = follows.copy()
    goes_on[1:] &= piece[1:] == piece[:-1]
    return Motions(np.concatenate(targets)[sequence], on_path & follows, goes_on)


def _joined(items: Sequence[Target | Stretch], circles: tuple[tuple[int, ...], ...]) -> dict[int, Target]:
    """Return the targets that are left out because of another one in their circle, by their places."""
    targets = {i: target for circle in circles for i in circle if isinstance(target := items[i], Target)}
    causes = linked(circles, [i for i, target in targets.items() if target.verdict != "correct"])
    replaced = {}
    for i in causes:
        k = i
        while k in causes:
            k = causes[k]
        cause = targets[k]
        reason = f"its circle's other point {cause.name} (line {cause.line}) is left out: {cause.reason}"
        replaced[i] = replace(targets[i], verdict=cause.verdict, reason=reason)
    return replaced


def _followers(
    items: Sequence[Target | Stretch], replaced: Mapping[int, Target], follows: Mapping[int, Follow]
) -> dict[int, Target]:
    """Return the targets that follow a point which is left out, each with that reason, by their places."""
    found = {}
    for i, follow in follows.items():
        sources = [replaced.get(j, items[j]) for j in follow.sources]
        cause = next((one for one in sources if isinstance(one, Target) and one.verdict != "correct"), None)
        if cause is not None and isinstance(item := items[i], Target):
            reason = f"derived from {cause.name} (line {cause.line}), which is left out: {cause.reason}"
            found[i] = replace(item, reason=reason)
    return found
