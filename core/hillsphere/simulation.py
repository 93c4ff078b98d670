"""The closed loop: plant, navigation, law and actuator, N cases at once.

`simulate` flies cases once; `Simulator` compiles a plant and a law for many flights. Around them:
laws (`hillsphere.interfaces.Compensator` at samples, `ContinuousLaw` between them too), what they
see (`Navigation`), follow (`Reference`) and command (`Actuator`), and what ends a flight (the
plant's events, `Limit`, a budget). `Flights` says how each case ended.
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
