"""Linear controllers as they come from a synthesis or a file, flown at samples."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.law_specs import LtiSpec
from hillsphere_controllers.systems.exchange import load_mat
from hillsphere_controllers.systems.sampling import sampled_controller

__all__ = ["Lti"]


class Lti:
    """u = K e, with K brought to the period of the samples, u held.

    Parameters
    ----------
    spec : LtiSpec
        Where the controller comes from. Without file and matrices the law waits for one.

    Raises
    ------
    InputError
        If the file has no such controller, or it does not fit the period.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: LtiSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self._sign = 1.0 if spec.sees == "error" else -1.0
        self._controller: LtiSystem | None = None
        given = _given(spec)
        if given is not None:
            self._take(given)

    @property
    def complete(self) -> bool:
        """Whether it has a controller."""
        return self._controller is not None

    def flying(self, controller: LtiSystem) -> Lti:
        """Return the law with this controller."""
        made = copy(self)
        made._take(controller)
        return made

    def _take(self, controller: LtiSystem) -> None:
        made = sampled_controller(controller, self.period_s, self.spec.method)
        self._controller = made
        self._all = np.block([[made.a, made.b], [made.c, made.d]])

    def initial(self, n_cases: int) -> Array:
        """Return the controller's states (m, N), zero."""
        return np.zeros((self._ready().order, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (p, N) and the states (m, N)."""
        made = self._ready()
        if len(y) != made.shape[1]:
            raise InputError(
                f"the controller takes {made.shape[1]} values, the law sees {len(y)}; name those "
                "that it was made for (sees of the flight)"
            )
        both: Array = self._all @ np.concatenate([xc, self._sign * (ref - y)])
        return both[made.order :], both[: made.order]

    def _ready(self) -> LtiSystem:
        if self._controller is None:
            raise InputError(
                "the law has no controller: give its matrices or a file, or the flight the "
                "synthesis as needs.controller"
            )
        return self._controller


def _given(spec: LtiSpec) -> LtiSystem | None:
    """Return the controller of the file or the matrices."""
    if spec.file is not None:
        path = Path(spec.file)
        found = load_mat(path)
        made = found.get(spec.variable)
        if not isinstance(made, LtiSystem):
            systems = [name for name, value in found.items() if isinstance(value, LtiSystem)]
            raise InputError(
                f"{path.name} has no system {spec.variable!r}; its systems: "
                f"{', '.join(systems) or 'none'}"
            )
        return made
    if not (spec.c or spec.d):
        return None
    m, p = len(spec.a), len(spec.c or spec.d)
    q = len((spec.b or spec.d)[0])
    shapes = {"a": (m, m), "b": (m, q), "c": (p, m), "d": (p, q)}
    a, b, c, d = (
        np.array(getattr(spec, key) or np.zeros(shape), dtype=float).reshape(shape)
        for key, shape in shapes.items()
    )
    return LtiSystem(a, b, c, d, None if spec.form == "continuous" else spec.period_s)
