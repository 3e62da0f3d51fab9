"""Colours of pictures remain distinct for readers with deuteranopia, in the light and in the dark scheme."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from truepose.report.plots.palette import COLOURS, CURVES, DARK, LIGHT, MARKERS, adaptive

DEUTERANOPIA = np.array(  # Machado, Oliveira & Fernandes 2009, severity 1.0, linear RGB
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = np.array([0.95047, 1.0, 1.08883])


def _linear(colour: str) -> np.ndarray:
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def _lab(linear: np.ndarray) -> np.ndarray:
    t = XYZ @ np.clip(linear, 0, 1) / WHITE
    x, y, z = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def ciede2000(one: np.ndarray, other: np.ndarray) -> float:
    """Return the colour difference of two CIELAB colours (Sharma, Wu & Dalal 2005)."""
    (l1, a1, b1), (l2, a2, b2) = one, other
    mean = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    stretch = 1.5 - 0.5 * np.sqrt(mean**7 / (mean**7 + 25.0**7))
    c1, c2 = np.hypot(stretch * a1, b1), np.hypot(stretch * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, stretch * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180) % 360 - 180 if c1 * c2 else 0.0
    hue = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2))
    light, c = (l1 + l2) / 2, (c1 + c2) / 2
    h = (h1 + turn / 2) % 360 if c1 * c2 else h1 + h2
    waves = ((-0.17, 1, -30), (0.24, 2, 0), (0.32, 3, 6), (-0.20, 4, -63))
    t = 1 + sum(size * np.cos(np.radians(k * h + shift)) for size, k, shift in waves)
    s_l = 1 + 0.015 * (light - 50) ** 2 / np.sqrt(20 + (light - 50) ** 2)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t
    r = -2 * np.sqrt(c**7 / (c**7 + 25.0**7)) * np.sin(np.radians(60 * np.exp(-(((h - 275) / 25) ** 2))))
    parts = ((l2 - l1) / s_l, (c2 - c1) / s_c, hue / s_h)
    return float(np.sqrt(sum(part**2 for part in parts) + r * parts[1] * parts[2]))


def seen(one: str, other: str) -> float:
    return ciede2000(*(_lab(DEUTERANOPIA @ _linear(colour)) for colour in (one, other)))


def test_ciede2000_of_the_published_pairs():
    for one, other, difference in (
        ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
        ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
        ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
    ):
        assert ciede2000(np.array(one), np.array(other)) == pytest.approx(difference, abs=1e-4)


@pytest.mark.promise("colours that stand in one picture differ by 20 or more (CIEDE2000) for readers with deuteranopia")
@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
def test_pairs_of_one_picture_remain_distinct(scheme):
    pairs = [("before", "after"), *combinations(("point", "model", "theory"), 2), ("after", "arm"), ("weak", "model")]
    found = {pair: seen(*(scheme[name] for name in pair)) for pair in pairs}
    assert min(found.values()) >= 20, found
    on_paper = {name: seen(scheme[name], scheme["paper"]) for name in COLOURS.values() if name not in ("weak", "band")}
    assert min(on_paper.values()) >= 25, on_paper


def test_curves_remain_distinct():
    found = {pair: seen(*pair) for pair in combinations(CURVES, 2)}
    assert min(found.values()) >= 20, found
    assert len(set(MARKERS)) == len(CURVES)


def test_a_picture_follows_the_readers_scheme():
    svg = adaptive('<?xml version="1.0"?>\n<svg width="9">\n<path style="stroke: #1c2430"/></svg>')
    assert svg.startswith('<?xml version="1.0"?>\n<svg width="9">\n<style>@media (prefers-color-scheme: dark){')
    assert f'[style*="stroke: {LIGHT["ink"]}"]{{stroke:{DARK["ink"]}!important}}' in svg
    assert LIGHT.keys() == DARK.keys()
