"""What a map knows: parameters, joint curves, ranges, noise, where it is sure and where not, what to measure next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from truepose._io import files
from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.predictors import KinematicKriging
from truepose.predictors.kinematic import JointCurve
from truepose.samples import Poses

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_CANDIDATES: Final = 200
_FEWEST: Final = 2
_STEP: Final = 0.5  # of the way from one sample to another, on which candidates lie
_GREY: Final = "#6b6b6b"
_BLUE: Final = "#1f4e79"
_RED: Final = "#c8442b"


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What a map knows; made by `knowledge`.

    Attributes
    ----------
    error_map : ErrorMap
    noise_mm : float
        Standard deviation of a reading about the predictor's field in each direction, in the mean.
    std_mm : dict
        Length of the deviation of a corrected position (`ErrorMap.predict_errors`) within the sampled region: mean,
        95th percentile, maximum.
    parameters : list of dict
        Drift of kinematic Kriging or parameters of a calibration, estimate ± std; else empty.
    curves : list of JointCurve
        The joints' own errors; empty for predictors that know no joints.
    shares_mm : dict
        Root mean square length of what each term adds to the predictions at the samples.
    hyperparameters : dict
        As the predictor's own `to_dict`, without what belongs to single samples.
    next_poses : list of dict
        What to measure next, the most telling first: joints or position, and the std there before it.
    """

    error_map: ErrorMap
    noise_mm: float
    std_mm: dict[str, float]
    parameters: list[dict[str, Any]]
    curves: list[JointCurve]
    shares_mm: dict[str, float]
    hyperparameters: dict[str, Any]
    next_poses: list[dict[str, Any]]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, units in the names."""
        return {
            "predictor": self.error_map.predictor_name,
            "samples": len(self.error_map.samples),
            "noise_mm": self.noise_mm,
            "std_mm": self.std_mm,
            "shares_mm": self.shares_mm,
            "parameters": self.parameters,
            "joints": [_curve_data(curve) for curve in self.curves],
            "hyperparameters": self.hyperparameters,
            "measure_next": self.next_poses,
        }

    def save_plots(self, folder: str | Path) -> list[Path]:
        """Write the pictures that there are, ``joints.svg`` and ``sure.svg``, to a folder; return their paths."""
        figures = {"joints.svg": self.plot_joints() if self.curves else None, "sure.svg": self.plot_std()}
        contents = {Path(folder) / name: _svg(figure) for name, figure in figures.items() if figure is not None}
        files.write_all(contents)
        return list(contents)

    def plot_joints(self) -> Figure:
        """Return a figure of the joints' error curves [mrad] over their angles [deg]: the gears' signatures.

        With 95 % bands, on one scale for all joints; ticks below are the angles of the samples.
        """
        figure, axes = _grid(len(self.curves))
        q = self.error_map.samples.q
        assert q is not None
        for axis, curve in zip(axes, self.curves, strict=False):
            angle, error, half = np.rad2deg(curve.angle), 1e3 * curve.error, 1.96e3 * curve.std
            axis.fill_between(angle, error - half, error + half, color=_BLUE, alpha=0.2, linewidth=0)
            axis.plot(angle, error, color=_BLUE)
            axis.axhline(0.0, color=_GREY, linewidth=0.6)
            axis.set_title(f"joint {curve.joint + 1}", fontsize=10)
            axis.set_xlabel("angle [deg]")
            axis.set_ylabel("error [mrad]")
        limit = 1.05 * max(float(np.max(np.abs(c.error) + 1.96 * c.std)) for c in self.curves) * 1e3
        for axis, curve in zip(axes, self.curves, strict=False):
            axis.set_ylim(-limit, limit)
            sampled = np.rad2deg(q[:, curve.joint])
            axis.plot(sampled, np.full(len(sampled), -limit), "|", color=_GREY, markersize=6, clip_on=False)
        return figure

    def plot_std(self) -> Figure | None:
        """Return a figure of the predicted std [mm] on planes through the middle of the region, None without any."""
        from truepose.report.region import planes

        found = planes(self.error_map)
        if not found:
            return None
        figure, axes = _grid(len(found))
        highest = max(float(np.nanmax(plane.std)) for plane in found)
        for axis, plane in zip(axes, found, strict=False):
            drawn = axis.pcolormesh(
                plane.u, plane.v, plane.std, vmin=0.0, vmax=highest, cmap="viridis", rasterized=True
            )
            axis.plot(*self.error_map.p_cmd[:, [plane.i, plane.j]].T, ".", color="white", markersize=2.5)
            axis.set_xlabel(f"{'xyz'[plane.i]} [mm]")
            axis.set_ylabel(f"{'xyz'[plane.j]} [mm]")
            axis.set_aspect("equal")
        figure.colorbar(drawn, ax=axes, label="predicted std (length) [mm]")
        return figure


def knowledge(error_map: ErrorMap, *, suggestions: int = 5, rng: int = 0) -> Knowledge:
    """Return what a map knows.

    Parameters
    ----------
    error_map : ErrorMap
    suggestions : int
        How many poses to measure next.
    rng : int
        For candidates within the sampled region.
    """
    model = error_map.predictor
    samples = error_map.samples
    candidates = _between_samples(error_map, np.random.default_rng(rng))
    size = np.linalg.norm(error_map.predict_errors(candidates)[1], axis=1)
    curves, shares = [], {}
    if isinstance(model, KinematicKriging):
        curves = model.joint_curves()
        parts = model.explain(error_map.coordinates(samples))
        shares = {name: float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for name, e in parts.items()}
    values = {name: value for name, value in model.to_dict().items() if name not in ("weight", "identified")}
    return Knowledge(
        error_map,
        noise_mm=float(np.sqrt(np.mean(_about_field(error_map)))),
        std_mm={"mean": float(size.mean()), "p95": float(np.quantile(size, 0.95)), "max": float(size.max())},
        parameters=list(getattr(model, "parameters_", [])),
        curves=curves,
        shares_mm=shares,
        hyperparameters=values,
        next_poses=_measure_next(error_map, candidates, suggestions),
    )


def _between_samples(error_map: ErrorMap, rng: np.random.Generator) -> Poses:
    """Return configurations between pairs of samples: within the sampled region, in the predictor's own coordinates."""
    x = error_map.coordinates(error_map.samples)
    first, second = rng.integers(len(x), size=(2, _CANDIDATES))
    between = x[first] + rng.uniform(0.0, _STEP, (_CANDIDATES, 1)) * (x[second] - x[first])
    return Poses(q=between) if error_map.space == "joint" else Poses(p_cmd=between)


