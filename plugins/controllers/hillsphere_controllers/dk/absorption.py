r"""Absorption of rational scalings D and G into the plant.

D = Lᴴ L with L and its inverse stable, by a Riccati equation [1]_; D, G and a level β prove that µ
is no larger than β at a frequency just if

.. math::

    (X - jĜ)^\mathsf{H} (X - jĜ) \prec β^2 I + Ĝ^2, \quad X = L M L^{-1}, \;
    Ĝ = L^{-\mathsf{H}} G L^{-1}.

With the normalised coprime factors jĜ/β = N V⁻¹, both stable, NᴴN + VᴴV = I on the axis, that is

.. math::

    \| L M L^{-1} V - β N \| < β,

the norm of a stable system that is linear in M: the way of [2]_. Ĝ itself need not be stable. It is
taken together from what is stable and what is not, jĜ = Σ − Σᴴ + const, where Σ has the states of
L⁻¹: so V costs as many states as L has, and N none.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, sections
   13.4 and 13.7.
.. [2] P. M. Young (1996), Controller design with real parametric uncertainty, International Journal
   of Control 65(3), 469-509.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_sylvester

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.dk.multipliers import Multiplier
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.riccati import stabilising_solution
from hillsphere_controllers.systems.algebra import append, gain, series
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["Factors", "absorb_scalings", "factors"]

_NO_G = 1e-9
"""Size of G's part, relative to R, below which the factor is that of D alone and needs half of the
states."""


@dataclass(frozen=True)
class Factors:
    """Stable systems that scale one block's channels; all n × n of the squared core.

    Parameters
    ----------
    left : LtiSystem
        L.
    right : LtiSystem
        L⁻¹V above N, 2r × r; or L⁻¹ alone, without G.
    copies : tuple of int
        How many times they stand beside each other, on M's outputs and on its inputs.
    """

    left: LtiSystem
    right: LtiSystem
    copies: tuple[int, int]

    @property
    def has_g(self) -> bool:
        """Whether N is there."""
        return self.right.shape[0] > self.left.shape[0]


def factors(multiplier: Multiplier, beta: float) -> Factors:
    """Return the stable factors of one block's D and G for a level β.

    Raises
    ------
    SynthesisFailedError
        If D is not positive at all frequencies.
    """
    a, b, c, d, c_g, d_g = multiplier.system()
    block = multiplier.block
    copies = (block.columns, block.rows) if block.kind == "full" else (1, 1)
    r = d + d.T
    try:
        w: Array = np.asarray(np.linalg.cholesky(r).T, dtype=float)
    except np.linalg.LinAlgError:
        raise SynthesisFailedError("a fitted scaling is not positive at infinity") from None
    feed = np.linalg.solve(r, c)
    # spectral factorisation D = Lᴴ L (Zhou et al. 1996, section 13.4): positive real part, so S +
    # Sᴴ > 0
    x = stabilising_solution(a - b @ feed, -b @ np.linalg.solve(r, b.T), -c.T @ feed)
    if x is None:
        raise SynthesisFailedError("a fitted scaling is not positive at all frequencies")
    c_l: Array = np.linalg.solve(w.T, c + b.T @ x).astype(float)
    left = LtiSystem(a, b, c_l, w)
    # of the inverse; Σ has the same A and B
    b_i: Array = np.linalg.solve(w.T, b.T).T.astype(float)
    a_i = a - b_i @ c_l
    c_i: Array = -np.linalg.solve(w, c_l).astype(float)
    d_i: Array = np.linalg.inv(w).astype(float)
    right = LtiSystem(a_i, b_i, c_i, d_i)
    size = max(np.abs(c_g).max(initial=0.0), np.abs(d_g).max(initial=0.0))
    if size <= _NO_G * np.abs(r).max():
        return Factors(left, right, copies)
    d_z = d_g @ d_i
    c_z = c_g + d_g @ c_i
    # L⁻ᴴ(T L⁻¹) split into a stable and an unstable part
    split = solve_sylvester(a_i.T, a_i, c_i.T @ c_z)
    unstable = c_i.T @ d_z - split @ b_i
    c_s = d_i.T @ c_z - b_i.T @ split - unstable.T
    d_s = d_i.T @ d_z - d_z.T @ d_i
    return Factors(left, _coprime(right, c_s / beta, d_s / beta), copies)


def _coprime(inverse: LtiSystem, c_s: Array, d_s: Array) -> LtiSystem:
    """Return L⁻¹V above N of jĜ/β = Σ − Σᴴ + D, where Σ = (A, B, C, 0) with A and B of L⁻¹."""
    n, r = inverse.b.shape
    none = np.zeros((n, n))
    # −Σ(−s)ᵀ = Bᵀ (s + Aᵀ)⁻¹ Cᵀ
    a = np.block([[inverse.a, none], [none, -inverse.a.T]])
    own = np.hstack([inverse.c, np.zeros((r, n))])
    rows = np.vstack([np.hstack([c_s, inverse.b.T]), own])
    even, _ = balance_states(
        LtiSystem(a, np.vstack([inverse.b, c_s.T]), rows, np.vstack([d_s, inverse.d]))
    )
    a, b, c, own = even.a, even.b, even.c[:r], even.c[r:]
    weight = np.eye(r) + d_s.T @ d_s
    feed = np.linalg.solve(weight, d_s.T @ c)
    back = np.linalg.solve(weight, b.T)
    q = c.T @ (c - d_s @ feed)
    # normalised right coprime factors (section 13.7)
    x = stabilising_solution(a - b @ feed, -b @ back, 0.5 * (q + q.T))
    if x is None:
        raise SynthesisFailedError("a fitted scaling G has no coprime factors")
    f = -(feed + back @ x)
    values, vectors = np.linalg.eigh(weight)
    # inverse symmetric root of I + DᵀD, which normalises the factors
    root = (vectors / np.sqrt(values)) @ vectors.T
    # the states of L⁻¹, driven by V's output, are the first of V's own
    from_v = own + inverse.d @ f
    return LtiSystem(
        a + b @ f,
        b @ root,
        np.vstack([from_v, c + d_s @ f]),
        np.vstack([inverse.d @ root, d_s @ root]),
    )


def absorb_scalings(plant: LtiSystem, scaled: Sequence[Factors], beta: float) -> LtiSystem:
    """Return the plant whose closed loop is L M L⁻¹V − βN; other inputs and outputs stay.

    Parameters
    ----------
    plant : LtiSystem
        Its first outputs and inputs belong to the blocks, in their order.
    scaled : sequence of Factors
        One per block.
    beta : float
        The level that they were made for.
    """
    p, m = plant.shape
    left = append(*[f.left for f in scaled for _ in range(f.copies[0])])
    right = append(*[f.right for f in scaled for _ in range(f.copies[1])])
    (p1, _), (_, m1) = left.shape, right.shape
    # rows of N among the outputs on the right, and the rows of the plant that they belong to
    kept: list[int] = []
    rows: list[int] = []
    places: list[int] = []
    at, place = 0, 0
    for f in scaled:
        size = f.left.shape[0]
        for _ in range(f.copies[1]):
            kept += range(at, at + size)
            at += size
            if f.has_g:
                rows += range(at, at + size)
                places += range(place, place + size)
                at += size
        place += size * f.copies[0]
    through = append(right, gain(np.eye(m - m1)))
    order = [*kept, *range(at, at + m - m1), *rows]
    through = series(through, gain(np.eye(at + m - m1)[order]))
    bare = LtiSystem(plant.a, plant.b, plant.c, plant.d)
    middle = series(through, append(bare, gain(np.eye(len(rows)))))
    after = append(left, gain(np.eye(p - p1 + len(rows))))
    out = np.hstack([np.eye(p), np.zeros((p, len(rows)))])
    out[places, p + np.arange(len(rows))] = -beta
    return series(middle, after, gain(out))
