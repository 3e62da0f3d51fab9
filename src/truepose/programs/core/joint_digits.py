"""The digits of joint targets: their steps, and the texts of joints that change."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.digits import moved, written
from truepose.programs.core.joint_targets import MOST_JOINTS, JointForm


def by_form(columns: TargetColumns) -> Iterator[tuple[JointForm, IntArray]]:
    """Yield the forms of joint targets, each with its rows."""
    kinds, which = columns.shared()
    forms = [kind.joint_form for kind in kinds]
    for form in dict.fromkeys(forms):
        if form is not None:
            yield form, np.flatnonzero(np.array([one == form for one in forms])[which])


def moved_joints(data: bytes, columns: TargetColumns, change: FloatArray) -> FloatArray:
    """Return the numbers of joint targets (n, 6) after they are written moved by `change` (n, 6)."""
    assert columns.joints is not None  # these are joint targets
    after = np.full((len(columns), MOST_JOINTS), np.nan)
    for form, rows in by_form(columns):
        for axis in range(form.count):
            before = columns.joints[rows, axis]
            after[rows, axis] = moved(data, columns.spans[rows, axis], before, change[rows, axis], form.step)
    return after


def written_joints(data: bytes, columns: TargetColumns, after: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the spans (m, 2) of the joints that change from those before to `after` (n, 6), and their texts (m,)."""
    assert columns.joints is not None  # there are joint targets
    spans, texts = [np.empty((0, 2), np.int64)], [np.empty(0, object)]
    for form, rows in by_form(columns):
        for axis in range(form.count):
            old, new = columns.joints[rows, axis], after[rows, axis]
            here = np.flatnonzero(np.isfinite(new) & (new != old))
            spans.append(columns.spans[rows[here], axis])
            found = np.empty(len(here), object)
            found[:] = written(data, spans[-1], old[here], new[here], form.step)
            texts.append(found)
    return np.concatenate(spans), np.concatenate(texts)
