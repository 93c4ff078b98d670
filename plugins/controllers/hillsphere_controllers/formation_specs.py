"""Spec of the law ``lyapunov_formation``."""

from __future__ import annotations

from hillsphere.spec import Ref, Spec, option, quantity, reference

__all__ = ["LyapunovFormationSpec"]


class LyapunovFormationSpec(Spec):
    """Continuous control of a formation by a Lyapunov function of the estimated states."""

    examples = ({"plant": "proximity", "period_h": 1, "ramp_h": 2},)

    plant: Ref = reference(
        "plant", "what the estimate is carried along by between samples, at nominal parameters"
    )
    period_s: float = quantity("time", "time between samples of estimate and reference", gt=0)
    stiffness_1_s2: float = option(
        "K, 1/s², of the distance from the reference", default=1e-5, gt=0
    )
    damping_1_s: float = option("c_d, 1/s, of the velocity", default=1e-4, ge=0)
    ramp_s: float = quantity(
        "time",
        "time constant τ with which both grow from time 0 on, as 1 − exp(−t/τ), while a filter "
        "converges; 0: at once",
        default=0.0,
        ge=0,
    )
