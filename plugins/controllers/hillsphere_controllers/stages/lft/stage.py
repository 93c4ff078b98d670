"""The stage ``lft``: from models over parameters to an uncertain model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Integers, Parameter
from hillsphere.linear_products import LinearModels
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere.problems import did_you_mean
from hillsphere_controllers.lft.algebra import state_space
from hillsphere_controllers.lft.fitting import PolynomialFit, fitted
from hillsphere_controllers.lft.reduction import Reduced, reduced
from hillsphere_controllers.lft.transformation import Lft
from hillsphere_controllers.lft.uncertainties import Uncertainty, dispersed, real_parameter
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.lft.presentation import presented
from hillsphere_controllers.stages.lft.products import FittedModels
from hillsphere_controllers.stages.lft.specs import LftSpec, UncertainBlockSpec
from hillsphere_controllers.stages.signals import places
from hillsphere_controllers.stages.uncertain import uncertain_model

__all__ = ["LftStage"]

_BEYOND = 1e-9


@dataclass(frozen=True)
class _Parameters:
    """Parameters of linear models, for dispersions."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array

    def parameters(self) -> tuple[Parameter, ...]:
        """Return them."""
        return tuple(
            Parameter(name, float(value), unit)
            for name, value, unit in zip(self.names, self.nominal, self.units, strict=True)
        )


@dataclass(frozen=True)
class _Fit:
    """One uncertain model."""

    lft: Lft
    fit: PolynomialFit | None
    before: Integers
    after: Integers
    bound: float
    sampled: float


