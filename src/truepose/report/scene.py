"""The scene of the interactive view of a page: poses, errors before and after, and the arm."""

from __future__ import annotations

import math

from truepose._typing import FloatArray
from truepose.report.arm import rods
from truepose.report.document import View
from truepose.report.evidence import Evidence
from truepose.report.locale import Locale
from truepose.report.plots.figures import magnification


def view(evidence: Evidence, say: Locale) -> View:
    """Return the interactive view of the errors; positions to 0.1 mm, errors to 0.0001 mm, base frame."""
    arm = rods(evidence.error_map)
    words = {key: say(f"view.{key}") for key in ("hint", "pose", "before", "after", "arm", "scale")}
    scene = {
        "p": _rounded(evidence.p, 1),
        "before": _rounded(evidence.before, 4),
        "after": _rounded(evidence.after, 4),
        "arm": None if arm is None else _rounded(arm, 1),
        "decimal": say.decimal,
        "words": words,
    }
    scales = [math.log10(magnification(evidence.p, e)) for e in (evidence.before, evidence.after)]
    return View(scene, say("view.caption"), words, min(scales) - 1, scales[0], max(scales) + 1)


def _rounded(values: FloatArray, digits: int) -> list[list[float]]:
    return [[round(v, digits) for v in row] for row in values.tolist()]
