"""`truepose.plot`: a picture of every result, with the numbers of the result in it."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

import truepose as tp
from truepose.errors import DataError


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=3)


@pytest.fixture(scope="module")
def error_map(virtual: tp.VirtualCell) -> tp.ErrorMap:
    return tp.fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "ordinary-kriging")


def test_variograms(rng: np.random.Generator) -> None:
    x, e = rng.uniform(0, 1000, (60, 3)), rng.normal(size=(60, 3))
    ev = tp.experimental_variogram(x, e, bins=8)
    model = tp.VariogramModel("spherical", nugget=0.5, sill=1.0, range=300.0)
    assert len(tp.plot(ev, model=model).axes[0].lines) > len(tp.plot(ev).axes[0].lines)
    [axes] = tp.plot(model, unit="rad", longest=500.0).axes
    assert (axes.get_xlabel(), axes.get_xlim()) == ("distance h [rad]", (0.0, 500.0))
    assert axes.lines[0].get_ydata()[-1] == pytest.approx(1.5)
    several = tp.VariogramModel("spherical", sill=1.0, range=(300.0, 200.0, 100.0))
    assert len(tp.plot(several).axes[0].lines) == 4
    assert tp.plot(tp.permutation_envelope(x, e, 8, permutations=99, rng=0)).axes[0].collections
    joints = tp.experimental_variogram(rng.uniform(-1, 1, (60, 6)), e, bins=8)
    assert tp.plot(joints).axes[0].get_xlabel() == "distance h [rad]"
    assert tp.plot(joints, unit="mm").axes[0].get_xlabel() == "distance h [mm]"


@pytest.mark.exhaustive
def test_sections_through_the_error_field(error_map: tp.ErrorMap) -> None:
    assert len(tp.plot(error_map).axes) == 8  # three planes, twice, and two colour bars
    upper = tp.plot(error_map).axes[:3]
    seen = [(axes.get_xlabel()[0], axes.get_ylabel()[0], axes.get_title()[3]) for axes in upper]
    assert seen == [("x", "y", "z"), ("x", "z", "y"), ("y", "z", "x")]
    for axes, (i, j) in zip(upper, ((0, 1), (0, 2), (1, 2)), strict=True):
        edges = axes.collections[0].get_coordinates()
        inside = error_map.p_cmd[:, [i, j]]
        assert (edges.reshape(-1, 2).min(axis=0) <= inside.min(axis=0)).all()
        assert (edges.reshape(-1, 2).max(axis=0) >= inside.max(axis=0)).all()
    model = tp.OrdinaryKriging(tp.VariogramModel("exponential", sill=1.0, range=300.0))
    with pytest.raises(DataError, match="needs a OrdinaryKriging that was fitted to positions"):
        tp.plot(model)
    figure = tp.plot(model.fit(error_map.p_cmd, error_map.e))
    mesh = figure.axes[0].collections[0]
    middle = (error_map.p_cmd.min(axis=0) + error_map.p_cmd.max(axis=0)) / 2
    expected = np.linalg.norm(model.predict(middle[None]))
    assert np.asarray(mesh.get_array()).reshape(41, 41)[20, 20] == pytest.approx(expected)


def test_predictions_and_corrections(virtual: tp.VirtualCell, error_map: tp.ErrorMap) -> None:
    found = error_map.predict(virtual.design(5, seed=1))
    assert len(tp.plot(found).axes[0].containers) == 3
    commands = error_map.correct(virtual.design(5, seed=1), accept_weak_map=True)
    labels = {text.get_text() for text in tp.plot(commands).axes[0].get_legend().get_texts()}
    assert labels == set(commands.verdict)


def test_validation(virtual: tp.VirtualCell, error_map: tp.ErrorMap) -> None:
    result = error_map.validate(virtual.measure(virtual.design(25, seed=1)))
    parity, spread, share = tp.plot(result).axes
    assert [axes.get_title() for axes in (parity, spread, share)] == [
        "Parity",
        "Std against residual",
        "Before and after",
    ]
    ends = share.lines[1].get_xdata()[-1], share.lines[1].get_ydata()[-1]
    assert ends == pytest.approx((result["after"]["max_mm"], 100.0))


def test_choice_and_figures_of_ones_own(virtual: tp.VirtualCell) -> None:
    choice = tp.choose(["registration", "idw"], virtual.measure(virtual.design(40)), virtual.cell)
    figure = plt.figure()
    assert tp.plot(choice, figure=figure) is figure
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["registration", "idw"]
    plt.close(figure)
    assert tp.plot(choice)._repr_html_().startswith('<img alt="" src="data:image/png;base64,')


def test_no_picture() -> None:
    with pytest.raises(DataError, match=r"there is no picture of list; truepose\.plot draws Choice, Corrections"):
        tp.plot([1, 2])
