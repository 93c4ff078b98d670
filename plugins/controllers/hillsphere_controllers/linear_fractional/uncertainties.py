r"""Uncertain parameters and blocks, normalised to a norm of at most one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Dispersion
from hillsphere_controllers.uncertain import Parametric, uncertain

__all__ = [
    "Uncertainty",
    "bound_dispersion",
    "corners",
    "physical_values",
    "random_values",
    "real_parameter",
]  # fmt: skip


@dataclass(frozen=True)
class Uncertainty:
    r"""One uncertainty, whose block is normalised to a norm of at most one.

    A real parameter p between bounds is

    .. math::

        p = p_0 + g \frac{\delta}{1 + c\,\delta}, \qquad
        c = \frac{2 p_0 - p_u - p_l}{p_u - p_l}, \quad g = (p_u - p_0)(1 + c),

    so that δ = −1, 0, 1 are its lower bound, nominal value and upper bound; c is zero if the
    nominal value is in the middle.

    Parameters
    ----------
    name : str
        Of the uncertainty; two of one name are one.
    kind : {"real", "complex", "full"}
        A real parameter, a complex number, any matrix.
    rows, columns : int
        Of one copy of its block: 1 but for a full one.
    lower, nominal, upper : float
        Of a real parameter, in its unit.
    dynamic : bool
        Whether the complex number or matrix may be the response of any stable system, and not a
        constant alone.
    covers : bool
        Whether it covers what an approximation left out of the model, see
        `hillsphere_controllers.linear_fractional.left_out`.

    Raises
    ------
    InputError
        If there is no name, sizes do not fit the kind, or the nominal value is not between the
        bounds.
    """

    name: str
    kind: Literal["real", "complex", "full"]
    rows: int = 1
    columns: int = 1
    lower: float = -1.0
    nominal: float = 0.0
    upper: float = 1.0
    dynamic: bool = False
    covers: bool = False

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError("an uncertainty needs a name")
        if self.rows < 1 or self.columns < 1:
            raise InputError(f"{self.name}: a block needs at least one row and one column")
        if self.kind != "full" and (self.rows, self.columns) != (1, 1):
            raise InputError(f"{self.name}: only a full block has more than one row or column")
        ends = (self.lower, self.nominal, self.upper)
        if not (np.isfinite(ends).all() and self.lower < self.nominal < self.upper):
            raise InputError(
                f"{self.name}: the nominal value must lie between finite bounds and be neither of "
                f"them, got {self.lower:.12g} < {self.nominal:.12g} < {self.upper:.12g}"
            )

    @property
    def curvature(self) -> float:
        """Return c."""
        return (2.0 * self.nominal - self.upper - self.lower) / (self.upper - self.lower)

    @property
    def slope(self) -> float:
        """Return g, in the unit of the parameter."""
        return (self.upper - self.nominal) * (1.0 + self.curvature)

    def normalise(self, values: Array) -> Array:
        """Return δ for values of a real parameter."""
        away = np.asarray(values, dtype=float) - self.nominal
        return np.asarray(away / (self.slope - self.curvature * away))

    def physical(self, delta: Array) -> Array:
        """Return the values of a real parameter for δ."""
        small = np.asarray(delta, dtype=float)
        return np.asarray(self.nominal + self.slope * small / (1.0 + self.curvature * small))


def real_parameter(
    name: str, lower: float, upper: float, nominal: float | None = None
) -> Uncertainty:
    """Return an uncertain real parameter; its nominal value is the middle by default.

    Parameters
    ----------
    name : str
        Its name.
    lower, upper : float
        Its bounds.
    nominal : float, optional
        Its nominal value.

    Returns
    -------
    Uncertainty
        The parameter.

    Raises
    ------
    InputError
        If the nominal value is not between the bounds.
    """
    middle = 0.5 * (lower + upper) if nominal is None else nominal
    return Uncertainty(name, "real", lower=lower, nominal=middle, upper=upper)


def bound_dispersion(
    model: Parametric, dispersion: Dispersion, *, sigmas: float = 3.0
) -> tuple[Uncertainty, ...]:
    """Return uncertain parameters with bounds from a dispersion.

    Correlations are ignored: the box of the bounds contains every correlated sample within them.

    Parameters
    ----------
    model : Parametric
        Model whose parameters the dispersion varies.
    dispersion : Dispersion
        How its parameters are distributed.
    sigmas : float
        Distance of the bounds from the mean in standard deviations; cut off at the bounds of the
        distribution.

    Returns
    -------
    tuple of Uncertainty
        In the order in which the dispersion finds them, SI, but for those without any spread;
        nominal is the model's own value if it lies between the bounds, else the mean.

    Raises
    ------
    InputError
        If the model has no such parameter, or a bound is infinite.
    """
    parameters = uncertain(model, dispersion, sigmas=sigmas)
    made = []
    for name, nominal, mean, lower, upper in zip(
        parameters.names,
        parameters.nominal,
        parameters.mean,
        parameters.lower,
        parameters.upper,
        strict=True,
    ):
        if lower == upper:
            continue
        inside = lower < nominal < upper
        made.append(
            real_parameter(name, float(lower), float(upper), float(nominal if inside else mean))
        )
    return tuple(made)


def physical_values(
    uncertainties: Sequence[Uncertainty], normalised: Mapping[str, float]
) -> dict[str, float]:
    """Return normalised values of real parameters, such as a worst case, in their units.

    Parameters
    ----------
    uncertainties : sequence of Uncertainty
        All of an LFT, say.
    normalised : mapping of str to float
        δ by name, as of `WorstCase.values` and `WorstCaseGain.values`.

    Returns
    -------
    dict of str to float
        Values by name, in the parameters' units; NaN beyond the pole of a parameter whose nominal
        value is not in the middle, where no value belongs to δ.

    Raises
    ------
    InputError
        If a name is that of no real parameter.
    """
    known = {one.name: one for one in uncertainties if one.kind == "real"}
    made = {}
    for name, small in normalised.items():
        if name not in known:
            raise InputError(
                f"no real parameter {name!r}; there {'are' if len(known) > 1 else 'is'} "
                f"{', '.join(known) or 'none'}"
            )
        one = known[name]
        sensible = 1.0 + one.curvature * small > 0.0
        made[name] = float(one.physical(np.array(small))) if sensible else np.nan
    return made


def corners(uncertainties: Sequence[Uncertainty]) -> dict[str, Array]:
    """Return all combinations of the bounds of real parameters, by name (2^k,) each.

    Parameters
    ----------
    uncertainties : sequence of Uncertainty
        k real parameters.

    Returns
    -------
    dict of str to ndarray, shape (2^k,)
        Values of each parameter at the corners.

    Raises
    ------
    InputError
        If one of them is not real, or they are more than 20.
    """
    _only_real(uncertainties, "corners")
    if len(uncertainties) > 20:
        raise InputError(f"{len(uncertainties)} parameters have too many corners; draw at random")
    ends = np.array(list(product(*((u.lower, u.upper) for u in uncertainties)))).T
    return {u.name: row for u, row in zip(uncertainties, ends, strict=True)}


def random_values(
    uncertainties: Sequence[Uncertainty], count: int, *, seed: int = 0
) -> dict[str, Array]:
    """Return values to evaluate an LFT at.

    Parameters
    ----------
    uncertainties : sequence of Uncertainty
        Which ones.
    count : int
        How many values of each.
    seed : int
        Of the random numbers.

    Returns
    -------
    dict of str to ndarray
        Real parameters: uniform between their bounds (count,), in their unit. Complex numbers:
        uniform in the unit disc (count,), complex. Full blocks: of norm one, real
        (count, rows, columns).
    """
    random = np.random.default_rng(seed)
    made: dict[str, Array] = {}
    for one in uncertainties:
        if one.kind == "real":
            made[one.name] = random.uniform(one.lower, one.upper, count)
        elif one.kind == "complex":
            angle = random.uniform(0.0, 2.0 * np.pi, count)
            # the root makes the points uniform in area
            made[one.name] = np.sqrt(random.uniform(size=count)) * np.exp(1j * angle)
        else:
            block = random.normal(size=(count, one.rows, one.columns))
            made[one.name] = block / np.linalg.norm(block, 2, axis=(1, 2), keepdims=True)
    return made


def _only_real(uncertainties: Sequence[Uncertainty], what: str) -> None:
    for one in uncertainties:
        if one.kind != "real":
            raise InputError(f"{what} are those of real parameters; {one.name!r} is {one.kind}")