class LftStage:
    """Uncertain models of linear ones.

    Parameters
    ----------
    spec : LftSpec
        What is uncertain, and how well it is to be fitted.
    """

    def __init__(self, spec: LftSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context, models: LinearModels) -> FittedModels:
        """Fit, reduce and check the uncertain models.

        Parameters
        ----------
        ctx : Context
            Progress.
        models : LinearModels
            At several values of their parameters.

        Returns
        -------
        FittedModels
            The uncertain models.

        Raises
        ------
        InputError
            If a name is unknown, a bound does not fit, or the models cannot be fitted so well.
        """
        spec = self.spec
        parameters = self._uncertain(models)
        if not (parameters or spec.blocks):
            raise InputError(
                "nothing is uncertain: all parameters of the models are known or have one value "
                "only; vary one, or name blocks"
            )
        groups, labels, group = self._groups(models)
        advance = ctx.track("uncertain models", len(groups))
        found: list[_Fit] = []
        response_error = np.full(len(models.systems), np.nan)
        for members in groups:
            found.append(self._fitted(models, members, parameters))
            response_error[members] = _response_errors(found[-1].lft, models, members, parameters)
            advance(1)
        signals = models.systems[0]
        blocks = [_with_blocks(one.lft, signals, spec.blocks, models) for one in found]
        units = dict(zip(models.parameters, models.units, strict=True))
        fits = [one.fit for one in found if one.fit is not None]
        count = len(parameters)
        return FittedModels(
            models=tuple(uncertain_model(lft, units) for lft in blocks),
            labels=labels,
            controls=models.controls,
            measurements=models.measurements,
            parameters=tuple(u.name for u in parameters),
            exponents=tuple(
                np.array(list(fit.terms), dtype=np.int64).reshape(-1, count) for fit in fits
            ),
            shares=tuple(np.array(fit.shares) for fit in fits),
            errors=tuple(np.array(fit.errors) for fit in fits),
            left_out_error=np.array([fit.left_out_error for fit in fits]),
            before=np.array([one.before for one in found], dtype=np.int64).reshape(
                len(found), count
            ),
            after=np.array([one.after for one in found], dtype=np.int64).reshape(len(found), count),
            bound=np.array([one.bound for one in found]),
            sampled=np.array([one.sampled for one in found]),
            group=group,
            response_error=response_error,
            beyond=_beyond(models, parameters),
            tolerance=spec.tolerance,
        )

    def present(self, product: FittedModels, models: LinearModels) -> Presentation:
        """Show blocks, terms, errors, and frequency responses beside those of the models."""
        return presented(product, models)

    def _uncertain(self, models: LinearModels) -> tuple[Uncertainty, ...]:
        """Return the uncertain parameters with their bounds, in the order of the models."""
        spec = self.spec
        for key, names in (
            ("bounds", [bound.parameter for bound in spec.bounds]),
            ("known", list(spec.known)),
        ):
            for name in names:
                if name not in models.parameters:
                    raise InputError(
                        f"{key}: the models have no parameter {name!r}"
                        f"{did_you_mean(name, models.parameters, otherwise='there are')}"
                    )
        own = _Parameters(models.parameters, models.units, models.nominal)
        bounded = {
            u.name: u
            for ref in spec.dispersions
            for u in dispersed(own, ref.get(), sigmas=spec.sigmas)
        }
        for bound in spec.bounds:
            bounded[bound.parameter] = real_parameter(
                bound.parameter, bound.lower, bound.upper, bound.nominal
            )
        found = []
        for k, name in enumerate(models.parameters):
            low, high = float(models.values[k].min()), float(models.values[k].max())
            if name in spec.known or (low == high and name not in bounded):
                continue
            if low == high:
                raise InputError(
                    f"{name} has bounds, but all models have the same value of it, {low:.6g}; make "
                    "models at several values"
                )
            nominal = float(models.nominal[k])
            inside = low < nominal < high
            found.append(
                bounded.get(name) or real_parameter(name, low, high, nominal if inside else None)
            )
        return tuple(found)

    def _groups(self, models: LinearModels) -> tuple[list[Integers], tuple[str, ...], Integers]:
        """Return the models of each combination of known parameters, names, and all groups."""
        rows = [models.parameters.index(name) for name in self.spec.known]
        if not rows:
            all_models = np.arange(len(models.systems), dtype=np.int64)
            return [all_models], ("uncertain",), np.zeros(len(all_models), dtype=np.int64)
        points, group = np.unique(models.values[rows], axis=1, return_inverse=True)
        group = np.asarray(group, dtype=np.int64).ravel()
        labels = tuple(
            ", ".join(f"{models.parameters[r]}={v:.6g}" for r, v in zip(rows, point, strict=True))
            for point in points.T
        )
        return [np.flatnonzero(group == g) for g in range(points.shape[1])], labels, group

    def _fitted(
        self, models: LinearModels, members: Integers, parameters: tuple[Uncertainty, ...]
    ) -> _Fit:
        spec, first = self.spec, models.systems[int(members[0])]
        samples = np.array([_matrix(models.systems[int(k)]) for k in members])
        if not parameters:
            none = np.zeros(0, dtype=np.int64)
            return _Fit(Lft(first), None, none, none, 0.0, 0.0)
        rows = [models.parameters.index(u.name) for u in parameters]
        fit = fitted(
            models.values[rows][:, members], samples, parameters, degree=spec.degree,
            tolerance=spec.tolerance, most_terms=spec.most_terms,
        )  # fmt: skip
        lft = fit.lft()
        middle = fit(np.array([[u.nominal] for u in parameters]))[0]
        size = float(np.linalg.norm(samples - middle, 2, axis=(1, 2)).max())
        less: Reduced = reduced(lft, spec.reduction * size)
        one = state_space(less.lft, first.order, first.dt_s)
        return _Fit(
            one, fit, _copies(lft, parameters), _copies(less.lft, parameters),
            less.bound / size, less.sampled / size,
        )  # fmt: skip


def _matrix(system: LtiSystem) -> Array:
    return np.block([[system.a, system.b], [system.c, system.d]])


