"""Explicit Runge–Kutta tableaux.

A tableau (a, b, c) advances ẋ = f(t, x) by h through

    k_i = f(t + c_i h, x + h Σ_{j<i} a_ij k_j),    x⁺ = x + h Σ_i b_i k_i.

References
----------
.. [1] H. A. Luther (1968), An explicit sixth-order Runge-Kutta formula, Mathematics of
   Computation 22(102), 434-436, the formula with nodes (7 ± √21)/14.
.. [2] E. Hairer, S. P. Nørsett, G. Wanner (1993), Solving Ordinary Differential Equations I,
   2nd ed., Springer, section II.5: the eighth-order formula of DOP853 (12 stages) and the error
   estimators of the code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError

__all__ = ["DOP853", "RK6", "Tableau", "tableau"]


@dataclass(frozen=True, eq=False)
class Tableau:
    """An explicit Runge–Kutta formula.

    Parameters
    ----------
    name : str
        Name in the API.
    order : int
        Order of convergence.
    a : ndarray, shape (s, s)
        Strictly lower triangular.
    b, c : ndarray, shape (s,)
        Weights and nodes.
    errors : tuple of ndarray, shape (s,)
        Weights e of two embedded estimates h Σ e_i k_i: differences of b and the weights of two
        formulas of lower order, the formula of higher order first.
    """

    name: str
    order: int
    a: Array
    b: Array
    c: Array
    errors: tuple[Array, Array]

    @property
    def stages(self) -> int:
        """Number of stages s."""
        return len(self.b)

    def step_error(self, high: Array, low: Array) -> Array:
        r"""Combine both embedded estimates of a step to an estimate of its error.

        With the norms :math:`e` and :math:`\bar e` of the first and the second estimate, dop853
        uses :math:`e^2/\sqrt{e^2 + 0.01\,\bar e^2}`, of order h⁸ [2]_. For rk6, with e of order
        h⁵ and ē of order h⁴, it is :math:`e^3/(e^2 + \bar e^2)`, of order h⁷ as the error. On
        Kepler orbits both estimates are 2 to 30 times the error of the step.

        Parameters
        ----------
        high, low : ndarray, shape (N,)
            Squares of their norms.

        Returns
        -------
        ndarray, shape (N,)
            Estimates.
        """
        if self.order == 8:
            return np.asarray(high / np.sqrt(high + 0.01 * low + _TINY))
        return np.asarray(high * np.sqrt(high) / (high + low + _TINY))


_TINY = 1e-300
"""Keeps the quotient defined if both estimates are zero."""


def _make(
    name: str,
    order: int,
    rows: list[Mapping[int, float]],
    weights: list[float],
    errors: tuple[Mapping[int, float], Mapping[int, float]],
) -> Tableau:
    a = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        a[i, list(row)] = list(row.values())
    # With exact coefficients c_i = Σ_j a_ij; the sum is right to the last bits for both formulas.
    high, low = np.zeros((2, len(rows)))
    for weight, given in zip((high, low), errors, strict=True):
        weight[list(given)] = list(given.values())
    formula = Tableau(name, order, a, np.array(weights), a.sum(axis=1), (high, low))
    for array in (formula.a, formula.b, formula.c, high, low):
        array.flags.writeable = False
    return formula


_Q = sqrt(21.0)
RK6 = _make(
    "rk6",
    6,
    [
        {},
        {0: 1.0},
        {0: 3 / 8, 1: 1 / 8},
        {0: 8 / 27, 1: 2 / 27, 2: 8 / 27},
        {
            0: 3 * (3 * _Q - 7) / 392,
            1: -8 * (7 - _Q) / 392,
            2: 48 * (7 - _Q) / 392,
            3: -3 * (21 - _Q) / 392,
        },
        {
            0: -5 * (231 + 51 * _Q) / 1960,
            1: -40 * (7 + _Q) / 1960,
            2: -320 * _Q / 1960,
            3: 3 * (21 + 121 * _Q) / 1960,
            4: 392 * (6 + _Q) / 1960,
        },
        {
            0: 15 * (22 + 7 * _Q) / 180,
            1: 120 / 180,
            2: 40 * (7 * _Q - 5) / 180,
            3: -63 * (3 * _Q - 2) / 180,
            4: -14 * (49 + 9 * _Q) / 180,
            5: 70 * (7 - _Q) / 180,
        },
    ],
    [9 / 180, 0.0, 64 / 180, 0.0, 49 / 180, 49 / 180, 9 / 180],
    # Orthogonal to the elementary weights of all trees of order 4, the only such weights there
    # are; and the difference from Simpson's rule, orthogonal to those of order 3.
    (
        {0: 3 / 16, 2: 1.0, 3: -81 / 80, 4: -7 / 80 * (1 + _Q), 5: -7 / 80 * (1 - _Q)},
        {0: 9 / 180 - 1 / 6, 2: 64 / 180 - 2 / 3, 4: 49 / 180, 5: 49 / 180, 6: 9 / 180 - 1 / 6},
    ),
)
"""Luther's sixth-order formula with seven stages [1]_."""

