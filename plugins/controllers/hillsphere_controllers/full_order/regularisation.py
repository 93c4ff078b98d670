r"""Regularisation of singular H∞ and H2 problems: small weights and noise, for the synthesis only.

.. math::

    z' = \begin{bmatrix} z \\ E_u u \\ E_x x \end{bmatrix}, \qquad
    y' = y + N_y v_y, \qquad \dot x' = \dot x + N_x v_x

make D12 and D21 of full rank (E_u, N_y), and with E_x and N_x no zero of the plant from u to z' or
from w' to y' is left on the imaginary axis: C1 and B1 show and drive every state. The loop's
transfer from w to z is a block of that from w' to z', so that a γ of the problem with them is one
of the problem as given; what no controller reaches in the former, some may reach in the latter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["Regularisation", "choose_regularisations"]


@dataclass(frozen=True)
class Regularisation:
    """Weights and noise that were added to a plant for the synthesis of its controller.

    Parameters
    ----------
    controls : ndarray, shape (k,)
        Weight on each control: units of z per unit of u.
    measurements : ndarray, shape (q,)
        Noise on each measurement: units of y per unit of w.
    state_weights : ndarray, shape (n,)
        Weight on each state, units of z per unit of the state; of the states of the bilinear image
        in discrete time.
    state_noise : ndarray, shape (n,)
        Noise on each state's derivative, units of ẋ per unit of w; likewise.
    """

    controls: Array
    measurements: Array
    state_weights: Array
    state_noise: Array

    @classmethod
    def even(cls, size: float, controls: int, measurements: int, order: int) -> Regularisation:
        """Return one of the same number on every control and measurement, none on the states."""
        none = np.zeros(order)
        return cls(np.full(controls, size), np.full(measurements, size), none, none)

    def __bool__(self) -> bool:
        """Return whether anything is added."""
        return any(
            size.any()
            for size in (self.controls, self.measurements, self.state_weights, self.state_noise)
        )

    def __str__(self) -> str:
        """Return what is added, in words; empty if nothing is."""
        parts = [
            f"{what} {_list(size)}"
            for what, size in (
                ("weights on the controls", self.controls),
                ("noise on the measurements", self.measurements),
                ("weights on the states up to", self.state_weights.max(initial=0.0)),
                ("noise on the states up to", self.state_noise.max(initial=0.0)),
            )
            if np.any(size)
        ]
        return ", ".join(parts)

    def add_to(self, plant: LtiSystem) -> LtiSystem:
        """Return the plant with extra outputs and disturbances, before the controls' and y's own.

        Parameters
        ----------
        plant : LtiSystem
            Of order n, k controls and q measurements.
        """
        (p, m), n = plant.shape, plant.order
        k, q = self.controls.size, self.measurements.size
        # rows of u and x that weigh nothing are left out
        weights = np.diag(self.controls)[self.controls != 0.0]
        seen = np.diag(self.state_weights)[self.state_weights != 0.0]
        noise = np.diag(self.measurements)[:, self.measurements != 0.0]
        driven = np.diag(self.state_noise)[:, self.state_noise != 0.0]
        rows, columns = len(weights) + len(seen), noise.shape[1] + driven.shape[1]
        p1, m1 = p - q, m - k
        b = np.hstack([plant.b[:, :m1], np.zeros((n, noise.shape[1])), driven, plant.b[:, m1:]])
        c = np.vstack([plant.c[:p1], np.zeros((len(weights), n)), seen, plant.c[p1:]])
        d = np.zeros((p + rows, m + columns))
        d[:p1, :m1], d[:p1, m1 + columns :] = plant.d[:p1, :m1], plant.d[:p1, m1:]
        d[p1 + rows :, :m1] = plant.d[p1:, :m1]
        d[p1 + rows :, m1 + columns :] = plant.d[p1:, m1:]
        d[p1 : p1 + len(weights), m1 + columns :] = weights
        d[p1 + rows :, m1 : m1 + noise.shape[1]] = noise
        return LtiSystem(plant.a, b, c, d, plant.dt_s)


def choose_regularisations(
    plant: LtiSystem, k: int, q: int, size: float
) -> Iterator[Regularisation]:
    """Yield regularisations of a size relative to the problem: of u and y, of all, of the states.

    Parameters
    ----------
    plant : LtiSystem
        Generalised plant.
    k, q : int
        Numbers of controls and measurements.
    size : float
        The weights' share of the largest entry of C1 and D12, in balanced states, and the noise's
        of that of B1 and D21.
    """
    even, scale = balance_states(plant)
    (p, m), n = plant.shape, plant.order
    seen = max(np.abs(even.c[: p - q]).max(initial=0.0),
               np.abs(even.d[: p - q, m - k :]).max(initial=0.0)) or 1.0  # fmt: skip
    driven = max(np.abs(even.b[:, : m - k]).max(initial=0.0),
                 np.abs(even.d[p - q :, : m - k]).max(initial=0.0)) or 1.0  # fmt: skip
    if not size:
        yield Regularisation.even(0.0, k, q, n)
        return
    weights, noise = np.full(k, size * seen), np.full(q, size * driven)
    states = size * seen / scale, size * driven * scale
    yield Regularisation(weights, noise, np.zeros(n), np.zeros(n))
    yield Regularisation(weights, noise, *states)
    yield Regularisation(np.zeros(k), np.zeros(q), *states)


def _list(sizes: Array | float) -> str:
    return ", ".join(f"{size:.3g}" for size in np.atleast_1d(sizes))
