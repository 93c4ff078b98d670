"""Motion in a frame that rotates about its z axis."""

from __future__ import annotations

from hillsphere.symbolic import Expr, Vec3, sum_of

__all__ = ["turning_motion"]


def turning_motion(
    x: tuple[Expr, ...],
    u: tuple[Expr, ...],
    pull: Vec3,
    tide: Vec3,
    rate: Expr,
    acceleration: Expr,
) -> tuple[Expr, ...]:
    r"""Return the rates of position and velocity in a rotating frame.

    .. math::

        \ddot r = g + t + u - 2\omega\times\dot r - \dot\omega\times r
        - \omega\times(\omega\times r)

    Parameters
    ----------
    x : tuple of Expr
        Position, m, velocity, m/s, and perhaps other states.
    u : tuple of Expr
        Commanded acceleration, m/s².
    pull, tide : Vec3
        Attraction of the body, and tidal acceleration by others, m/s².
    rate, acceleration : Expr
        Angular velocity of the frame about z, rad/s, and its derivative, rad/s².

    Returns
    -------
    tuple of Expr
        Six: velocity and acceleration.
    """
    px, py, _, vx, vy, vz = x[:6]
    # in each row: Coriolis, Euler and centrifugal acceleration, then the forces
    w, dw = rate, acceleration
    return (
        vx,
        vy,
        vz,
        sum_of([2.0 * w * vy, dw * py, w * w * px, tide[0], pull[0], u[0]]),
        sum_of([-2.0 * w * vx, -dw * px, w * w * py, tide[1], pull[1], u[1]]),
        sum_of([tide[2], pull[2], u[2]]),
    )
