r"""The gap and the ν-gap between two systems.

With graph symbols G = [N; M] and G̃ = [−M̃ Ñ] of normalised coprime factors,

.. math::

    δ_ν(P_1, P_2) = \|\tilde G_2 G_1\|_\infty
    \quad\text{if } \det(G_2^* G_1) \ne 0 \text{ on the axis and its winding number is 0, else } 1

[1]_. The winding number is the number of zeros of G₂* G₁ in the right half-plane less that of its
poles, which are the n₂ poles of G₂*; both follow from a realisation, without a grid. The gap is

.. math::

    δ_g(P_1, P_2) = \max(\vec δ(P_1, P_2), \vec δ(P_2, P_1)), \qquad
    \vec δ(P_1, P_2) = \inf_{Q \in H_\infty} \|G_1 - G_2 Q\|_\infty

[2]_, an H∞ synthesis. The bilinear map keeps both, so that systems in discrete time are compared by
their images.

References
----------
.. [1] G. Vinnicombe (2001), Uncertainty and Feedback, Imperial College Press, section 3.1.
.. [2] T. T. Georgiou (1988), On the computation of the gap metric, Systems & Control Letters 11,
   253-257.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.full_order.coprime import CoprimeFactors, coprime_factors
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.systems.bilinear import continuous

__all__ = ["gap", "nu_gap"]

_SAME = 1e-7
"""Distance of graph symbols below which the gap is this distance: half of the digits of double
precision, the accuracy of the factors."""
_SINGULAR = 1e-12
"""Smallest singular value of the direct term of G₂* G₁, whose entries are one at most, at which it
counts as singular: then it has a zero at infinite frequency."""


def nu_gap(first: LtiSystem, second: LtiSystem) -> float:
    """Return the ν-gap between two systems, from 0 to 1.

    Parameters
    ----------
    first, second : LtiSystem
        P₁ and P₂, of the same numbers of inputs and outputs and the same sampling.

    Raises
    ------
    InputError
        If shapes or sampling periods differ.
    NotStabilisableError
        If a system is not stabilisable or not detectable.
    """
    return _nu_gap(*_factors(first, second))


def gap(first: LtiSystem, second: LtiSystem, *, tolerance: float = 1e-5) -> float:
    """Return the gap between two systems, from 0 to 1, never below the ν-gap.

    Parameters
    ----------
    first, second : LtiSystem
        As of `nu_gap`.
    tolerance : float
        Relative accuracy.

    Raises
    ------
    InputError, NotStabilisableError
        As of `nu_gap`.
    SynthesisFailedError
        If the synthesis does not converge, as `hillsphere_controllers.full_order.hinf`.
    """
    one, other = _factors(first, second)
    away = hinf_norm(one.right - other.right).value
    if away <= _SAME:
        return away
    both = (_directed_gap(one, other, tolerance), _directed_gap(other, one, tolerance))
    # Q = 0 reaches one
    return min(max(both), 1.0)


def _factors(first: LtiSystem, second: LtiSystem) -> tuple[CoprimeFactors, CoprimeFactors]:
    if first.shape != second.shape or first.dt_s != second.dt_s:
        raise InputError(
            "a gap is that of two systems of one shape and one sampling period, got "
            f"{first!r} and {second!r}"
        )
    bare = [replace(s, inputs=(), outputs=(), states=()) for s in (first, second)]
    images = [s if s.dt_s is None else continuous(s) for s in bare]
    return coprime_factors(images[0]), coprime_factors(images[1])


def _nu_gap(one: CoprimeFactors, other: CoprimeFactors) -> float:
    g = other.right
    # G₂*(s) = G₂(−s)ᵀ
    product = LtiSystem(-g.a.T, -g.c.T, g.b.T, g.d.T) @ one.right
    if np.linalg.svd(product.d, compute_uv=False)[-1] <= _SINGULAR:
        return 1.0
    zeros = np.linalg.eigvals(product.a - product.b @ np.linalg.solve(product.d, product.c))
    if np.count_nonzero(zeros.real > 0.0) != g.order:
        return 1.0
    return min(hinf_norm(other.left @ one.right).value, 1.0)


def _directed_gap(one: CoprimeFactors, other: CoprimeFactors, tolerance: float) -> float:
    """Return inf ‖G₁ − G₂ Q‖, by synthesis of u = −Q w for z = G₁ w + G₂ u, y = w."""
    g1, g2 = one.right, other.right
    m, n1, n2 = g1.shape[1], g1.order, g2.order
    plant = LtiSystem(
        np.block([[g1.a, np.zeros((n1, n2))], [np.zeros((n2, n1)), g2.a]]),
        np.block([[g1.b, np.zeros((n1, m))], [np.zeros((n2, m)), g2.b]]),
        np.block([[g1.c, g2.c], [np.zeros((m, n1 + n2))]]),
        np.block([[g1.d, g2.d], [np.eye(m), np.zeros((m, m))]]),
    )
    design = hinf_synthesis(plant, m, m, tolerance=tolerance, regularisation=0.0)
    return min(design.solvable, 1.0)
