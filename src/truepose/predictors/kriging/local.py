"""Local Kriging: each target from its nearest samples, drift and all (13)."""

from __future__ import annotations

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.predictors.kriging.neighbours import SCALING, Group, NeighbourKriging


class LocalKriging(NeighbourKriging):
    """Ordinary or universal Kriging of each target from its nearest samples, theory (13).

    Near is meant in units of the variogram's ranges. The prediction jumps a little where the neighbours change; the
    standard deviation is that of Kriging from these neighbours. A fitted variogram gets the scale of each component
    from leave-one-out residuals.

    Parameters
    ----------
    neighbours : int
        Nearest samples used for each target.
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        As for `OrdinaryKriging`; a model with a sill.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    drift : {"constant", "linear", "quadratic", "cubic"}, int, sequence of int, or callable
        As for `UniversalKriging`; its coefficients are each target's own.

    Attributes
    ----------
    variogram_ : VariogramModel
        Mean over the components, as given or fitted.
    variograms_ : tuple of VariogramModel
        Of each component.

    Examples
    --------
    >>> from truepose.similarity import VariogramModel
    >>> x = np.arange(100.0)[:, None]
    >>> model = LocalKriging(4, VariogramModel("matern52", sill=1.0, range=20.0)).fit(x, np.sin(x / 10))
    >>> model.predict([[25.5]]).round(3)
    array([[0.558]])
    """

    def _scale(self, group: Group) -> FloatArray:
        u = len(self._points.x)
        some = np.random.default_rng(0).choice(u, min(u, SCALING), replace=False)
        prediction, field = self._left_out(some)
        c = group.components
        variance = field[:, c] + self._mean_noise[np.ix_(some, c)]
        squares = (self._mean_e[np.ix_(some, c)] - prediction[:, c]) ** 2
        return np.asarray(np.mean(squares / np.maximum(variance, np.finfo(float).tiny), axis=0))

    def _combine(self, group: Group, gram: FloatArray, f0: FloatArray) -> tuple[FloatArray, FloatArray]:
        p = f0.shape[1]
        information, unexplained = gram[:, 1 : 1 + p, 1 : 1 + p], f0 - gram[:, 0, 1 : 1 + p]
        try:
            lagrange = np.linalg.solve(information, unexplained[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            raise KrigingError(
                f"near some target {self.neighbours} neighbours cannot tell the {p} columns of the drift; use more "
                "neighbours or a simpler drift"
            ) from None
        mean = gram[:, 0, 1 + p :] + np.einsum("mp,mpc->mc", lagrange, gram[:, 1 : 1 + p, 1 + p :])
        return mean, group.prior - gram[:, 0, 0] + np.einsum("mp,mp->m", unexplained, lagrange)

    def _coefficients(self, group: Group, inverse: FloatArray, near: IntArray) -> FloatArray:
        p = self._basis.shape[1]
        right = group.right[near]
        explained = right[:, :, :p].transpose(0, 2, 1) @ inverse
        return np.asarray(np.linalg.solve(explained @ right[:, :, :p], explained @ right[:, :, p:]))
