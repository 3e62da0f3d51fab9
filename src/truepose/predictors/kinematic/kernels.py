"""Compute the correlations of (10) and their derivatives by the logarithm of the range.

Joint errors: Matérn 3/2 of the chord between two angles, r = 2 |sin((q − q')/2)| / l, positive definite on the circle.
The rest Z: Matérn 5/2 of r² = Σ_g d_g² / l_g², one range per joint (chord) or for the position.
"""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray


def joint_chord(q: FloatArray, other: FloatArray) -> FloatArray:
    """Return the chords between angles (n,) and (m,) [rad] on the unit circle, (n, m)."""
    return np.asarray(2.0 * np.abs(np.sin(0.5 * (q[:, None] - other))))


def matern32(chord: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Return ρ = (1 + a) exp(−a), a = √3 chord / l, and ∂ρ/∂log l = a² exp(−a)."""
    a = chord * (np.sqrt(3.0) / length)
    decay = np.exp(-a)
    return (1.0 + a) * decay, a * a * decay


def matern52(r_squared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ρ = (1 + a + a²/3) exp(−a), a = √5 r, and −2 ∂ρ/∂(r²) = 5/3 (1 + a) exp(−a).

    With r² = Σ d_g²/l_g² the derivative by log l_g is the second times d_g²/l_g².
    """
    a = np.sqrt(5.0 * np.maximum(r_squared, 0.0))
    decay = np.exp(-a)
    return (1.0 + a + a * a / 3.0) * decay, (5.0 / 3.0) * (1.0 + a) * decay
