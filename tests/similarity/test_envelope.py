from __future__ import annotations

import json

import numpy as np
import pytest

from truepose.errors import DataError
from truepose.report.plots import plot_variogram
from truepose.similarity import (
    Direction,
    VariogramModel,
    experimental_variogram,
    fit_variogram,
    permutation_envelope,
    verdict,
)


@pytest.fixture
def structured(rng):
    x = rng.random((150, 3)) * 1000
    return x, np.sin(x / 120) + rng.normal(scale=0.2, size=x.shape)


def test_band_is_the_quantiles_of_shuffled_variograms(rng):
    x, e = rng.random((60, 2)), rng.standard_normal((60, 2))
    band = permutation_envelope(x, e, bins=5, permutations=39, rng=7)
    order = np.random.default_rng(7).permuted(np.tile(np.arange(60), (39, 1)), axis=1)
    shuffled = [experimental_variogram(x, e[row], bins=5) for row in order]
    lower, upper = np.quantile([ev.semivariance for ev in shuffled], [0.025, 0.975], axis=0)
    np.testing.assert_allclose(band.lower, lower)
    np.testing.assert_allclose(band.upper, upper)
    np.testing.assert_allclose(band.vector_lower, np.quantile([ev.vector for ev in shuffled], 0.025, axis=0))


@pytest.mark.parametrize("estimator", ["matheron", "cressie", "dowd", "genton"])
def test_band_of_a_direction_and_of_robust_estimators(estimator, rng):
    x, e = rng.random((40, 3)), rng.standard_normal((40, 2))
    along = Direction([1.0, 1.0, 0.0], 0.7, 0.8)
    band = permutation_envelope(x, e, 3, permutations=39, estimator=estimator, direction=along, rng=7)
    order = np.random.default_rng(7).permuted(np.tile(np.arange(40), (39, 1)), axis=1)
    shuffled = [experimental_variogram(x, e[row], 3, estimator=estimator, direction=along) for row in order]
    np.testing.assert_allclose(band.vector_upper, np.quantile([ev.vector for ev in shuffled], 0.975, axis=0))
    np.testing.assert_allclose(band.variogram.vector, experimental_variogram(x, e, 3, None, estimator, along).vector)
    score = [ev.pairs[0] * ev.vector[0] for ev in [band.variogram, *shuffled]]
    assert band.p_value == pytest.approx(np.mean(np.array(score) <= score[0]))


def test_structure_is_found(structured):
    band = permutation_envelope(*structured)
    assert band.structured[:4].all()
    assert band.structured_components[:3].all()
    assert band.p_value == pytest.approx(1 / 200)
    text = verdict(fit_variogram(band.variogram, "best"), band)
    assert text.startswith("Yes, near points have similar errors (p = 0.005)")
    assert "\n" not in text


def test_noise_is_not_structure():
    """Under pure noise the p-value is uniform: of 60 seeds some 3 fall below 0.05."""
    p = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        p.append(permutation_envelope(rng.random((60, 3)), rng.standard_normal((60, 3)), rng=seed).p_value)
    assert sum(value <= 0.05 for value in p) <= 8
    assert 0.35 < np.mean(p) < 0.65


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
def test_verdict_on_noise(rng):
    band = permutation_envelope(rng.random((100, 3)), rng.standard_normal((100, 3)))
    assert verdict(fit_variogram(band.variogram), band).startswith(
        "No, the similarity cannot be distinguished from chance"
    )


def test_same_seed_same_band(structured):
    first, second = permutation_envelope(*structured, rng=3), permutation_envelope(*structured, rng=3)
    np.testing.assert_array_equal(first.vector_lower, second.vector_lower)


def test_refusals(structured):
    with pytest.raises(DataError, match="use at least 39"):
        permutation_envelope(*structured, permutations=10)
    with pytest.raises(DataError, match="level is 1"):
        permutation_envelope(*structured, level=1.0)


@pytest.mark.filterwarnings("ignore::truepose.errors.VariogramWarning")
@pytest.mark.parametrize("component", [None, 1])
def test_picture(structured, component):
    band = permutation_envelope(*structured)
    model = fit_variogram(band.variogram, "spherical", component=component)
    axes = plot_variogram(band.variogram, model, band, component=component, title="Errors").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("distance h [mm]", "semivariance γ(h) [mm²]")
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"spherical", "shuffled, 95 %", "measured (area: pairs)"} <= set(labels)
    assert any("practical range" in text.get_text() for text in axes.texts)


def test_picture_of_several_ranges_and_of_gstools(rng):
    gstools = pytest.importorskip("gstools")
    ev = experimental_variogram(rng.random((60, 3)), rng.standard_normal((60, 3)))
    for model, lines in (
        (VariogramModel("gaussian", nugget=0.1, sill=1.0, range=(3.0, 1.0, 2.0)), 3),
        (gstools.Exponential(dim=3, len_scale=9.0), 1),
    ):
        figure = plot_variogram(ev, model, theory=ev, residual=ev)
        assert len(figure.axes[0].lines) == lines + 1  # and the curve of theory


def test_results_as_text_and_plain_values(rng):
    x = rng.random((60, 2)) * 1000
    band = permutation_envelope(x, np.sin(x / 200), bins=[0.0, 1e-3, 200.0, 400.0])
    text = repr(band)
    assert "\n" not in text
    assert len(text) < 240
    assert text.startswith("Envelope(p = 0.005 of 199 permutations; ")
    assert "ExperimentalVariogram(3 bins, 2 components, " in text
    assert json.loads(json.dumps(band.to_dict()))["variogram"]["pairs"] == band.variogram.pairs.tolist()
    empty = experimental_variogram(x, x, bins=[0.0, 1e-6])
    assert repr(empty) == "ExperimentalVariogram(1 bins, 2 components, 0 pairs, 1 weak bins, matheron)"
