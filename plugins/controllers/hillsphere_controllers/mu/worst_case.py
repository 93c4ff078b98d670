r"""Worst-case perturbations as real values and as stable systems.

A complex value c at the frequency ω is that of a first-order all-pass times a gain,

.. math::

    δ(s) = \pm |c| \frac{a - s}{a + s}, \qquad a > 0,

for one sign and one a; a dyad u vᴴ is a column of these times a row of them [1]_. At no frequency
are they larger than at ω, so that the system is as small as the matrix that it interpolates.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, section
   9.2.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.bilinear_images import image_frequency
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.systems.algebra import append, gain, series, upper_lft
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["WorstCase", "interpolate_perturbation", "worst_case"]

Complex = NDArray[np.complex128]

_REAL = 1e-10
"""Imaginary part, relative to the size, up to which a value counts as real and needs no
dynamics."""
_SINGULAR = 1e-6
"""Smallest singular value of I − M Δ(jω), relative to M Δ, up to which the check in the closed loop
is passed. Interpolation by systems costs some of the digits that `lower_bound` asks for."""
_RANK = 1e-8
"""Second singular value of a full block, relative to the first, up to which it counts as a dyad."""


@dataclass(frozen=True, eq=False)
class WorstCase:
    """A perturbation that takes a loop to the border of stability.

    Parameters
    ----------
    frequency_rad_s : float
        At which the closed loop has a pole on that border.
    delta : ndarray, shape (m, p)
        Δ there.
    values : dict of str to float
        Of the real blocks, by their name, or their number without one; normalised:
        `hillsphere_controllers.linear_fractional.uncertainties.physical_values` has them in their
        units.
    system : LtiSystem
        Δ(s), stable, as large as `delta`, whose response at the frequency it is. Without states if
        all blocks are real.
    pole : complex
        The pole of M closed with Δ(s) that is nearest to that border, 1/s, or in the z-plane;
        infinite if Δ closes a loop of direct terms, with which there is no system.
    singular : float
        The smallest singular value of I − M Δ, from the responses of both systems.
    """

    frequency_rad_s: float
    delta: Complex
    values: dict[str, float]
    system: LtiSystem
    pole: complex
    singular: float


def interpolate_perturbation(
    delta: Complex, structure: BlockStructure, omega_rad_s: float
) -> LtiSystem:
    """Return a stable system Δ(s) of the structure whose response at a frequency is Δ.

    Parameters
    ----------
    delta : ndarray, shape (m, p)
        Δ; its full blocks are dyads.
    structure : BlockStructure
        Of Δ.
    omega_rad_s : float
        The frequency.

    Returns
    -------
    LtiSystem
        In continuous time; its norm is the largest singular value of Δ.

    Raises
    ------
    InputError
        If a full block has a rank above one, a real one a complex value, or Δ is not real though
        the frequency is 0 or ∞.
    """
    made = []
    size = max(float(np.abs(delta).max()), 1e-300)
    for block, (rows, columns) in zip(structure.blocks, structure.parts(), strict=True):
        part = delta[rows, columns]
        if np.abs(part.imag).max() <= _REAL * size and (
            block.kind != "full" or not 0.0 < omega_rad_s < np.inf
        ):
            made.append(gain(part.real))
        elif block.kind == "real":
            raise InputError(f"a real block has real values, not {complex(part[0, 0]):.6g}")
        elif block.kind != "full":
            scalar = _all_pass(complex(part[0, 0]), omega_rad_s)
            made += [scalar] * block.rows
        else:
            made.append(_dyad(part, omega_rad_s))
    return append(*made)


def _all_pass(value: complex, omega: float) -> LtiSystem:
    """Return the scalar system of a value at a frequency."""
    if abs(value.imag) <= _REAL * abs(value):
        return gain(np.array([[value.real]]))
    if not 0.0 < omega < np.inf:
        raise InputError(
            f"at {omega} rad/s a system has real values only, not {value:.6g}: interpolate nearby"
        )
    angle = float(np.angle(value))
    # (a − s)/(a + s) turns by −2 atan(ω/a), between −π and 0
    sign, turn = (1.0, -angle) if angle < 0.0 else (-1.0, np.pi - angle)
    a = omega / np.tan(0.5 * turn)
    root = np.sqrt(2.0 * a)
    one = np.ones((1, 1))
    size = sign * abs(value)
    return LtiSystem(-a * one, root * one, size * root * one, -size * one)


def _dyad(part: Complex, omega: float) -> LtiSystem:
    u, s, vh = np.linalg.svd(part)
    if s.size > 1 and s[1] > _RANK * max(s[0], 1e-300):
        raise InputError("a full block is interpolated by dyads, but this one has a higher rank")
    left, right = u[:, 0] * np.sqrt(s[0]), vh[0] * np.sqrt(s[0])
    k = int(np.argmax(np.abs(left)))
    turn = np.exp(-1j * np.angle(left[k]))  # one state less: its largest entry is real
    left, right = left * turn, right / turn
    rows = append(*[_all_pass(complex(v), omega) for v in right])
    columns = append(*[_all_pass(complex(v), omega) for v in left])
    ones = np.ones((1, right.size))
    return series(rows, gain(ones), gain(np.ones((left.size, 1))), columns)


def worst_case(
    system: LtiSystem, structure: BlockStructure, delta: Complex, omega_rad_s: float
) -> WorstCase:
    """Return a perturbation with its system, checked by closing the loop.

    Parameters
    ----------
    system : LtiSystem
        M; of more inputs and outputs than the structure has, the first belong to Δ.
    structure : BlockStructure
        Of Δ.
    delta : ndarray, shape (m, p)
        With which I − M Δ is singular at the frequency.
    omega_rad_s : float
        The frequency; in discrete time that of the response at exp(jω dt).

    Returns
    -------
    WorstCase
        The perturbation as a system, and what the closed loop was found to be.

    Raises
    ------
    InputError
        If Δ cannot be interpolated.
    ConvergenceError
        If the closed loop is not singular at the frequency.
    """
    p, m = structure.shape
    dt_s = system.dt_s
    # M without the channels of performance
    own = LtiSystem(system.a, system.b[:, :m], system.c[:p], system.d[:p, :m], dt_s)
    # in discrete time the system of the image is interpolated at the image of the frequency
    image = omega_rad_s
    if dt_s is not None:
        own, image = continuous(own), image_frequency(omega_rad_s, dt_s)
    block = interpolate_perturbation(delta, structure, image)
    at = np.array([image])
    product = own.response(at)[0] @ block.response(at)[0]
    singular = float(np.linalg.svd(np.eye(p) - product, compute_uv=False)[-1])
    if not singular <= _SINGULAR * max(1.0, float(np.linalg.norm(product, 2))):
        raise ConvergenceError(
            f"this Δ does not make I − M Δ singular at {omega_rad_s:.6g} rad/s: its smallest "
            f"singular value is {singular:.3g}"
        )
    pole = np.inf + 0j
    if np.isfinite(image) and own.order + block.order:
        with suppress(InputError):  # I − M Δ may be singular at all frequencies
            poles = upper_lft(own, block).poles
            pole = complex(poles[int(np.argmin(np.abs(poles - 1j * image)))])
            if dt_s is not None:
                # the pole of the image, mapped back to the z-plane
                pole = (1.0 + 0.5 * dt_s * pole) / (1.0 - 0.5 * dt_s * pole)
    if dt_s is not None:
        block = discrete(block, dt_s)
    return WorstCase(omega_rad_s, delta, structure.real_values(delta), block, pole, singular)
