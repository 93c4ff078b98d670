"""Carlson's symmetric elliptic integrals R_F and R_D as expressions.

R_F(x, y, z) = ½ ∫₀^∞ ds / √((s+x)(s+y)(s+z)) and
R_D(x, y; z) = ³⁄₂ ∫₀^∞ ds / ((s+z) √((s+x)(s+y)(s+z))), both by Carlson's duplication theorem [1]_:
each step brings the arguments four times nearer together, then a series in their differences
finishes. R_F and all three R_D of one triple share their square roots, one division per step, and
the coefficients of their series.

References
----------
.. [1] B. C. Carlson (1995), Numerical computation of real or complex elliptic integrals,
   Numerical Algorithms 10, 13–26, algorithms for R_F and R_D.
.. [2] B. C. Carlson (1979), Computing elliptic integrals by duplication, Numerische Mathematik 33,
   1–16, section 3: the series of an R function about the mean of its arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt as sqrt_of

from hillsphere.symbolic import Expr, Vec3, constant, sqrt, sum_of

__all__ = ["MOST_DUPLICATIONS", "carlson_rf_rd", "duplications_for"]

MOST_DUPLICATIONS = 5
"""For arguments that are not known, since an expression has no loop to end: enough up to ratios of
200 (a body of 14:1). At 1e4 (100:1) the series neglects 1e-15."""
_REACH = 0.01
"""Largest spread δ of the arguments of the series: what it neglects is below 0.2 δ⁸, 2e-17."""


def duplications_for(arguments: Sequence[float]) -> int:
    """Return the number of duplications that three positive arguments need.

    Parameters
    ----------
    arguments : sequence of float
        x, y, z > 0. A common amount that is added to all of them brings them nearer together and
        needs no more.

    Returns
    -------
    int
        Their number.
    """
    x, count = list(arguments), 0
    while True:
        mean = sum(x) / 3.0
        if max(abs(one - mean) for one in x) <= _REACH * mean:
            return count
        r = [sqrt_of(one) for one in x]
        shift = r[0] * r[1] + r[1] * r[2] + r[2] * r[0]
        x, count = [0.25 * (one + shift) for one in x], count + 1


def carlson_rf_rd(arguments: Vec3, duplications: int = MOST_DUPLICATIONS) -> tuple[Expr, Vec3]:
    """Return R_F of three positive arguments, and R_D with each of them as the last one.

    Parameters
    ----------
    arguments : Vec3
        x, y, z > 0.
    duplications : int
        Number of duplications, of `duplications_for` if the arguments' ratios are known.

    Returns
    -------
    rf : Expr
        R_F(x, y, z).
    rd : Vec3
        R_D(y, z; x), R_D(z, x; y), R_D(x, y; z).
    """
    x = arguments
    sums: tuple[list[Expr], list[Expr], list[Expr]] = ([], [], [])
    quarter_power = 1.0
    for _ in range(duplications):
        # x → (x + λ)/4 with λ = √x√y + √y√z + √z√x leaves R_F unchanged, and
        # x + λ = (√x + √y)(√x + √z).
        r = (sqrt(x[0]), sqrt(x[1]), sqrt(x[2]))
        pair = (r[1] + r[2], r[2] + r[0], r[0] + r[1])
        # R_D(·; z) = 3/(√z (z + λ)) + ¼ R_D of the new arguments, DLMF eq. 19.26.20, whose three
        # quotients have one common denominator √x√y√z (√x + √y)(√y + √z)(√z + √x).
        inverse = constant(quarter_power) / (r[0] * r[1] * r[2] * (pair[0] * pair[1] * pair[2]))
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            sums[i].append(inverse * (r[j] * r[k] * pair[i]))
        x = (0.25 * pair[1] * pair[2], 0.25 * pair[2] * pair[0], 0.25 * pair[0] * pair[1])
        quarter_power *= 0.25
    rf, rd = _series(x)
    total = [3.0 * sum_of([*sums[i], quarter_power / 3.0 * rd[i]]) for i in range(3)]
    return rf, (total[0], total[1], total[2])


def _series(x: Vec3) -> tuple[Expr, Vec3]:
    r"""Return R_F and the three R_D of nearly equal arguments, to seventh order.

    With the mean A and Z = 1 − x/A of each argument [2]_, eq. 3.6::

        R_F = A^(−1/2) Σ_N g_N / (1 + 2N),
        R_D(·; z) = A^(−3/2) Σ_N 3/(3 + 2N) Σ_m g_(N−m) Z^m,

    where g_N are the coefficients of t^N in Π (1 − t Z)^(−1/2) = (1 + E₂t² − E₃t³)^(−1/2).
    """
    mean = (x[0] + x[1] + x[2]) / 3.0
    inverse = 1.0 / mean
    z = [(mean - e) * inverse for e in x]
    # elementary symmetric functions of the Z, whose sum is zero
    e2, e3 = z[0] * z[1] - z[2] * z[2], z[0] * z[1] * z[2]
    # (1 + s)^(−1/2) = 1 − s/2 + 3s²/8 − 5s³/16 + …, s = E₂t² − E₃t³
    square = e2 * e2
    g: list[Expr] = [
        constant(1.0),
        constant(0.0),
        -0.5 * e2,
        0.5 * e3,
        0.375 * square,
        -0.75 * (e2 * e3),
        0.375 * (e3 * e3) - 0.3125 * (square * e2),
        0.9375 * (square * e3),
    ]
    order = len(g) - 1
    root = sqrt(inverse)
    rf = root * sum_of([1.0 / (1 + 2 * n) * g[n] for n in range(order + 1)])
    powers = [
        sum_of([3.0 / (3 + 2 * (n + m)) * g[n] for n in range(order + 1 - m)])
        for m in range(order + 1)
    ]
    rd = []
    for one in z:
        total = powers[order]
        for coefficient in reversed(powers[:order]):
            total = coefficient + one * total
        rd.append(root * inverse * total)
    return rf, (rd[0], rd[1], rd[2])
