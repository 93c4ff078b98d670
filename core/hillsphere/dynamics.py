"""Compilation and propagation of equations of motion in `hillsphere.symbolic` expressions.

`Motion` propagates a plant in SI units. Below it, `system` makes equations of a plant, `StepMap`
and `Taylor` propagate them, `Derivatives` and `ArrayFunction` evaluate them.
"""

from hillsphere.engine.dynamics.brackets import Brackets, ProvedBrackets
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.crossing import Crossing
from hillsphere.engine.dynamics.root_finding import bracketed_roots
from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.dynamics.system import External, System, system
from hillsphere.engine.dynamics.tableaux import Tableau, tableau
from hillsphere.engine.dynamics.taylor import Flight, Taylor
from hillsphere.engine.dynamics.variational import Derivatives, variational_equations
from hillsphere.engine.motion import Event, Motion, Trajectory

__all__ = [
    "ArrayFunction",
    "Brackets",
    "Crossing",
    "Derivatives",
    "Event",
    "External",
    "Flight",
    "Motion",
    "ProvedBrackets",
    "StepMap",
    "System",
    "Tableau",
    "Taylor",
    "Trajectory",
    "bracketed_roots",
    "system",
    "tableau",
    "variational_equations",
]
