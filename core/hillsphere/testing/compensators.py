"""Checks of compensators: shapes, independence of lanes, and absence of hidden state."""

from __future__ import annotations

from typing import Any

import numpy as np

from hillsphere.engine.simulation.block import BLOCK
from hillsphere.interfaces import Array, Compensator
from hillsphere.interfaces.loop import ContinuousLaw
from hillsphere.symbolic.expressions import parameter_names, time, variable_names, variables
from hillsphere.testing.contract import require

__all__ = ["check_compensator"]

_SAMPLES = 4
"""Samples that a law is run for: from the second one on its own states act on the commands."""


def check_compensator(
    law: Compensator | ContinuousLaw,
    inputs: int,
    outputs: int,
    *,
    tol: float = 1e-12,
    reacts: bool = True,
) -> None:
    """Check a compensator, sampled or continuous.

    Parameters
    ----------
    law : Compensator or ContinuousLaw
        The law.
    inputs, outputs : int
        Numbers q of rows of its input and p of rows of its command, for its plant.
    tol : float
        Largest relative difference between a lane and the same lane in another place.
    reacts : bool
        Whether its command must depend on the error; that of an open loop does not.

    Raises
    ------
    ContractViolation
        Unless

        - its period is positive and finite, and its actuation (or measurement) is valid;
        - its own initial states are finite, one column per case;
        - over four samples of random errors its commands and states keep shapes (p, N), (m, N) and
          are finite;
        - the same call gives the same bits, and no argument is changed;
        - each lane's result depends on that lane only;
        - its command depends on the error, if `reacts`;
        - the expressions of a continuous law contain no symbols other than its arguments.
    """
    what = type(law).__name__
    require(np.isfinite(law.period_s) and law.period_s > 0, f"{what}: period_s must be positive")
    if isinstance(law, ContinuousLaw):
        require(
            law.measurement in ("held", "continuous"),
            f"{what}: measurement must be 'held' or 'continuous', got {law.measurement!r}",
        )
        _check_expressions(law, inputs, outputs)
    else:
        require(isinstance(law, Compensator), f"{what} is neither Compensator nor ContinuousLaw")
        require(
            law.actuation in ("hold", "impulse"),
            f"{what}: actuation must be 'hold' or 'impulse', got {law.actuation!r}",
        )
    random = np.random.default_rng(5)
    y, ref = random.normal(size=(2, _SAMPLES, inputs, BLOCK))
    order = random.permutation(BLOCK)
    there = list(_fly_law(law, y[:, :, order], ref[:, :, order], outputs))
    commands = []
    for k, (u, xc) in enumerate(_fly_law(law, y, ref, outputs)):
        for name, one, other in (("command", u, there[k][0]), ("states", xc, there[k][1])):
            size = np.maximum(np.max(np.abs(one), initial=0.0), 1e-300)
            worst = float(np.max(np.abs(one[:, order] - other), initial=0.0) / size)
            require(
                worst <= tol,
                f"{what}: {name} of a lane depend on its neighbours (by {worst:.1e} at sample {k})",
            )
        commands.append(u)
    if reacts and not isinstance(law, ContinuousLaw):
        told = np.array(commands)
        require(np.ptp(told), f"{what} commands {told.flat[0]:g} whatever it sees")


def _fly_law(law: Any, y: Array, ref: Array, outputs: int) -> Any:
    """Yield command and states after each sample."""
    what, cases = type(law).__name__, y.shape[-1]
    xc = law.initial(cases)
    m = len(xc)
    require(xc.shape == (m, cases), f"{what}: initial({cases}) must be (m, {cases}), is {xc.shape}")
    for k in range(len(y)):
        t = np.full(cases, k * law.period_s)
        arguments = (t, y[k], ref[k], xc)
        before = [a.copy() for a in arguments]
        first, second = (_call_law(law, k, arguments) for _ in range(2))
        for a, b in zip(first, second, strict=True):
            require(np.array_equal(a, b), f"{what}: the same call at sample {k} differs")
        for a, b in zip(arguments, before, strict=True):
            require(np.array_equal(a, b), f"{what} changes an argument at sample {k}")
        u, xc = first
        rows = 0 if isinstance(law, ContinuousLaw) else outputs
        require(u.shape == (rows, cases), f"{what}: u must be {(rows, cases)}, is {u.shape}")
        require(xc.shape == (m, cases), f"{what}: states must stay {(m, cases)}, are {xc.shape}")
        require(np.isfinite(u).all() and np.isfinite(xc).all(), f"{what}: not finite at sample {k}")
        yield u, xc


def _call_law(law: Any, k: int, arguments: tuple[Array, ...]) -> tuple[Array, Array]:
    if isinstance(law, ContinuousLaw):
        return np.empty((0, len(arguments[0]))), law.sample(k, *arguments)
    u, xc = law.step(k, *arguments)
    return u, xc


def _check_expressions(law: ContinuousLaw, inputs: int, outputs: int) -> None:
    what = type(law).__name__
    require(law.inputs == inputs, f"{what}: inputs is {law.inputs}, expected {inputs}")
    own = [v.name for v in law.states]
    require(len(set(own)) == len(own), f"{what}: names of states repeat: {own}")
    require(
        len(law.initial(1)) == len(own), f"{what}: initial has not one row per state, {len(own)}"
    )
    seen = [f"seen{i}" for i in range(inputs)]
    goal = [f"goal{i}" for i in range(inputs)]
    symbols = variables(*own), variables(*seen), variables(*goal)
    rates, command = law.derivative(*symbols, time), law.control(*symbols, time)
    require(len(rates) == len(own), f"{what}: {len(rates)} derivatives of {len(own)} states")
    require(len(command) == outputs, f"{what}: {len(command)} commands, expected {outputs}")
    strange = set(variable_names([*rates, *command])) - {*own, *seen, *goal}
    strange |= set(parameter_names([*rates, *command]))
    require(not strange, f"{what}: symbols that it was not given: {sorted(strange)}")
    require(
        {*seen} & set(variable_names([*rates, *command])), f"{what} depends on nothing that it sees"
    )
