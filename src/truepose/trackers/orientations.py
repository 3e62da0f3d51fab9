"""Whether measured orientations turn as the commanded ones do: a wrong order of angles or a wrong unit shows here."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.samples import Samples

_TOLERANCE: Final = np.deg2rad(1.0)
_FEWEST: Final = 4
_READ_AS: Final = "xyz"
_OTHERS: Final = ("ZYX", "XYZ", "zyx")


def check_turns(samples: Samples) -> None:
    """Raise where the turns from pose to pose are not those commanded.

    R_meas = A R_cmd B with the same A (station) and B (tool) at each pose, so the turn R_iᵀ R_{i+1} of the one is that
    of the other seen from another frame: its rotation vectors are turned by B.

    Raises
    ------
    DataError
        With the order of angles that does agree, if one does.
    """
    if samples.rotation_meas is None or samples.rotation_cmd is None or len(samples) < _FEWEST:
        return
    off = _disagreement(samples.rotation_meas, samples.rotation_cmd)
    if off <= _TOLERANCE:
        return
    angles = samples.rotation_meas.as_euler(_READ_AS)
    agreeing = [
        order
        for order in _OTHERS
        if _disagreement(Rotation.from_euler(order, angles), samples.rotation_cmd) <= _TOLERANCE
    ]
    message = f"measured orientations turn otherwise than commanded ones, by {np.rad2deg(off):.3g} deg (median)"
    if agreeing:
        why = f"as {agreeing[0]} they agree: say so in a column mapping (angles={agreeing[0]})"
    else:
        why = "is it this plan, and are the angles what the layout says? Leave them out if in doubt"
    raise samples.error(f"{message}; {why}")


def _disagreement(measured: Rotation, commanded: Rotation) -> float:
    """Return the median difference of the turns from pose to pose, after the best B [rad]."""
    v_measured, v_commanded = ((rotation[:-1].inv() * rotation[1:]).as_rotvec() for rotation in (measured, commanded))
    tool, _ = Rotation.align_vectors(v_measured, v_commanded)
    return float(np.median(np.linalg.norm(v_measured - tool.apply(v_commanded), axis=1)))
