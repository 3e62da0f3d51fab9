"""Figures: axes that a bin of one pair does not stretch, legends off the data, arrows on their own scale."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.report.locale import load_locale
from truepose.report.plots import figures, plot_variogram
from truepose.report.plots.figures import magnification
from truepose.similarity import VariogramModel, experimental_variogram


@pytest.fixture(scope="module")
def far():
    """Return a variogram whose last bins hold few pairs of a large semivariance."""
    rng = np.random.default_rng(0)
    x = np.r_[rng.uniform(0, 100, size=(60, 1)), [[1000.0]]]
    e = np.r_[rng.normal(size=(60, 1)), [[80.0]]]
    return experimental_variogram(x, e, bins=np.r_[np.linspace(0, 100, 9), np.linspace(900, 1001, 21)])


@pytest.mark.promise("a bin of few pairs does not stretch the axes of a semivariogram")
def test_few_pairs_do_not_stretch_the_axes(far):
    assert far.weak[-1]
    axes = plot_variogram(far).axes[0]
    strong = far.vector[~far.weak]
    assert axes.get_xlim()[1] <= 100.0
    assert strong.max() < axes.get_ylim()[1] < 2 * strong.max()
    outside = next(p for p in axes.collections if "outside" in str(p.get_label()))
    assert (np.asarray(outside.get_offsets()) <= [100.0, axes.get_ylim()[1]]).all()


def test_only_few_pairs_are_drawn_as_they_are():
    ev = experimental_variogram([[0.0], [1.0], [2.0]], [0.0, 1.0, 0.5], bins=2)
    axes = plot_variogram(ev).axes[0]
    assert axes.get_xlim()[1] == ev.edges[-1]
    assert axes.get_ylim()[1] > np.nanmax(ev.vector)


def test_legends_stand_above_the_data(far):
    figure = plot_variogram(far, VariogramModel("spherical", nugget=0.1, sill=1.0, range=50.0))
    axes = figure.axes[0]
    figure.canvas.draw()
    below = axes.get_legend().get_window_extent().y0
    tops = [axes.transData.transform((0.0, far.vector[~far.weak].max()))[1]]
    tops += [axes.transData.transform(line.get_xydata())[:, 1].max() for line in axes.lines[:1]]
    assert below >= max(tops)


@pytest.mark.exhaustive
def test_arrows_have_a_common_scale_and_one_of_their_own():
    rng = np.random.default_rng(1)
    p, e = 1000 * rng.uniform(size=(20, 3)), rng.normal(size=(20, 3))
    assert magnification(p, 0.1 * e) == pytest.approx(10 * magnification(p, e))
    assert magnification(p, np.zeros((20, 3))) == 1.0
    arm = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 800.0], [500.0, 500.0, 900.0]])
    say = load_locale("en")
    with_arm, without = (figures.error_arrows(p, e, 0.1 * e, rods, say) for rods in (arm, None))
    assert figures.LIGHT["arm"] in with_arm
    assert figures.LIGHT["arm"] not in without
