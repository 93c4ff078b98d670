"""Evaluation of a controller on plants: norms, poles and margins of their closed loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.disk_margins import disk_margin_of_both_ends
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.analysis.h2_norm import h2_norm_bounds
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.analysis.margins import LoopMargins, loop_margins
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.synthesis.products import Judged
from hillsphere_controllers.systems.algebra import gain, lower_lft, series

__all__ = ["evaluate_controller", "inner_plant"]


def evaluate_controller(
    plants: Sequence[LtiSystem], controller: LtiSystem, advance: Callable[[int], None]
) -> Judged:
    """Compute norms, poles and margins of a controller's closed loops with generalised plants.

    Parameters
    ----------
    plants : sequence of LtiSystem
        Their last outputs and inputs are those of the controller.
    controller : LtiSystem
        u = K y.
    advance : callable
        Called with 1 after each plant.

    Raises
    ------
    InputError
        If a loop is not well posed.
    """
    columns: list[tuple[float, ...]] = []
    poles: list[Array] = []
    margins: list[tuple[LoopMargins, ...]] = []
    for plant in plants:
        loop = lower_lft(plant, controller)
        norm = hinf_norm(loop)
        stable = np.isfinite(norm.value)
        gains = largest_gains(loop.response(frequencies([loop]))) if stable else np.array([np.inf])
        inner = inner_plant(plant, controller)
        negative = series(controller, gain(-np.eye(controller.shape[0]), controller.dt_s))
        disk = disk_margin_of_both_ends(inner, negative)
        poles.append(np.asarray(loop.poles))
        columns.append(
            (
                norm.value, norm.upper, norm.frequency_rad_s, norm.error,
                float(gains.max(initial=0.0)),
                h2_norm_bounds(loop).upper if stable else np.inf,
                spectral_abscissa(loop), _damping(loop), disk.alpha,
            )
        )  # fmt: skip
        margins.append((*loop_margins(series(inner, negative)),
                        *loop_margins(series(negative, inner))))  # fmt: skip
        advance(1)
    hinf, upper, peak, error, sampled, h2, abscissa, damping, alpha = np.array(columns).T
    norms = {
        key: np.array([[getattr(one, key) for one in each] for each in margins], dtype=float).T
        for key in ("gain_lower", "gain_upper", "phase_rad", "delay_s")
    }
    return Judged(
        hinf=hinf, hinf_upper=upper, peak_rad_s=peak, hinf_error=error, sampled=sampled, h2=h2,
        poles=np.array(poles, dtype=complex).T, abscissa_1_s=abscissa, damping=damping,
        disk=alpha, **norms,
    )  # fmt: skip


def inner_plant(plant: LtiSystem, controller: LtiSystem) -> LtiSystem:
    """Return the part of a generalised plant from the controls to the measurements."""
    (p, m), (controls, measurements) = plant.shape, controller.shape
    rows, columns = slice(p - measurements, p), slice(m - controls, m)
    return LtiSystem(
        plant.a, plant.b[:, columns], plant.c[rows], plant.d[rows, columns], plant.dt_s,
        plant.inputs[columns], plant.outputs[rows],
    )  # fmt: skip


def _damping(loop: LtiSystem) -> float:
    """Return the least −Re λ/|λ| of the poles; 1 if there is none."""
    poles = loop.poles
    if loop.dt_s is not None:
        poles = np.asarray(np.log(poles[np.abs(poles) > 1e-12]) / loop.dt_s)
    size = np.abs(poles)
    return float((-poles.real / np.where(size > 0.0, size, 1.0)).min(initial=1.0))
