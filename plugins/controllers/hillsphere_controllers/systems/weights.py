r"""Weights given by their gains at low and high frequency and their crossover.

.. math::

    W(s) = \left( \frac{h s + l p}{s + p} \right)^N, \qquad
    p = ω \sqrt{\frac{g^2 - h^2}{l^2 - g^2}}

has the gain :math:`l^N` at zero frequency, :math:`h^N` at infinity and :math:`g^N` at ω.
"""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import append, series
from hillsphere_controllers.systems.bilinear import discrete

__all__ = ["on_every_channel", "performance_weight", "shelving_weight"]


def shelving_weight(
    low: float,
    high: float,
    frequency_rad_s: float,
    gain: float = 1.0,
    *,
    order: int = 1,
    dt_s: float | None = None,
) -> LtiSystem:
    """Return a weight from one gain at low to another at high frequency.

    Arguments and meaning are those of MATLAB's ``makeweight(low, [frequency, gain], high)``.

    Parameters
    ----------
    low, high : float
        Gains at zero frequency and at infinity (or at π/dt), ≥ 0.
    frequency_rad_s, gain : float
        A frequency and the gain there, which must lie between the two others.
    order : int
        Power N: so many equal poles. The three gains are those of the whole weight.
    dt_s : float or None
        Sampling period, s; the three gains are then met by the discrete weight.

    Returns
    -------
    LtiSystem
        Of one input and output, stable, with stable inverse if `low` and `high` are not zero.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    if not (np.isfinite([low, high]).all() and low >= 0.0 and high >= 0.0):
        raise InputError(
            f"gains must be finite and ≥ 0, got low {low}, high {high}; for an integrator take a "
            "low gain of 1e4, say: no controller stabilises a weight with its pole on the axis"
        )
    if not min(low, high) < gain < max(low, high):
        raise InputError(
            f"the gain at the frequency must lie between low ({low}) and high ({high}), got {gain}"
        )
    if not (np.isfinite(frequency_rad_s) and frequency_rad_s > 0.0):
        raise InputError(f"a frequency must be > 0 rad/s, got {frequency_rad_s}")
    if order < 1:
        raise InputError(f"an order must be ≥ 1, got {order}")
    omega = frequency_rad_s
    if dt_s is not None:
        if not 0.0 < omega * dt_s < np.pi:
            raise InputError(
                f"{omega} rad/s is not below half the sampling rate, {np.pi / dt_s:.6g} rad/s"
            )
        omega = 2.0 / dt_s * np.tan(0.5 * omega * dt_s)
    # gains of one section: at zero, at infinite and at the given frequency
    start, end, middle = (float(x) ** (1.0 / order) for x in (low, high, gain))
    # (g − h)(g + h) keeps the digits of g² − h²
    p = omega * np.sqrt((middle - end) * (middle + end) / ((start - middle) * (start + middle)))
    size = np.sqrt(p * abs(start - end))
    section = LtiSystem(
        np.array([[-p]]), np.array([[size]]), np.array([[np.copysign(size, start - end)]]),
        np.array([[end]]),
    )  # fmt: skip
    made = series(*[section] * order)
    return made if dt_s is None else discrete(made, dt_s)


def performance_weight(
    bandwidth_rad_s: float, peak: float = 2.0, steady_error: float = 1e-4, *, order: int = 1
) -> LtiSystem:
    r"""Return the weight of the sensitivity of Skogestad and Postlethwaite [1]_.

    .. math::

        W_P(s) = \frac{(s / M^{1/n} + ω_B)^n}{(s + ω_B A^{1/n})^n}

    Parameters
    ----------
    bandwidth_rad_s : float
        ω_B: where the asymptote of 1/\|W\| crosses one.
    peak : float
        M, the most that 1/\|W\| allows at high frequency.
    steady_error : float
        A, the most that it allows at zero frequency.
    order : int
        n, the slope of 1/\|W\| below the bandwidth.

    Returns
    -------
    LtiSystem
        W_P, one input and one output.

    Raises
    ------
    InputError
        If a number is out of range.

    References
    ----------
    .. [1] S. Skogestad, I. Postlethwaite (2005), Multivariable Feedback Control, 2nd edition,
       Wiley, section 2.8.
    """
    if not (np.isfinite(bandwidth_rad_s) and bandwidth_rad_s > 0.0):
        raise InputError(f"a bandwidth must be > 0 rad/s, got {bandwidth_rad_s}")
    if not 0.0 < steady_error < peak < np.inf:
        raise InputError(
            f"0 < steady_error < peak is needed, got {steady_error} and {peak}; an error of zero "
            "would put a pole on the axis that no controller moves"
        )
    if order < 1:
        raise InputError(f"an order must be ≥ 1, got {order}")
    m, a = peak ** (1.0 / order), steady_error ** (1.0 / order)
    size = np.sqrt(bandwidth_rad_s * (1.0 - a / m))
    section = LtiSystem(
        np.array([[-bandwidth_rad_s * a]]), np.array([[size]]), np.array([[size]]),
        np.array([[1.0 / m]]),
    )  # fmt: skip
    return series(*[section] * order)


def on_every_channel(weight: LtiSystem, channels: int) -> LtiSystem:
    """Return W I of a weight of one input and output.

    Parameters
    ----------
    weight : LtiSystem
        W, of one input and one output.
    channels : int
        Number of channels.

    Returns
    -------
    LtiSystem
        W on the diagonal.

    Raises
    ------
    InputError
        If the weight has more, or there is no channel.
    """
    if weight.shape != (1, 1) or channels < 1:
        raise InputError(
            f"a weight of 1 × 1 on one or more channels is needed, got {weight.shape[0]} × "
            f"{weight.shape[1]} on {channels}"
        )
    bare = LtiSystem(weight.a, weight.b, weight.c, weight.d, weight.dt_s)
    return append(*[bare] * channels)
