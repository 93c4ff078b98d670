"""Carlson's symmetric elliptic integrals R_F and R_D as expressions.

R_F(x, y, z) = ½ ∫₀^∞ ds / √((s+x)(s+y)(s+z)) and
R_D(x, y; z) = ³⁄₂ ∫₀^∞ ds / ((s+z) √((s+x)(s+y)(s+z))), both by Carlson's duplication theorem [1]_:
each step brings the arguments four times nearer together, then a series in their differences
finishes. All three R_D of one triple share their square roots with R_F.

References
----------
.. [1] B. C. Carlson (1995), Numerical computation of real or complex elliptic integrals,
   Numerical Algorithms 10, 13–26, algorithms for R_F and R_D; the series also in DLMF §19.36(i).
"""

from __future__ import annotations

from collections.abc import Sequence

from hillsphere.symbolic import Expr, Vec3, constant, sqrt, sum_of

__all__ = ["carlson_rf_rd"]

_DUPLICATIONS = 5
"""Fixed, for an expression has no loop to end. What the series neglects is of order (δ/4⁵)⁶, δ
the spread of the arguments over their mean: below rounding for axes up to 6:1 (arguments 36:1),
3e-13 at 100:1."""


def carlson_rf_rd(arguments: Vec3) -> tuple[Expr, Vec3]:
    """Return R_F of three positive arguments, and R_D with each of them as the last one.

    Parameters
    ----------
    arguments : Vec3
        x, y, z > 0.

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
    for _ in range(_DUPLICATIONS):
        # x → (x + λ)/4 with λ = √x√y + √y√z + √z√x leaves R_F unchanged
        root = (sqrt(x[0]), sqrt(x[1]), sqrt(x[2]))
        shift = root[0] * root[1] + root[1] * root[2] + root[2] * root[0]
        for i in range(3):
            # R_D(·; z) = 3/(√z (z + λ)) + ¼ R_D of the new arguments, DLMF eq. 19.26.20
            sums[i].append(constant(quarter_power) / (root[i] * (x[i] + shift)))
        x = (0.25 * (x[0] + shift), 0.25 * (x[1] + shift), 0.25 * (x[2] + shift))
        quarter_power *= 0.25
    rd = [
        3.0 * sum_of(sums[i]) + quarter_power * _rd_series(x[(i + 1) % 3], x[(i + 2) % 3], x[i])
        for i in range(3)
    ]
    return _rf_series(x), (rd[0], rd[1], rd[2])


def _rf_series(x: Sequence[Expr]) -> Expr:
    """Return the series of R_F for nearly equal arguments, to sixth order."""
    mean = (x[0] + x[1] + x[2]) / 3.0
    dx, dy = 1.0 - x[0] / mean, 1.0 - x[1] / mean
    dz = -(dx + dy)
    # elementary symmetric functions of the differences, DLMF eq. 19.36.1
    e2, e3 = dx * dy - dz * dz, dx * dy * dz
    series = 1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0
    return series / sqrt(mean)


def _rd_series(x: Expr, y: Expr, z: Expr) -> Expr:
    """Return the series of R_D for nearly equal arguments, to sixth order."""
    mean = (x + y + 3.0 * z) / 5.0
    dx, dy = 1.0 - x / mean, 1.0 - y / mean
    dz = -(dx + dy) / 3.0
    # the same with z three times, DLMF eq. 19.36.2
    xy, zz = dx * dy, dz * dz
    e2 = xy - 6.0 * zz
    e3 = (3.0 * xy - 8.0 * zz) * dz
    e4 = 3.0 * (xy - zz) * zz
    e5 = xy * dz * zz
    series = (
        1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2 * e2 / 88.0
        - 3.0 * e4 / 22.0 - 9.0 * e2 * e3 / 52.0 + 3.0 * e5 / 26.0
    )  # fmt: skip
    return series / (mean * sqrt(mean))
