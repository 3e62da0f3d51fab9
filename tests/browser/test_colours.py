"""Corrected, skipped and refused targets can be told apart by everybody: by shape, by word, and by colour.

The colours are those on the screen, seen with normal sight and through a simulation of protanopia and deuteranopia
(Machado, Oliveira and Fernandes 2009, severity 1). Distances are ΔE of CIE 1976 L*a*b*, where 2.3 is just noticeable.
"""

from __future__ import annotations

import io
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from matplotlib.image import imread, imsave
from tests.browser.opening import Browser, Server

VERDICTS: Final = ("corrected", "unchanged", "skipped", "refused")
SIGHT: Final = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
_XYZ: Final = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
_LEAST: Final = 10.0


def linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def encoded(rgb: np.ndarray) -> np.ndarray:
    rgb = np.clip(rgb, 0, 1)
    return np.where(rgb <= 0.0031308, rgb * 12.92, 1.055 * rgb ** (1 / 2.4) - 0.055)


def seen(srgb: np.ndarray, sight: str) -> np.ndarray:
    """Return sRGB colours (…, 3) as a person with this sight sees them."""
    return encoded(linear(srgb) @ SIGHT[sight].T)


def lab(srgb: np.ndarray) -> np.ndarray:
    t = linear(srgb) @ _XYZ.T / _XYZ.sum(axis=1)
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def pixels(png: bytes) -> np.ndarray:
    return imread(io.BytesIO(png))[..., :3].astype(float)


def inked(picture: np.ndarray) -> np.ndarray:
    """Return the colour of a small picture that is farthest from its corner."""
    flat = picture.reshape(-1, 3)
    return flat[np.argmax(np.linalg.norm(lab(flat) - lab(picture[0, 0]), axis=1))]


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.exhaustive
def test_verdicts_differ_by_shape_word_and_colour(browser: Browser, server: Server, pictures: Path, theme: Any) -> None:
    with browser.opened(server, theme=theme) as app:
        app.go("programs")
        app.page.locator("main a", has_text="panel").first.click()
        legend = app.page.locator("main .legend .mark")
        legend.first.wait_for()
        entries = [legend.filter(has_text=word).first for word in VERDICTS]
        shapes = [entry.locator("path").get_attribute("d") for entry in entries]
        colours = np.array([inked(pixels(entry.locator("svg").screenshot())) for entry in entries])
        page = pixels(app.page.screenshot())
    assert len(set(shapes)) == len(VERDICTS)
    for sight in SIGHT:
        shown = lab(seen(colours, sight))
        for i, j in combinations(range(len(VERDICTS)), 2):
            distance = float(np.linalg.norm(shown[i] - shown[j]))
            assert distance > _LEAST or {i, j} == {1, 2}, (sight, VERDICTS[i], VERDICTS[j], distance)
        imsave(pictures / f"verdicts-{sight}-{theme}.png", seen(page, sight))
