"""The closed loop: plant, navigation, law and actuator, N cases at once.

`simulate` flies cases once; `Simulator` compiles a plant and a law for many flights. Around them:
laws (`hillsphere.interfaces.Compensator` at samples, `ContinuousLaw` between them too), what they
see (`Navigation`), follow (`Reference`) and command (`Actuator`), and what ends a flight (the
plant's events, `Limit`, a budget). `Flights` says how each case ended.
"""

from hillsphere.seeds import draws
from hillsphere.simulation.actuators import Thruster
from hillsphere.simulation.block import BLOCK
from hillsphere.simulation.cases import Cases
from hillsphere.simulation.driver import Simulator, simulate
from hillsphere.simulation.legs import Limit
from hillsphere.simulation.navigation import NavigationErrors, PerfectNavigation, SeenStates
from hillsphere.simulation.outcomes import STATUSES, Flights, History
from hillsphere.simulation.protocols import (
    Actuator,
    CommandSteps,
    ContinuousLaw,
    KnownPoles,
    Navigation,
    Reference,
)
from hillsphere.simulation.recording import Moment, Observer
from hillsphere.simulation.references import (
    FixedReference,
    PhaseReference,
    SampledReference,
    ZeroReference,
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
