"""Product of the stage ``sampled_loops``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products.fields import Label, Shape

__all__ = ["SampledLoops"]


@dataclass(frozen=True)
class SampledLoops:
    """Loops of C controllers and N plants at K periods, see `SampledMargins`."""

    controllers: Annotated[tuple[str, ...], Shape("controllers"), Label("controller")]
    """Names of the controllers."""
    models: Annotated[tuple[str, ...], Shape("models"), Label("model")]
    """Names of the plants."""
    controls: Annotated[tuple[str, ...], Shape("controls")]
    """Names of the controls of the plants."""
    period_s: Annotated[Array, Shape("periods"), Label("period", 5)]
    """Times between samples."""
    delay_s: float
    """Time from a sample until it acts."""
    spectral_radius: Annotated[Array, Shape("controllers", "periods", "models")]
    """Of the monodromy over one period."""
    peak: Annotated[Array, Shape("controllers", "periods", "models")]
    """Ms of all controls at once."""
    peak_rad_s: Annotated[Array, Shape("controllers", "periods", "models")]
    """Frequency of that peak."""
    peaks: Annotated[Array, Shape("controls", "controllers", "periods", "models")]
    """Ms of each control, the other loops closed."""
    gain_lower: Annotated[Array, Shape("controls + 1", "controllers", "periods", "models")]
    """Smallest factor on one control, last on all, from which on the loop is stable."""
    gain_upper: Annotated[Array, Shape("controls + 1", "controllers", "periods", "models")]
    """Largest factor likewise, up to which the loop stays stable."""
    looked_s: Annotated[Array, Shape("searched")]
    """Periods at which the loops of all plants were looked at."""
    radius: Annotated[Array, Shape("controllers", "searched")]
    """Largest spectral radius among the plants there; NaN of a controller in discrete time."""
    lost_s: Annotated[Array, Shape("controllers")]
    """Shortest of these periods at which a loop is not stable, located; infinite for none."""
