"""The stage ``lft``: uncertain models M-Δ from linear models over their parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Integers
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty, real_parameter
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.lft.fits import (
    Fit,
    certain_lft,
    fit_by_affine,
    fit_by_polynomials,
)
from hillsphere_controllers.stages.lft.parameters import (
    excess_of_bounds,
    group_models,
    uncertain_parameters,
)
from hillsphere_controllers.stages.lft.presentation import present_uncertain_models
from hillsphere_controllers.stages.lft.products import FittedModels
from hillsphere_controllers.stages.lft.specs import LftSpec, UncertainBlockSpec
from hillsphere_controllers.stages.signals import find_signals
from hillsphere_controllers.stages.uncertain import uncertain_model

__all__ = ["LftStage"]

_BEYOND = 1e-9
"""A model's parameter counts as inside its bounds up to this relative rounding of the bounds."""


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
        parameters = uncertain_parameters(models, spec)
        if not (parameters or spec.blocks):
            raise InputError(
                "nothing is uncertain: all parameters of the models are known or have one value "
                "only; vary one, or name blocks"
            )
        others = [uncertain_parameters(models, spec, sigmas) for sigmas in spec.compare_sigmas]
        groups = group_models(models, spec.known)
        advance = ctx.track("uncertain models", len(groups.members))
        fitted: list[Fit] = []
        response_error = np.full(len(models.systems), np.nan)
        for members in groups.members:
            fitted.append(self._fit_members(models, members, parameters, others))
            if spec.fit == "polynomial":
                # an affine fit was compared with all matrices already
                response_error[members] = _response_errors(
                    fitted[-1].lft, models, members, parameters
                )
            advance(1)
        signals = models.systems[0]
        blocks = [_with_blocks(one.lft, signals, spec.blocks, models) for one in fitted]
        units = dict(zip(models.parameters, models.units, strict=True))
        fits = [one.polynomial for one in fitted if one.polynomial is not None]
        count = len(parameters)
        return FittedModels(
            models=tuple(uncertain_model(lft, units) for lft in blocks),
            labels=groups.labels,
            controls=models.controls,
            measurements=models.measurements,
            parameters=tuple(u.name for u in parameters),
            exponents=tuple(
                np.array(list(fit.terms), dtype=np.int64).reshape(-1, count) for fit in fits
            ),
            shares=tuple(np.array(fit.shares) for fit in fits),
            errors=tuple(np.array(fit.errors) for fit in fits),
            left_out_error=np.array([fit.left_out_error for fit in fits]),
            before=np.array([one.before for one in fitted], dtype=np.int64).reshape(
                len(fitted), count
            ),
            after=np.array([one.after for one in fitted], dtype=np.int64).reshape(
                len(fitted), count
            ),
            bound=np.array([one.bound for one in fitted]),
            sampled=np.array([one.sampled for one in fitted]),
            dropped=np.array([one.dropped for one in fitted]),
            truncation_of=spec.truncation_of,
            checks=np.array([one.checks for one in fitted], dtype=np.int64),
            group=groups.group,
            response_error=response_error,
            beyond=excess_of_bounds(models, parameters) if spec.fit == "polynomial" else 0.0,
            tolerance=spec.tolerance,
            known=spec.known,
            known_values=groups.values,
            size_sigmas=np.array(spec.compare_sigmas),
            sizes=np.array([one.sizes for one in fitted], dtype=np.int64).T.reshape(
                len(spec.compare_sigmas), len(fitted)
            ),
        )

    def present(self, product: FittedModels, models: LinearModels) -> Presentation:
        """Show blocks, terms, errors, sizes, and frequency responses with the models' responses."""
        return present_uncertain_models(product, models)

    def _fit_members(
        self,
        models: LinearModels,
        members: Integers,
        parameters: tuple[Uncertainty, ...],
        others: Sequence[tuple[Uncertainty, ...]],
    ) -> Fit:
        systems = [models.systems[int(k)] for k in members]
        if not parameters:
            return certain_lft(systems[0])
        rows = [models.parameters.index(u.name) for u in parameters]
        points = models.values[rows][:, members]
        if self.spec.fit == "affine":
            return fit_by_affine(points, systems, parameters, others, self.spec)
        return fit_by_polynomials(points, systems, parameters, self.spec)