DOP853 = _make(
    "dop853",
    8,
    [
        {},
        {0: 0.05260015195876773},
        {0: 0.0197250569845379, 1: 0.0591751709536137},
        {0: 0.02958758547680685, 2: 0.08876275643042054},
        {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
        {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
        {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
        {
            0: 0.03709200011850479,
            3: 0.17038392571223998,
            4: 0.10726203044637328,
            5: -0.015319437748624402,
            6: 0.008273789163814023,
        },
        {
            0: 0.6241109587160757,
            3: -3.3608926294469414,
            4: -0.868219346841726,
            5: 27.59209969944671,
            6: 20.154067550477894,
            7: -43.48988418106996,
        },
        {
            0: 0.47766253643826434,
            3: -2.4881146199716677,
            4: -0.590290826836843,
            5: 21.230051448181193,
            6: 15.279233632882423,
            7: -33.28821096898486,
            8: -0.020331201708508627,
        },
        {
            0: -0.9371424300859873,
            3: 5.186372428844064,
            4: 1.0914373489967295,
            5: -8.149787010746927,
            6: -18.52006565999696,
            7: 22.739487099350505,
            8: 2.4936055526796523,
            9: -3.0467644718982196,
        },
        {
            0: 2.273310147516538,
            3: -10.53449546673725,
            4: -2.0008720582248625,
            5: -17.9589318631188,
            6: 27.94888452941996,
            7: -2.8589982771350235,
            8: -8.87285693353063,
            9: 12.360567175794303,
            10: 0.6433927460157636,
        },
    ],
    [
        0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003,
        -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034,
        0.04471061572777259,
    ],
    # E5 and E3 of the code DOP853 [2]_; its thirteenth stage has no weight in them.
    (
        {
            0: 0.01312004499419488, 5: -1.2251564463762044, 6: -0.4957589496572502,
            7: 1.6643771824549864, 8: -0.35032884874997366, 9: 0.3341791187130175,
            10: 0.08192320648511571, 11: -0.022355307863886294,
        },
        {
            0: -0.18980075407240762, 5: 4.450312892752409, 6: 1.8915178993145003,
            7: -5.801203960010585, 8: -0.4226823213237919, 9: -0.1521609496625161,
            10: 0.20136540080403034, 11: 0.02265179219836082,
        },
    ),
)  # fmt: skip
"""Dormand and Prince's eighth-order formula with twelve stages [2]_."""

_KNOWN = {t.name: t for t in (RK6, DOP853)}


def tableau(name: str) -> Tableau:
    """Return the tableau of this name.

    Parameters
    ----------
    name : {"rk6", "dop853"}
        Name of the formula.

    Returns
    -------
    Tableau
        Its coefficients.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if name not in _KNOWN:
        raise InputError(f"no Runge-Kutta formula {name!r}; known: {', '.join(_KNOWN)}")
    return _KNOWN[name]
