"""Controllers of one loop: PID, and a transfer function given by its coefficients."""

from __future__ import annotations

from math import comb

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.structured.structure import Sizes

__all__ = ["Pid", "TransferFunction"]


class Pid:
    r"""One loop with :math:`K(s) = k_p + k_i/s + k_d s/(1 + s/ω)`.

    θ = (k_p, k_i, k_d, ln ω), without those of an action that is left out.

    Parameters
    ----------
    integral, derivative : bool
        Actions that are there.
    """

    controls = measurements = 1

    def __init__(self, *, integral: bool = True, derivative: bool = True) -> None:
        self.integral, self.derivative = integral, derivative
        self.order = integral + derivative
        self.size = 1 + integral + 2 * derivative

    def gains(self, theta: Array) -> Array:
        """Return K with an integrator's and a filter's state."""
        made = np.zeros((self.order + 1, self.order + 1))
        made[-1, -1] = theta[0]
        if self.integral:
            made[0, -1], made[-1, 0] = 1.0, theta[1]
        if self.derivative:  # filter: ẋ = ω (y − x), u = k_d ω (y − x)
            gain, omega = theta[-2], np.exp(theta[-1])
            made[-2, -2], made[-2, -1] = -omega, omega
            made[-1, -2] = -gain * omega
            made[-1, -1] += gain * omega
        return made

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of the parameters."""
        slopes = [slope[..., -1, -1]]
        if self.integral:
            slopes.append(slope[..., -1, 0])
        if self.derivative:
            gain, omega = theta[-2], np.exp(theta[-1])
            # k_d and ω enter D and the filter's output together
            through = slope[..., -1, -1] - slope[..., -1, -2]
            slopes.append(omega * through)
            slopes.append(omega * (slope[..., -2, -1] - slope[..., -2, -2] + gain * through))
        return np.stack(slopes, axis=-1)

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return a filter ten times as fast as the plant, and actions of one size at its rate."""
        size, rate = float(sizes.controls[0] / sizes.measurements[0]), sizes.rate
        middle, spread = [0.0], [size]
        if self.integral:
            middle.append(0.0)
            spread.append(size * rate)
        if self.derivative:
            middle += [0.0, float(np.log(10.0 * rate))]
            spread += [size / rate, 1.0]
        return np.array(middle), np.array(spread)


class TransferFunction:
    r"""One loop with :math:`K(s) = \sum_{i \le m} b_i s^i / (s^n + \sum_{i < n} a_i s^i)`.

    θ = (a₀ … a₍ₙ₋₁₎, b₀ … b₍ₘ₎), m = n − relative degree.

    Parameters
    ----------
    order : int
        n ≥ 1.
    relative_degree : int
        From 0 to n.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    controls = measurements = 1

    def __init__(self, order: int, relative_degree: int = 0) -> None:
        if order < 1 or not 0 <= relative_degree <= order:
            raise InputError(
                "a transfer function needs an order ≥ 1 and a relative degree from 0 to it, got "
                f"{order} and {relative_degree}"
            )
        self.order = order
        self._count = order - relative_degree + 1
        self.size = order + self._count

    def gains(self, theta: Array) -> Array:
        """Return K in controllable canonical form."""
        n = self.order
        a, b = theta[:n], np.zeros(n + 1)
        b[: self._count] = theta[n:]
        made = np.zeros((n + 1, n + 1))
        made[: n - 1, 1:n] = np.eye(n - 1)
        made[n - 1, :n], made[n - 1, n] = -a, 1.0
        # the direct term is b_n; the rest of the numerator is reduced by it
        made[n, :n], made[n, n] = b[:n] - b[n] * a, b[n]
        return made

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of the coefficients."""
        n = self.order
        a = theta[:n]
        last = theta[-1] if self._count == n + 1 else 0.0
        denominator = -slope[..., n - 1, :n] - last * slope[..., n, :n]
        through = slope[..., n, n] - slope[..., n, :n] @ a
        numerator = np.concatenate([slope[..., n, :n], through[..., None]], axis=-1)
        return np.concatenate([denominator, numerator[..., : self._count]], axis=-1)

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return poles that are all at minus the plant's rate, and a gain of one size there."""
        n, size = self.order, float(sizes.controls[0] / sizes.measurements[0])
        powers = sizes.rate ** (n - np.arange(n + 1.0))
        a = np.array([comb(n, i) for i in range(n)]) * powers[:n]
        middle = np.concatenate([a, np.zeros(self._count)])
        return middle, np.concatenate([0.5 * a, size * powers[: self._count]])