def _copies(lft: Lft, parameters: Sequence[Uncertainty]) -> Integers:
    times = dict(zip((u.name for u in lft.uncertainties), lft.times, strict=True))
    return np.array([times.get(u.name, 0) for u in parameters], dtype=np.int64)


def _response_errors(
    lft: Lft, models: LinearModels, members: Integers, parameters: tuple[Uncertainty, ...]
) -> Array:
    """Return how far the responses are from those of the models, relative, (members,)."""
    omega = frequencies([models.systems[int(k)] for k in members])
    made = np.full(members.size, np.nan)
    kept = {u.name for u in lft.uncertainties}
    for place, k in enumerate(members):
        values = {
            u.name: float(models.values[models.parameters.index(u.name), k]) for u in parameters
        }
        if any(
            not u.lower - _BEYOND * abs(u.lower)
            <= values[u.name]
            <= u.upper + _BEYOND * abs(u.upper)
            for u in parameters
        ):
            continue
        response = models.systems[int(k)].response(omega)
        own = lft.response(omega, {n: v for n, v in values.items() if n in kept})[0]
        largest = float(np.linalg.norm(response, 2, axis=(1, 2)).max())
        apart = float(np.linalg.norm(response - own, 2, axis=(1, 2)).max())
        made[place] = apart / largest if largest > 0.0 else apart
    return made


def _beyond(models: LinearModels, parameters: Sequence[Uncertainty]) -> float:
    """Return by how much bounds reach beyond the models, relative to their range."""
    most = 0.0
    for one in parameters:
        values = models.values[models.parameters.index(one.name)]
        low, high = float(values.min()), float(values.max())
        most = max(most, (low - one.lower) / (high - low), (one.upper - high) / (high - low))
    return most if most > _BEYOND else 0.0


def _with_blocks(
    lft: Lft, signals: LtiSystem, blocks: Sequence[UncertainBlockSpec], models: LinearModels
) -> Lft:
    """Return the model with its signals' names, some of them closed by further uncertainties."""
    (out, into), s = lft.closed_channels, lft.system
    p, m = lft.shape
    rows: list[int] = []
    columns: list[int] = []
    more: list[Uncertainty] = []
    for k, block in enumerate(blocks):
        of = places(signals.outputs[: p - models.measurements], block.outputs, f"blocks[{k}]")
        to = places(signals.inputs[: m - models.controls], block.inputs, f"blocks[{k}]")
        rows += of
        columns += to
        more.append(Uncertainty(block.name, "full", len(to), len(of), dynamic=block.dynamic))
    if len(set(rows)) < len(rows) or len(set(columns)) < len(columns):
        raise InputError("blocks: a signal belongs to two blocks")
    left_rows = [i for i in range(p) if i not in rows]
    left_columns = [j for j in range(m) if j not in columns]
    order = [*range(out), *(out + i for i in (*rows, *left_rows))]
    across = [*range(into), *(into + j for j in (*columns, *left_columns))]
    inner_out, inner_in = _inner_names(lft)
    system = LtiSystem(
        s.a, s.b[:, across], s.c[order], s.d[np.ix_(order, across)], s.dt_s,
        _names(inner_in, signals.inputs, across, into),
        _names(inner_out, signals.outputs, order, out), signals.states,
    )  # fmt: skip
    return replace(
        lft,
        system=system,
        uncertainties=(*lft.uncertainties, *more),
        times=(*lft.times, *(1 for _ in more)),
    )


def _inner_names(lft: Lft) -> tuple[list[str], list[str]]:
    pairs = [
        (f"{u.name}.z({i})", f"{u.name}.w({i})")
        for u, times in zip(lft.uncertainties, lft.times, strict=True)
        for i in range(times)
    ]
    return [out for out, _ in pairs], [into for _, into in pairs]


def _names(
    inner: list[str], outer: tuple[str, ...], order: list[int], count: int
) -> tuple[str, ...]:
    if not outer:
        return ()
    return tuple(inner[k] if k < count else outer[k - count] for k in order)
