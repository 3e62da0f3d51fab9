"""Where the prior of registration stands: at the stated base and tool, unless the samples prove others.

The prior of base and tool is wide against what a registration leaves, but not against a tool that is off by hundreds of
millimetres: other parameters would then take what it forbids. So it is moved until the estimate is inside it. What the
samples do not determine stays near the stated base and tool, and no prior is so wide that rounding matters.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors.kinematic.terms import Terms

INSIDE: Final = 1.0
"""The largest estimate, in prior standard deviations, that needs no other centre."""
_MOVES: Final = 50
_SETTLED: Final = 0.01  # prior standard deviations


def placed(terms: Terms, x: FloatArray, e: FloatArray) -> Terms:
    """Return the terms with the prior of base and tool about their estimate by registration alone, if it is outside.

    The registration is that of the nominal arm, robust (least sum of lengths), in steps that the prior limits. What the
    arm's own errors leave counts as if all samples shared it.

    Parameters
    ----------
    terms : Terms
        The terms at the nominal arm.
    x : (n, d) array [rad, …]
        The joints and conditions of the samples.
    e : (n, 3) array [mm], base frame
        The positional errors.
    """
    own, here = terms.placed, terms
    for turn in range(_MOVES):
        design = here.at(x)
        left = e - here.curvature(design)
        size = np.linalg.norm(left, axis=1)
        typical = float(np.median(size)) + np.finfo(float).tiny
        weight = typical / np.maximum(size, typical) / (len(e) * typical**2)
        columns = design.drift[:, :, own]
        matrix = np.einsum("nap,n,nar->pr", columns, weight, columns, optimize=True) + np.eye(len(own))
        step = np.linalg.solve(matrix, np.einsum("nap,n,na->p", columns, weight, left))
        largest = float(np.abs(step).max(initial=0.0))
        if largest < (_SETTLED if turn else INSIDE):
            break
        here = here.centred(here.centre[own] + step * here.prior_std[own])
    return here
