"""Controllers at samples, and sampled loops in discrete time."""

from __future__ import annotations

from typing import Literal, get_args

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import series
from hillsphere_controllers.systems.bilinear import discrete
from hillsphere_controllers.systems.holding import mean_output_hold, zero_order_hold

__all__ = ["Method", "sampled_controller", "sampled_loop"]

Method = Literal["bilinear", "held", "mean"]
_SAME = 1e-9
"""Relative difference up to which two periods are the same: they may come from different products
of decimal numbers."""


def sampled_controller(
    controller: LtiSystem, dt_s: float, method: Method = "bilinear"
) -> LtiSystem:
    """Return a controller in discrete time that acts at the samples.

    Parameters
    ----------
    controller : LtiSystem
        In continuous time; or in discrete time of this very period, and then it stays as it is.
    dt_s : float
        Period, s.
    method : {"bilinear", "held", "mean"}
        "bilinear" keeps the phase of the controller; the loop then loses only the half period of
        the hold. "held" discretises for held inputs, which adds another half period of delay to a
        strictly proper controller. "mean" does the same with the mean output over the period,
        without that delay.

    Returns
    -------
    LtiSystem
        The controller in discrete time.

    Raises
    ------
    InputError
        If the controller has another period, or a pole that the map does not take; or there is no
        such method.
    """
    if method not in get_args(Method):
        raise InputError(f"no method {method!r}; there are: {', '.join(get_args(Method))}")
    if controller.dt_s is not None:
        if abs(controller.dt_s - dt_s) > _SAME * dt_s:
            raise InputError(
                f"the controller was made for a period of {controller.dt_s:.12g} s, the law "
                f"samples every {dt_s:.12g} s; make it for that, or sample as it wants"
            )
        return controller
    if method == "mean":
        return mean_output_hold(controller, dt_s)
    return discrete(controller, dt_s) if method == "bilinear" else zero_order_hold(controller, dt_s)


def sampled_loop(
    plant: LtiSystem,
    controller: LtiSystem,
    dt_s: float,
    *,
    delay_s: float = 0.0,
    method: Method = "bilinear",
) -> LtiSystem:
    """Return the discrete-time loop, cut at the controls, of a plant and a sampled controller.

    Its margins (`hillsphere_controllers.analysis`) include the hold and the delay; those of the
    loop in continuous time are too optimistic.

    Parameters
    ----------
    plant : LtiSystem
        G from u to y, in continuous time.
    controller : LtiSystem
        K from the error to u, in continuous time or of the period.
    dt_s, delay_s : float
        Period, and the time from a sample until its command acts, s.
    method : {"bilinear", "held", "mean"}
        See `sampled_controller`.

    Returns
    -------
    LtiSystem
        K G in discrete time, to be closed by negative feedback.

    Raises
    ------
    InputError
        If the two do not fit, or as `sampled_controller` and `zero_order_hold` do.
    """
    return series(
        zero_order_hold(plant, dt_s, delay_s), sampled_controller(controller, dt_s, method)
    )
