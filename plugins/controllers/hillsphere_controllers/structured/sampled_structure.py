r"""Structures in discrete time, as structures of the controller's bilinear image.

The search works on images in continuous time (`sampled_plants`). The image of a controller
[A B; C D] in discrete time is, with E = (I + A)⁻¹ and the period T,

.. math::

    \begin{bmatrix} \tfrac{2}{T} (I - 2 E) & \tfrac{2}{\sqrt T} E B \\
    \tfrac{2}{\sqrt T} C E & D - C E B \end{bmatrix},

a smooth function of its entries where it has no pole at z = −1. A structure that prescribes these
entries is thus one of the image too, with the chain rule through this map: fixed entries and
coefficients stay exactly what they are.
"""

from __future__ import annotations

from math import comb

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.bounded import Bounded
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import (
    Diagonal,
    FreeEntries,
    Sizes,
    Structure,
    controller_of,
)
from hillsphere_controllers.systems.algebra import append
from hillsphere_controllers.systems.bilinear import discrete

__all__ = ["SampledEntries", "image_structure", "sampled_controller_of"]

_START_POLE = 0.5
"""Poles at which transfer functions start: between the deadbeat pole 0 and the border 1."""


class SampledEntries:
    """A structure of matrices in discrete time, as one of their image in continuous time.

    Parameters
    ----------
    structure : FreeEntries or TransferFunction
        Gives the matrices in discrete time.
    period_s : float
        Sampling period.
    """

    def __init__(self, structure: FreeEntries | TransferFunction, period_s: float) -> None:
        self.structure, self.period_s = structure, period_s
        self.order, self.size = structure.order, structure.size
        self.controls, self.measurements = structure.controls, structure.measurements

    def gains(self, theta: Array) -> Array:
        """Return K of the image; not finite at a pole at z = −1, which the search then avoids."""
        e, eb, ce, k = self._parts(theta)
        n, root = self.order, 2.0 / np.sqrt(self.period_s)
        return np.block(
            [
                [2.0 / self.period_s * (np.eye(n) - 2.0 * e), root * eb],
                [root * ce, k[n:, n:] - ce @ k[:n, n:]],
            ]
        )

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of the parameters, by dE = −E dA E."""
        e, eb, ce, _ = self._parts(theta)
        n, root = self.order, 2.0 / np.sqrt(self.period_s)
        by_a, by_b = slope[..., :n, :n], slope[..., :n, n:]
        by_c, by_d = slope[..., n:, :n], slope[..., n:, n:]
        made = np.empty(slope.shape)
        made[..., :n, :n] = (
            4.0 / self.period_s * e.T @ by_a @ e.T
            - root * (e.T @ by_b @ eb.T + ce.T @ by_c @ e.T)
            + ce.T @ by_d @ eb.T
        )
        made[..., :n, n:] = root * e.T @ by_b - ce.T @ by_d
        made[..., n:, :n] = root * by_c @ e.T - by_d @ eb.T
        made[..., n:, n:] = by_d
        return self.structure.pull_back(theta, made)

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return values of the entries for signals of these sizes, per sampling period."""
        if isinstance(self.structure, FreeEntries):
            return self.structure.typical(Sizes(sizes.controls, sizes.measurements, 1.0))
        n, count = self.order, self.size - self.order
        gain = float(sizes.controls[0] / sizes.measurements[0])
        # (z − ½)ⁿ, and a gain of one size
        a = np.array([comb(n, i) * (-_START_POLE) ** (n - i) for i in range(n)])
        return np.concatenate([a, np.zeros(count)]), np.concatenate(
            [0.5 * np.abs(a), np.full(count, gain * (1.0 - _START_POLE) ** n)]
        )

    def _parts(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """Return E, E B, C E and the matrix in discrete time."""
        k, n = self.structure.gains(theta), self.order
        try:
            e: Array = np.asarray(np.linalg.inv(np.eye(n) + k[:n, :n]), dtype=float)
        except np.linalg.LinAlgError:
            e = np.full((n, n), np.inf)
        with np.errstate(invalid="ignore", over="ignore"):
            return e, e @ k[:n, n:], k[n:, :n] @ e, k


def image_structure(structure: Structure, period_s: float) -> Structure:
    """Return the structure of the image in continuous time of a controller in discrete time.

    Parameters
    ----------
    structure : Structure
        In discrete time. A PID has the trapezoidal formulas of both actions, (T/2)(z + 1)/(z − 1)
        for the integral, whose image is a PID with the same parameters. Without fixed entries the
        parameters are those of the image.
    period_s : float
        Sampling period.

    Raises
    ------
    InputError
        If it is a structure of another kind.
    """
    if isinstance(structure, Pid) or structure.order == 0:
        return structure
    if isinstance(structure, FreeEntries) and structure.free.all():
        return structure
    if isinstance(structure, FreeEntries | TransferFunction):
        return SampledEntries(structure, period_s)
    if isinstance(structure, Diagonal):
        parts = [image_structure(part, period_s) for part in structure.parts]
        return Diagonal(parts, alike=structure.alike)
    if isinstance(structure, Bounded):
        # bounds are those of the entries in discrete time, free ones too
        inner = structure.structure
        if isinstance(inner, FreeEntries) and inner.order:
            image: Structure = SampledEntries(inner, period_s)
        else:
            image = image_structure(inner, period_s)
        return Bounded(image, structure.lower, structure.upper)
    raise InputError(
        f"in discrete time a structure of the kind {type(structure).__name__} has no image; take "
        "FreeEntries, TransferFunction, Pid, Bounded or a Diagonal of these"
    )


def sampled_controller_of(image: Structure, theta: Array, period_s: float) -> LtiSystem:
    """Return the controller in discrete time of an image's parameters; fixed entries are exact."""
    if isinstance(image, SampledEntries):
        plain = controller_of(image.structure, theta)
        return LtiSystem(plain.a, plain.b, plain.c, plain.d, period_s)
    if isinstance(image, Bounded):
        return sampled_controller_of(image.structure, image.parameters(theta), period_s)
    if isinstance(image, Diagonal):
        start, made = 0, []
        for part in image.parts:
            own = theta[start : start + part.size]
            made.append(sampled_controller_of(part, own, period_s))
            start += part.size
        return append(*made)
    return discrete(controller_of(image, theta), period_s)