def _about_field(error_map: ErrorMap) -> FloatArray:
    """Return the variance of readings of the samples about the predictor's field, (n, 3) [mm²]."""
    samples = error_map.samples
    (_, noisy), (_, std) = error_map.predict_reading(samples), error_map.predict_errors(samples)
    return np.asarray(noisy**2 - std**2 + error_map.unexplained)


def _measure_next(error_map: ErrorMap, candidates: Poses, count: int) -> list[dict[str, Any]]:
    """Choose greedily the candidate that lowers the variance over all candidates most, given those chosen before.

    The error at candidate i with noise R is taken as read; what that tells of all others follows from their covariance
    with it: Σ_ab C_·i (C_ii + R)⁻¹ C_i·. Without that covariance the most uncertain candidates are named.
    """
    together: Callable[..., Any] | None = getattr(error_map.predictor, "predict_together", None)
    _, std = error_map.predict_errors(candidates)
    size = np.linalg.norm(std, axis=1)
    if together is None or error_map.p_flange_sampled is not None:
        chosen = np.argsort(-size)[:count].tolist()
        return [_pose_data(candidates, i, size[i]) for i in chosen]
    _, covariance = together(error_map.coordinates(candidates))
    noise, beyond = np.mean(_about_field(error_map)), float(error_map.unexplained.sum())
    n, found = len(size), []
    for _ in range(count):
        own = np.einsum("iaib->iab", covariance.reshape(n, 3, n, 3))
        rows = covariance.reshape(n, 3, 3 * n)
        told = np.linalg.solve(np.linalg.cholesky(own + noise * np.eye(3)), rows)
        best = int(np.argmax(np.einsum("nak,nak->n", told, told)))
        found.append(_pose_data(candidates, best, float(np.sqrt(np.trace(own[best]) + beyond))))
        covariance = covariance - told[best].T @ told[best]
    return found


def _pose_data(candidates: Poses, i: int, std: float) -> dict[str, Any]:
    if candidates.q is not None:
        place = {f"q{j + 1}_deg": round(float(angle), 2) for j, angle in enumerate(np.rad2deg(candidates.q[i]))}
    else:
        assert candidates.p_cmd is not None
        place = {f"{axis}_mm": round(float(value), 1) for axis, value in zip("xyz", candidates.p_cmd[i], strict=True)}
    return {**place, "std_mm": float(std)}


def _curve_data(curve: JointCurve) -> dict[str, Any]:
    return {
        "joint": curve.joint + 1,
        "angle_deg": np.rad2deg(curve.angle).tolist(),
        "error_mrad": (1e3 * curve.error).tolist(),
        "std_mrad": (1e3 * curve.std).tolist(),
        "rms_mrad": float(1e3 * np.sqrt(np.mean(curve.error**2))),
    }


def _grid(count: int) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    columns = min(3, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(3.6 * columns + 1.0, 2.9 * rows), layout="constrained")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False)).reshape(-1)
    for unused in axes[count:]:
        unused.remove()
    return figure, axes[:count]


def _svg(figure: Figure) -> bytes:
    import io

    import matplotlib as mpl

    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "truepose", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
