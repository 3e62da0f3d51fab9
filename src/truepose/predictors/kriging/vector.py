"""Vector Kriging (9): the components are predicted together, with the covariance between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.kriging.base import estimate_model, given_models, models_from_plain
from truepose.predictors.kriging.cokriging import Cokriging, fit_coregionalisation, floored, given_matrices
from truepose.predictors.kriging.ordinary import UniversalKriging
from truepose.predictors.kriging.system import root
from truepose.predictors.repeats import Points
from truepose.similarity.model import VariogramModel
from truepose.similarity.trend import DriftBasis, DriftLike


class VectorKriging(Predictor):
    """Kriging of all components together: Cov(e_a(P), e_b(P')) = Σ_s B_s,ab C_s(P, P') + R_ab, theory (9).

    With one structure (the intrinsic model), and noise that is diagonal together with B, the Kronecker structure K ⊗ B
    is kept: a linear map makes the components independent, so that one factorisation of n × n and one of k × k are
    enough. Several structures (the linear model of coregionalisation), or noise with different directions at each
    sample, need the system of nk × nk.

    In the intrinsic model without noise of its own the prediction is that of ordinary Kriging, with the addition of the
    covariance between the components. With noise per direction, with several structures, and where components were not
    measured, the components inform each other.

    Parameters
    ----------
    variogram : VariogramModel, str, sequence of VariogramModel, or sequence of str, optional
        The structure; or several models, one for each structure, whose nuggets and sills are units of their B. Names of
        families, and None, stand for one structure, fitted as by `OrdinaryKriging`.
    coregionalisation : (k, k) or (s, k, k) array_like, optional
        The matrix B of each structure. When not given, it is estimated: by generalised least squares for one structure,
        from the cross-variograms for several.
    exact : bool
        Whether the nuggets belong to the error and not to the readings.
    drift
        The drift, as for `UniversalKriging`.
    shared_drift : bool
        Whether the components share the drift's coefficients.

    Attributes
    ----------
    variograms_ : tuple of VariogramModel
        The variogram of each structure.
    coregionalisation_ : (s, k, k) array
        The matrix B of each structure.
    kronecker_ : bool
        Whether the system was kept as K ⊗ B.
    condition_ : float
        The condition number of the covariance matrix (the worst).

    Examples
    --------
    >>> vm = VariogramModel("exponential", sill=1.0, range=100.0)
    >>> model = VectorKriging(vm, [[1.0, 0.5], [0.5, 1.0]]).fit([[0.0], [100.0]], [[1.0, 0.0], [3.0, 1.0]])
    >>> model.predict_covariance([[50.0]]).round(3)
    array([[[0.471, 0.235],
            [0.235, 0.471]]])
    """

    def __init__(
        self,
        variogram: VariogramModel | str | Sequence[VariogramModel] | Sequence[str] | None = None,
        coregionalisation: ArrayLike | None = None,
        exact: bool = False,
        drift: DriftLike = "constant",
        shared_drift: bool = False,
    ) -> None:
        self.variogram = variogram
        self.coregionalisation = coregionalisation
        self.exact = exact
        self.drift = drift
        self.shared_drift = shared_drift

    def fit(
        self, X: ArrayLike, y: ArrayLike, noise_std: ArrayLike | None = None, noise_cov: ArrayLike | None = None
    ) -> Self:
        """Fit the model to samples.

        Parameters
        ----------
        X, y, noise_std
            The arguments of `Predictor.fit`.
        noise_cov : (k, k) or (n, k, k) array_like [mm²], optional
            The covariance of the readings, of all or of each sample, instead of `noise_std`. A component whose variance
            is infinite was not measured; its error is not used.

        Returns
        -------
        self

        Raises
        ------
        DataError
            If shapes disagree, a number is not finite, or a matrix is not a covariance matrix.
        KrigingError
            If the samples do not determine the model.
        """
        if noise_std is not None and noise_cov is not None:
            raise DataError("noise_std cannot be combined with noise_cov; give only one")
        self._given_noise = None if noise_cov is None else np.asarray(noise_cov, dtype=np.float64)
        super().fit(X, y, noise_std)
        del self._given_noise
        return self

    @property
    def condition_(self) -> float:
        """The condition number of the covariance matrix; the worst, if there are several."""
        self._check_fitted()
        return self._inner.condition_ if self._full is None else self._full.system.condition

    def predict_covariance(self, X: ArrayLike, include_nugget: bool = False) -> FloatArray:
        """Return the covariance of the components' errors at each of m targets, (m, k, k) [mm²].

        Its diagonal is the square of `predict`'s standard deviation.
        """
        self._check_fitted()
        return self._covariance(self._validate(X)[0], include_nugget)

    def gradient(self, X: ArrayLike) -> FloatArray:
        """Return the derivative of the prediction by X, (m, k, d) or (m, d)."""
        self._check_fitted()
        x = self._validate(X)[0]
        if self._full is not None:
            slope = self._full.gradient(x)
        else:
            slope = np.einsum("ac,mcd->mad", self._back, self._inner.gradient(x))
        return slope[:, 0] if self._flat else slope

    def simulate(self, X: ArrayLike, size: int = 1, *, rng: np.random.Generator | int = 0) -> FloatArray:
        """Draw random fields given the samples, (size, m, k) or (size, m) [mm]; as for `OrdinaryKriging`."""
        self._check_fitted()
        x = self._validate(X)[0]
        if self._full is not None:
            if size < 1:
                raise KrigingError(f"size is {size}; expected 1 field or more")
            normal = np.random.default_rng(rng).standard_normal((size, len(x) * self._e.shape[1]))
            drawn = normal @ root(self._full.joint_covariance(x)).T
            fields = self._full.mean(x) + drawn.reshape(size, len(x), -1)
        else:
            fields = self._inner.simulate(x, size, rng=rng) @ self._back.T
        return fields[:, :, 0] if self._flat else fields

    # --- fit ----------------------------------------------------------------------------------------------------------

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._e, self._points = e, Points.of(X)
        noise = self._noise_covariance(noise_std)
        self._estimate(X, noise)
        nugget = np.einsum("sab,s->ab", self.coregionalisation_, [m.nugget for m in self.variograms_])
        self._nugget = np.zeros_like(nugget) if self.exact else nugget
        self._reading = noise[:, range(e.shape[1]), range(e.shape[1])] + self._nugget.diagonal()
        turn = None if self.shared_drift or len(self.variograms_) > 1 else self._turn(noise)
        self.kronecker_ = turn is not None
        self._full = None
        if turn is None:
            drift = DriftBasis.of(self.drift, self._points.x)
            self._full = Cokriging(
                X, e, self.variograms_, self.coregionalisation_, drift, self.shared_drift, noise, self.exact
            )
            return
        self._back = np.linalg.inv(turn)
        b = np.einsum("ca,ab,cb->c", turn, self.coregionalisation_[0], turn)
        models = tuple(self.variograms_[0].scaled(max(float(s), 1e-12)) for s in b)
        turned = np.sqrt(np.maximum(np.einsum("ca,nab,cb->nc", turn, noise, turn), 0.0)) if noise.any() else None
        self._inner = UniversalKriging(self.drift, models, self.exact).fit(X, e @ turn.T, turned)
        if not (self.exact or noise.any() or nugget.any()):  # the repeats' scatter stands for the noise
            self._nugget = (self._back * self._inner._nugget) @ self._back.T
            self._reading = self._reading + self._nugget.diagonal()

    def _noise_covariance(self, noise_std: FloatArray | None) -> FloatArray:
        """Return the covariance of each reading, (n, k, k)."""
        n, k = self._e.shape
        given = self._given_noise
        if given is None:
            noise = np.zeros((n, k, k))
            if noise_std is not None:
                noise[:, range(k), range(k)] = noise_std**2
            return noise
        if given.shape not in ((k, k), (n, k, k)):
            raise DataError(f"noise_cov has shape {given.shape}; expected ({k}, {k}) or ({n}, {k}, {k})")
        noise = np.broadcast_to(given, (n, k, k))
        measured = np.isfinite(noise[:, range(k), range(k)])
        known = np.where(measured[:, :, None] & measured[:, None], noise, 0.0)
        bad = np.isnan(noise).any(axis=(1, 2)) | (known != known.transpose(0, 2, 1)).any(axis=(1, 2))
        bad |= np.isinf(known).any(axis=(1, 2))
        if not bad.any():
            bad = np.linalg.eigvalsh(known)[:, 0] < -1e-10 * np.abs(known).max(axis=(1, 2))
        if bad.any():
            raise DataError(
                f"noise_cov of row {np.flatnonzero(bad)[0]} is not symmetric and positive semi-definite "
                f"({bad.sum()} rows in all); use infinity as the variance of a component that was not measured"
            )
        if not measured.any(axis=0).all():
            raise DataError(f"component {np.flatnonzero(~measured.any(axis=0))[0]} was measured nowhere; leave it out")
        return np.asarray(noise)

    def _estimate(self, X: FloatArray, noise: FloatArray) -> None:
        """Set variograms_ and coregionalisation_, as given or fitted."""
        k = self._e.shape[1]
        several = isinstance(self.variogram, Sequence) and not isinstance(self.variogram, str)
        terms = len(cast("Sequence[Any]", self.variogram)) if several else 1
        self.variograms_ = given_models(self.variogram, terms)[:terms]
        if self.coregionalisation is not None:
            if not self.variograms_:
                raise KrigingError("coregionalisation cannot be given without variogram models; give both, or neither")
            self.coregionalisation_ = given_matrices(self.coregionalisation, len(self.variograms_), k)
            return
        if not np.isfinite(noise).all():
            raise KrigingError(
                "components were not measured at some samples; give variogram and coregionalisation then"
            )
        if len(self.variograms_) > 1:
            x = DriftBasis.of(self.drift, self._points.x).coordinates(X)
            self.coregionalisation_ = fit_coregionalisation(x, self._e, self.variograms_)
            return
        mean = np.broadcast_to(np.trace(noise, axis1=1, axis2=2)[:, None] / k, self._e.shape)
        if not self.variograms_:
            drift = DriftBasis.of(self.drift, self._points.x)
            x = drift.coordinates(X)
            self.variograms_ = (estimate_model(self.variogram, x, self._e, drift(X), mean, self._points, self.exact),)
        inner = UniversalKriging(self.drift, self.variograms_[0], self.exact)
        inner.fit(X, self._e, np.sqrt(mean) if mean.any() else None)
        scale = inner._groups[0].system.scale(inner._mean_e) / inner._total[0]
        self.coregionalisation_ = floored(scale)[None]

    def _turn(self, noise: FloatArray) -> FloatArray | None:
        """Return T with T B Tᵀ and T R Tᵀ diagonal for the noise R of every sample; None where there is none."""
        if not np.isfinite(noise).all():
            return None
        b = self.coregionalisation_[0] * (self.variograms_[0].partial_sill + self.variograms_[0].nugget)
        whole = b + noise.mean(axis=0)
        try:
            whiten = np.linalg.inv(np.linalg.cholesky(whole))
        except np.linalg.LinAlgError:
            raise KrigingError(
                "some combination of the components varies neither by coregionalisation nor by noise; give noise, or "
                "leave a component out"
            ) from None
        turn = np.linalg.eigh(whiten @ b @ whiten.T)[1].T @ whiten if noise.any() else whiten
        turned = turn @ noise @ turn.T
        across = np.abs(turned * (1 - np.eye(len(b)))).max()
        return turn if across <= 1e-12 * max(np.abs(turned).max(), np.finfo(float).tiny) else None

    # --- prediction ---------------------------------------------------------------------------------------------------

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        e = self._full.mean(X) if self._full is not None else self._inner.predict(X) @ self._back.T
        if not return_std:
            return e, None
        covariance = self._covariance(X, include_nugget=False)
        return e, np.sqrt(np.maximum(np.einsum("maa->ma", covariance), 0.0))

    def _nugget_variance(self) -> FloatArray:
        return np.asarray(self._nugget.diagonal())

    def _covariance(self, X: FloatArray, include_nugget: bool) -> FloatArray:
        if self._full is not None:
            covariance = self._full.covariance(X)
        else:
            variance = self._inner.predict(X, return_std=True)[1] ** 2
            covariance = np.einsum("ac,mc,bc->mab", self._back, variance, self._back)
        return covariance + self._nugget if include_nugget else covariance

    def _leave_one_out(self) -> LeaveOneOut:
        return self._leave_blocks_out(self._points.inverse)

    def _leave_blocks_out(self, labels: NDArray[Any]) -> LeaveOneOut:
        if self._full is not None:
            residual, variance = self._full.left_out(np.unique(labels, return_inverse=True)[1])
            return LeaveOneOut(residual, np.sqrt(variance))
        inner = self._inner.leave_blocks_out(labels)
        field = inner.std**2 - self._inner._reading
        variance = np.einsum("ac,nc->na", self._back**2, field) + self._reading
        return LeaveOneOut(inner.residual @ self._back.T, np.sqrt(variance))

    def _fitted_parameters(self) -> dict[str, Any]:
        models = tuple(replace(model, fit=None) for model in self.variograms_)
        matrices = tuple(tuple(tuple(row) for row in matrix) for matrix in self.coregionalisation_.tolist())
        return {"variogram": models[0] if len(models) == 1 else models, "coregionalisation": matrices}

    @classmethod
    def _parameter(cls, name: str, value: Any) -> Any:
        return models_from_plain(value) if name == "variogram" else super()._parameter(name, value)
