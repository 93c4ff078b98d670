r"""Signals between participants that move: light times, ranges and their rates.

A signal leaves participant A at t_A and reaches B at t_B, in inertial axes, where

.. math:: c\,(t_B - t_A) = \rho = |r_B(t_B) - r_A(t_A)| .

This is Newtonian: the delay by the Sun's gravity (below 40 km one way at the Sun's limb, metres
elsewhere) and the rates of clocks are left out [1]_. Differentiation gives, with e the unit vector
from A to B,

.. math:: \frac{dt_A}{dt_B} = \frac{1 - e\cdot v_B/c}{1 - e\cdot v_A/c} .

All times count from the time tag, so that a light time keeps its digits.

References
----------
.. [1] Moyer, T. D., Formulation for Observed and Computed Values of Deep Space Network Data Types
   for Navigation, JPL, 2000, chapters 8, 11 and 13.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from hillsphere.base.constants import SPEED_OF_LIGHT_M_S
from hillsphere.interfaces import Array

__all__ = ["FARTHEST_S", "Node", "Signal", "follow_signal"]

_ROUNDS = 5
"""Newton steps of a light time at most. Its error falls from the light time τ itself to a τ²/(2c)
and then quadratically: with a = 10 m/s² and τ = 1000 s to 0.02 s, 6e-12 s and rounding."""
_CLOSE_S = 1e-8
"""Step after which no other one is made: the next would be 1e-24 s, and the change of a velocity
meanwhile, 1e-7 m/s at 10 m/s², is below the rounding of what is measured."""
FARTHEST_S = 1.5e4
"""Longest light time of a leg, to Neptune; what is beyond it, such as the states of a step of a fit
that is too long, has no number."""

Path: TypeAlias = Callable[[Array], Array]
"""Times (N,), s after the tag → inertial states (6, N), m and m/s."""


@dataclass(frozen=True)
class Node:
    """A participant on the way of a signal.

    Parameters
    ----------
    states : callable
        Its motion.
    receive_delay_s, transmit_delay_s : float
        From its antenna to its receiver, and from its transmitter to its antenna.
    """

    states: Path
    receive_delay_s: float = 0.0
    transmit_delay_s: float = 0.0


@dataclass(frozen=True)
class Signal:
    """A signal from a transmitter by way of transponders to a receiver.

    Parameters
    ----------
    sent_s, received_s : ndarray, shape (N,)
        Times at the electronics of transmitter and receiver, s after the tag.
    elapsed_s : ndarray, shape (N,)
        Between them, with all delays.
    slowing : ndarray, shape (N,)
        1 − dt_sent/dt_received, the rate of `elapsed_s`; times c the rate of the range.
    line_m : ndarray, shape (3, N)
        From the receiver's antenna to the last sender when the signal left it.
    light_time_s : ndarray, shape (N,)
        Of the last leg.
    receiver : ndarray, shape (6, N)
        Inertial state of the receiver at reception.
    at_antenna_s : ndarray, shape (N,)
        Time of reception there.
    """

    sent_s: Array
    received_s: Array
    elapsed_s: Array
    slowing: Array
    line_m: Array
    light_time_s: Array
    receiver: Array
    at_antenna_s: Array


def follow_signal(nodes: Sequence[Node], tag_s: Array, tagged: str = "receive") -> Signal:
    """Return the signal that is received, or sent, at given times.

    Parameters
    ----------
    nodes : sequence of Node
        Transmitter, transponders, receiver: two at least.
    tag_s : ndarray, shape (N,)
        Times of reception at the last node's electronics or of transmission at the first one's.
    tagged : {"receive", "transmit"}
        Which of both.

    Returns
    -------
    Signal
        Its times and its last leg; NaN where a leg is longer than `FARTHEST_S`.
    """
    first, last = nodes[0], nodes[-1]
    slowing = np.zeros(np.shape(tag_s))
    elapsed = np.full(np.shape(tag_s), first.transmit_delay_s + last.receive_delay_s)
    between = [node.receive_delay_s + node.transmit_delay_s for node in nodes[1:-1]]
    elapsed = elapsed + sum(between)
    legs = list(pairwise(nodes))
    if tagged == "receive":
        now = tag_s - last.receive_delay_s
        held = last.states(now)
        line, light, receiver, at_antenna = np.zeros((3, now.size)), now, held, now
        for number in range(len(legs) - 1, -1, -1):
            light_time, there = _solve(held, legs[number][0].states, now, -1.0)
            slowing = _compound(slowing, _slowing(there, held))
            elapsed = elapsed + light_time
            if number == len(legs) - 1:
                line, light = there[:3] - held[:3], light_time
            now = now - light_time
            if number:
                now = now - between[number - 1]
                there = legs[number][0].states(now) if between[number - 1] else there
            held = there
        sent = tag_s - elapsed
        return Signal(sent, tag_s, elapsed, slowing, line, light, receiver, at_antenna)
    now = tag_s + first.transmit_delay_s
    held = first.states(now)
    line, light_time, there = np.zeros((3, now.size)), np.zeros(now.size), held
    for number, (_, to) in enumerate(legs):
        light_time, there = _solve(held, to.states, now, 1.0)
        slowing = _compound(slowing, _slowing(held, there))
        elapsed = elapsed + light_time
        line = held[:3] - there[:3]
        now = now + light_time
        if number < len(legs) - 1 and between[number]:
            now = now + between[number]
            held = to.states(now)
        else:
            held = there
    return Signal(tag_s, tag_s + elapsed, elapsed, slowing, line, light_time, there, now)


def _solve(held: Array, states: Path, now: Array, direction: float) -> tuple[Array, Array]:
    """Return the light time (N,) to or from a known end, and the state (6, N) of the other end.

    f(τ) = c τ − |r(now ± τ) − r_held| is solved by Newton's method.
    """
    light_time = np.zeros(now.size)
    for _ in range(_ROUNDS):
        there = states(now + direction * light_time)
        way = there[:3] - held[:3]
        distance = np.sqrt(np.sum(way * way, axis=0))
        opening = direction * np.sum(way * there[3:], axis=0) / distance
        off = SPEED_OF_LIGHT_M_S * light_time - distance
        step = -off / (SPEED_OF_LIGHT_M_S - opening)
        further = np.clip(light_time + step, 0.0, FARTHEST_S)
        step, light_time = further - light_time, further
        if not np.max(np.abs(step)) >= _CLOSE_S:
            break
    # over the last step the other end moves uniformly
    there = np.where(light_time < FARTHEST_S, there, np.nan)
    there[:3] += direction * step * there[3:]
    return light_time, there


def _slowing(sender: Array, receiver: Array) -> Array:
    """Return 1 − dt_A/dt_B of one leg: e·(v_B − v_A)/c over 1 − e·v_A/c."""
    way = receiver[:3] - sender[:3]
    unit = way / np.sqrt(np.sum(way * way, axis=0))
    opening = np.sum(unit * (receiver[3:] - sender[3:]), axis=0)
    along = np.sum(unit * sender[3:], axis=0)
    return np.asarray(opening / (SPEED_OF_LIGHT_M_S - along))


def _compound(one: Array, other: Array) -> Array:
    """Return 1 − (1 − a)(1 − b), without the loss of digits of the product."""
    return np.asarray(one + other - one * other)
