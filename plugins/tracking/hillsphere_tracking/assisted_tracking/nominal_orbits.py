"""Nominal orbits of a block of cases: the true orbit with random errors, as mean elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.base.seeds import draws
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter
from hillsphere.interfaces.cases import CaseBatch
from hillsphere_tracking.assisted_tracking.specs import NominalErrorSpec
from hillsphere_tracking.dynamics_brouwer import ZonalField
from hillsphere_tracking.kepler import elements_from_states
from hillsphere_tracking.mean_elements import mean_from_osculating, secular_rates

__all__ = ["NominalOrbits", "error_inputs", "nominal_orbits"]

_SIZES = (
    ("along_track_age", "along_track_age_s", "s"),
    ("position_error", "position_m", "m"),
    ("velocity_error", "velocity_m_s", "m/s"),
)
_DRAWS = 10
"""Normal numbers per case: position (3), velocity (3), sign of the age, then the errors of a, Ω and
M. Another number changes the draws of all cases."""


@dataclass(frozen=True)
class NominalOrbits:
    """Nominal orbits of N cases.

    Parameters
    ----------
    mean, osculating : ndarray, shape (6, N)
        Elements a, e, i, Ω, ω, M (m, rad), TEME.
    """

    mean: Array
    osculating: Array


def error_inputs(spec: NominalErrorSpec) -> tuple[Parameter, ...]:
    """Return the sizes of the errors, as inputs that may differ from case to case."""
    return tuple(Parameter(name, getattr(spec, key), unit) for name, key, unit in _SIZES)


def nominal_orbits(
    spec: NominalErrorSpec, batch: CaseBatch, name: str, true: Array, field: ZonalField
) -> NominalOrbits:
    """Return the nominal orbits with which the trackers begin.

    Parameters
    ----------
    spec : NominalErrorSpec
        Sizes of the errors that the batch does not give.
    batch : CaseBatch
        The N cases; their draws and the name of the pass determine the random numbers.
    name : str
        Name of the pass.
    true : ndarray, shape (6,)
        True state at the acquisition, TEME, m and m/s.
    field : ZonalField
        Gravity field of the planet.

    Returns
    -------
    NominalOrbits
        Elements at the acquisition.

    Raises
    ------
    InputError, ConvergenceError
        If an error is so large that a state is not on an ellipse, or outside the theory's range.
    """
    age, position, velocity = (batch.value(key, getattr(spec, value)) for key, value, _ in _SIZES)
    z = draws(batch.seed, batch.stream, batch.draws, f"nominal error {name}", (_DRAWS,))
    sign = np.where(z < 0.0, -1.0, 1.0)
    error = sign[:6] if spec.distribution == "signs" else z[:6]
    x = true[:, None] + np.concatenate([position * error[:3], velocity * error[3:6]])
    try:
        osculating = elements_from_states(x, field.gm_m3_s2)
    except InputError as error_:
        raise InputError(f"nominal_error: pass {name}: {error_}; make it smaller") from error_
    mean = mean_from_osculating(osculating, field)
    # An along-track error of `age` seconds changes M by its rate; the errors of a, Ω and M add to
    # mean and osculating elements alike, since the short-period terms hardly change.
    early = sign[6] * age * secular_rates(mean, field)[2]
    for elements in (mean, osculating):
        elements[0] += spec.semi_major_axis_sigma_m * z[7]
        elements[3] += spec.node_sigma_rad * z[8]
        elements[5] += early + spec.mean_anomaly_sigma_rad * z[9]
    return NominalOrbits(mean, osculating)
