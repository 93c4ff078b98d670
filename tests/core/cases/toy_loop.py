"""A closed loop, compiled, as the stage of a toy campaign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults
from hillsphere.simulation import Cases, NavigationErrors, Simulator
from hillsphere.symbolic import Expr, Params, dot, power, sin


class Central:
    """Attraction of a point with a ripple, in space."""

    frame = "hill:toy"
    states = (
        *(Variable(n, 1) for n in ("x", "y", "z")),
        *(Variable(n, 1, -1) for n in ("vx", "vy", "vz")),
    )
    controls = tuple(Variable(n, 1, -2) for n in ("ax", "ay", "az"))
    scales = Scales(20e3, 1e3)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", 7.0e5, "m3/s2"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        pull = -p["gm"] * power(dot(x[:3], x[:3]), -1.5) * (1.0 + 0.01 * sin(x[0] / 1e4))
        ax, ay, az = (pull * q + a for q, a in zip(x[:3], u, strict=True))
        return (*x[3:], ax, ay, az)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": dot(x[:3], x[:3]) / 12e3**2 - 1.0}


class Holding:
    """Held proportional and derivative action."""

    period_s = 60.0
    actuation: Literal["hold", "impulse"] = "hold"
    gain = np.hstack([2e-5 * np.eye(3), 6e-3 * np.eye(3)])

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return self.gain @ (ref - y), xc


class Loop:
    """A compiled closed loop; cases differ in attraction, start and what is seen."""

    TARGET = np.array([20e3, 0.0, 0.0, 0.0, 0.0, 0.0])

    def __init__(self) -> None:
        self._simulator = Simulator(
            Central(), Holding(), reference=self.TARGET, run_time=("gm",), method="rk6",
            navigation=NavigationErrors([10.0] * 3 + [1e-3] * 3),
        )  # fmt: skip

    def case_inputs(self) -> tuple[Parameter, ...]:
        return (Parameter("a", 0.0, ""), Parameter("b", 1.5, ""))

    def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
        x0 = np.tile(self.TARGET[:, None], LANES)
        x0[1] += 300.0 * batch.value("a", 0.0)
        gm = 7e5 * (1.0 + 0.1 * batch.value("b", 1.5))
        flown = self._simulator.fly(
            Cases(x0=x0, p=gm[None], numbers=batch.draws), 40, seed=batch.seed, stage=batch.stream
        )
        end = np.linalg.norm(flown.x[:3] - self.TARGET[:3, None], axis=0)
        failed = np.array([status != "completed" for status in flown.status])
        return CaseResults(
            ("dv_m_s", "end_m"), ("m/s", "m"), np.stack([flown.dv_m_s, end]), flown.status,
            flown.cause, failed,
        )  # fmt: skip
