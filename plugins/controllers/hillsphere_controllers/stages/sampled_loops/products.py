"""Product of the stage ``sampled_loops``."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array

__all__ = ["SampledLoops"]


@dataclass(frozen=True)
class SampledLoops:
    """Loops of C controllers and N plants at K periods, see `SampledMargins`.

    Parameters
    ----------
    controllers, models : tuple of str
        Their names.
    controls : tuple of str
        The p controls of the plants.
    period_s : ndarray, shape (K,)
        Times between samples.
    delay_s : float
        Time from a sample until it acts.
    spectral_radius, peak, peak_rad_s : ndarray, shape (C, K, N)
        Of the monodromy; Ms of all controls at once, and where.
    peaks : ndarray, shape (p, C, K, N)
        Ms of each control, the other loops closed.
    gain_lower, gain_upper : ndarray, shape (p + 1, C, K, N)
        Between which factors on one control, last on all, the loop stays stable.
    looked_s : ndarray, shape (L,)
        Periods at which the loops of all plants were looked at.
    radius : ndarray, shape (C, L)
        Largest spectral radius among the plants there; NaN of a controller in discrete time.
    lost_s : ndarray, shape (C,)
        Shortest of these periods at which a loop is not stable, located; infinite for none.
    """

    controllers: tuple[str, ...]
    models: tuple[str, ...]
    controls: tuple[str, ...]
    period_s: Array
    delay_s: float
    spectral_radius: Array
    peak: Array
    peak_rad_s: Array
    peaks: Array
    gain_lower: Array
    gain_upper: Array
    looked_s: Array
    radius: Array
    lost_s: Array