def _response_errors(
    lft: Lft, models: LinearModels, members: Integers, parameters: tuple[Uncertainty, ...]
) -> Array:
    """Return the relative errors of the frequency responses, (members,)."""
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


def _with_blocks(
    lft: Lft, signals: LtiSystem, blocks: Sequence[UncertainBlockSpec], models: LinearModels
) -> Lft:
    """Return the model with its signals' names, some of them closed by further uncertainties."""
    (out, into), s = lft.closed_channels, lft.system
    p, m = lft.shape
    rows: list[int] = []
    columns: list[int] = []
    sizes: list[float] = []
    bends: list[tuple[int, int, float]] = []
    more: list[Uncertainty] = []
    times: list[int] = []
    for k, block in enumerate(blocks):
        of = find_signals(signals.outputs[: p - models.measurements], block.outputs, f"blocks[{k}]")
        to = find_signals(signals.inputs[: m - models.controls], block.inputs, f"blocks[{k}]")
        one, copies = _uncertainty(block, len(to), len(of), f"blocks[{k}]")
        size = 0.5 * (block.upper - block.lower) if block.normalise else 1.0
        if block.nominal is not None:
            # A deviation g δ/(1 + c δ) of z is g w with w = δ (z − c w): see `Uncertainty`.
            size = one.slope
            bends += [(len(rows) + i, len(columns) + i, one.curvature) for i in range(copies)]
        rows += of
        columns += to
        sizes += [size] * len(to)
        more.append(one)
        times.append(copies)
    if len(set(rows)) < len(rows) or len(set(columns)) < len(columns):
        raise InputError("blocks: a signal belongs to two blocks")
    left_rows = [i for i in range(p) if i not in rows]
    left_columns = [j for j in range(m) if j not in columns]
    order = [*range(out), *(out + i for i in (*rows, *left_rows))]
    across = [*range(into), *(into + j for j in (*columns, *left_columns))]
    inner_out, inner_in = _inner_names(lft)
    carried = np.ones(len(across))
    carried[into : into + len(sizes)] = sizes
    d = s.d[np.ix_(order, across)] * carried
    for row, column, curvature in bends:
        # feedback −c of a real block whose nominal value is not in the middle
        d[out + row, into + column] -= curvature
    system = LtiSystem(
        s.a, s.b[:, across] * carried, s.c[order], d, s.dt_s,
        _names(inner_in, signals.inputs, across, into),
        _names(inner_out, signals.outputs, order, out), signals.states,
    )  # fmt: skip
    return replace(
        lft,
        system=system,
        uncertainties=(*lft.uncertainties, *more),
        times=(*lft.times, *times),
    )


def _uncertainty(
    block: UncertainBlockSpec, rows: int, columns: int, key: str
) -> tuple[Uncertainty, int]:
    """Return the uncertainty of a block, and its number of copies."""
    if block.kind == "full":
        return Uncertainty(block.name, "full", rows, columns, dynamic=block.dynamic), 1
    if rows != columns:
        raise InputError(
            f"{key}: a {block.kind} number takes as many outputs as it gives inputs, got {columns} "
            f"and {rows}"
        )
    if block.kind == "real":
        return real_parameter(block.name, block.lower, block.upper, block.nominal), rows
    return Uncertainty(block.name, "complex", dynamic=block.dynamic), rows


def _inner_names(lft: Lft) -> tuple[list[str], list[str]]:
    copies = list(zip(lft.uncertainties, lft.times, strict=True))
    out = [f"{u.name}.z({i})" for u, times in copies for i in range(times * u.columns)]
    return out, [f"{u.name}.w({i})" for u, times in copies for i in range(times * u.rows)]


def _names(
    inner: list[str], outer: tuple[str, ...], order: list[int], count: int
) -> tuple[str, ...]:
    if not outer:
        return ()
    return tuple(inner[k] if k < count else outer[k - count] for k in order)
