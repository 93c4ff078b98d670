"""Closed-loop simulation of plant, navigation, control law and actuator for N cases at once.

`simulate` flies cases once; `Simulator` compiles a plant and a law for many flights. Laws are
sampled (`hillsphere.interfaces.Compensator`) or continuous (`ContinuousLaw`); their input comes
from a `Navigation`, their reference from a `Reference`, and an `Actuator` executes their command.
Flights end by the plant's events, a `Limit`, or a Δv budget. `Flights` holds the results.
"""

from hillsphere.base.seeds import draws
from hillsphere.engine.simulation.actuators import Thruster
from hillsphere.engine.simulation.block import BLOCK
from hillsphere.engine.simulation.cases import Cases
from hillsphere.engine.simulation.driver import Simulator, simulate
from hillsphere.engine.simulation.legs import Limit
from hillsphere.engine.simulation.navigation import NavigationErrors, PerfectNavigation, SeenStates
from hillsphere.engine.simulation.outcomes import STATUSES, Flights, History
from hillsphere.engine.simulation.recording import Moment, Observer
from hillsphere.engine.simulation.references import (
    FixedReference,
    PhaseReference,
    SampledReference,
    ZeroReference,
)
from hillsphere.interfaces.loop import (
    Actuator,
    CommandSteps,
    ContinuousLaw,
    JointLaw,
    KnownPoles,
    Navigation,
    Reference,
)

__all__ = [
    "BLOCK",
    "STATUSES",
    "Actuator",
    "Cases",
    "CommandSteps",
    "ContinuousLaw",
    "FixedReference",
    "Flights",
    "History",
    "JointLaw",
    "KnownPoles",
    "Limit",
    "Moment",
    "Navigation",
    "NavigationErrors",
    "Observer",
    "PerfectNavigation",
    "PhaseReference",
    "Reference",
    "SampledReference",
    "SeenStates",
    "Simulator",
    "Thruster",
    "ZeroReference",
    "draws",
    "simulate",
]
