"""The engine: what is written in `hillsphere.symbolic`, compiled and propagated.

`system` makes equations of a plant; `StepMap` and `Taylor` propagate them, `Derivatives` and
`ArrayFunction` evaluate them.
"""

from hillsphere.dynamics.brackets import Brackets, ProvedBrackets
from hillsphere.dynamics.compiled import ArrayFunction
from hillsphere.dynamics.crossing import Crossing
from hillsphere.dynamics.root_finding import bracketed_roots
from hillsphere.dynamics.step_map import StepMap
from hillsphere.dynamics.system import External, System, system
from hillsphere.dynamics.tableaux import Tableau, tableau
from hillsphere.dynamics.taylor import Flight, Taylor
from hillsphere.dynamics.variational import Derivatives, variational_equations

__all__ = [
    "ArrayFunction",
    "Brackets",
    "Crossing",
    "Derivatives",
    "External",
    "Flight",
    "ProvedBrackets",
    "StepMap",
    "System",
    "Tableau",
    "Taylor",
    "bracketed_roots",
    "system",
    "tableau",
    "variational_equations",
]
