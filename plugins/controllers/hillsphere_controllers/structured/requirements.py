"""Requirements on a closed loop: norms of its channels, and a region of its poles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem

__all__ = ["Channel", "DesignPlant", "PoleRegion", "SampledPoleRegion"]

Complex = NDArray[np.complex128]
_DEADBEAT = 1e-9
"""Least |z| that is told from a pole at zero: its s has a real part of −21 over the period, and
rounding of a double pole there is larger."""
_UNBOUNDED = 20.0
"""Largest frequency times period that bounds anything: exp(−20) is as good as a pole at zero."""


@dataclass(frozen=True)
class Channel:
    """A channel: a part of the transfer from w to z whose norm is minimised or limited.

    Parameters
    ----------
    outputs, inputs : tuple of int
        Indices among z and among w; left out: all.
    norm : {"hinf", "h2"}
        Which norm.
    weight : float
        What the norm is multiplied with.
    limit : float or None
        The weighted norm is only to stay below this; None: it is to be as small as possible.
    """

    outputs: tuple[int, ...] | None = None
    inputs: tuple[int, ...] | None = None
    norm: Literal["hinf", "h2"] = "hinf"
    weight: float = 1.0
    limit: float | None = None

    def __post_init__(self) -> None:
        if self.norm not in ("hinf", "h2"):
            raise InputError(f"a norm is 'hinf' or 'h2', got {self.norm!r}")
        limit = 1.0 if self.limit is None else self.limit
        if not (0.0 < self.weight < np.inf and 0.0 < limit < np.inf):
            raise InputError(
                f"a weight and a limit must be > 0 and finite, got {self.weight}, {self.limit}"
            )


@dataclass(frozen=True)
class PoleRegion:
    """Region in which the closed loop's poles λ must lie.

    Parameters
    ----------
    decay_1_s : float
        Re λ ≤ −decay.
    damping : float
        Re λ ≤ −damping |λ|, from 0 to 1.
    fastest_rad_s : float
        |λ| ≤ this.
    """

    decay_1_s: float = 0.0
    damping: float = 0.0
    fastest_rad_s: float = np.inf

    def __post_init__(self) -> None:
        if not (self.decay_1_s >= 0.0 and 0.0 <= self.damping < 1.0 and self.fastest_rad_s > 0.0):
            raise InputError(
                f"a pole region needs decay ≥ 0, damping from 0 to below 1, fastest > 0, got {self}"
            )
        if self.decay_1_s >= self.fastest_rad_s:
            raise InputError("no pole decays faster than the fastest is allowed to be")

    def excess(self, poles: Complex) -> tuple[Array, Complex]:
        """Return the relative excess of poles (n,) over the region, and its slopes; (3, n) each.

        Positive is outside. A slope h′ gives dh = Re(h′ dλ); a row that asks nothing is −inf.
        """
        size = np.maximum(np.abs(poles), 1e-300)
        rows = np.full((3, poles.size), -np.inf)
        slope = np.zeros((3, poles.size), dtype=complex)
        if self.decay_1_s > 0.0:
            rows[0] = poles.real / self.decay_1_s + 1.0
            slope[0] = 1.0 / self.decay_1_s
        if self.damping > 0.0:
            cosine = poles.real / size
            rows[1] = cosine + self.damping
            slope[1] = 1.0 / size - cosine * poles.conj() / size**2
        if np.isfinite(self.fastest_rad_s):
            rows[2] = np.log(size / self.fastest_rad_s)
            slope[2] = poles.conj() / size**2
        return rows, slope


@dataclass(frozen=True)
class SampledPoleRegion(PoleRegion):
    r"""The same region for poles of loops in discrete time, given by their bilinear images.

    Decay, damping and frequency of a pole z are those of

    .. math:: s = \frac{\ln z}{T} = \frac 2T \operatorname{artanh}\frac{T\lambda}{2}

    with the principal logarithm, |Im s| ≤ π/T: a mode that is sampled with the period T has this s.
    The image λ of z = (1 + Tλ/2)/(1 − Tλ/2) is what the search knows. A pole at z = 0 decays at
    once, but has no finite frequency: a largest frequency forbids it.

    Along the real axis \|s\| falls from z = 0 to z = −1, which would hold a search that is to bring
    a pole up to z = exp(−ωT) on the wrong side of zero. Below that point the excess of a real pole
    over the largest frequency ω is (1 − z exp(ωT))/(ωT), which has the same value and slope there.

    Parameters
    ----------
    decay_1_s, damping, fastest_rad_s : float
        Of s, as of λ in `PoleRegion`.
    period_s : float
        T.
    filters : int
        Number of poles at z = 0 that are none of the loop: they belong to the filters that make
        norms of images those of the sampled loop.
    """

    period_s: float = 1.0
    filters: int = 0

    def excess(self, poles: Complex) -> tuple[Array, Complex]:
        """Return the relative excess of the images of poles, and its slopes; see `PoleRegion`."""
        w = 0.5 * self.period_s * poles.astype(complex)
        less = np.where(w == 1.0, 1e-300, 1.0 - w)
        z = (1.0 + w) / less
        away = np.abs(z)
        small = away < _DEADBEAT
        s = np.log(np.where(small, _DEADBEAT, z)).astype(np.complex128) / self.period_s
        rows, slope = super().excess(s)
        # ds/dλ = 1/(1 − w²); at z = 0 the logarithm is held
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = slope * np.where(small, 0.0, 1.0 / (1.0 - w * w))
        fast = self.fastest_rad_s * self.period_s
        if fast < _UNBOUNDED:
            real = (poles.imag == 0.0) & (z.real < np.exp(-fast))
            rows[2] = np.where(real, (1.0 - z.real * np.exp(fast)) / fast, rows[2])
            # dz/dλ = T/(1 − w)²
            by_image = -np.exp(fast) / fast * self.period_s / less**2
            slope[2] = np.where(real, by_image, slope[2])
        if self.filters:
            rows[:, np.argsort(away, kind="stable")[: self.filters]] = -np.inf
        return rows, slope


@dataclass(frozen=True)
class DesignPlant:
    """A plant of a design, with the channels of its closed loop.

    Parameters
    ----------
    system : LtiSystem
        In continuous time; its last inputs are the controls u, its last outputs the measurements.
    channels : tuple of Channel
        Their norms: the design minimises the largest weighted one.
    weight : float
        What all its norms that are minimised are multiplied with.
    name : str
        For messages.
    """

    system: LtiSystem
    channels: tuple[Channel, ...] = field(default=(Channel(),))
    weight: float = 1.0
    name: str = ""
