"""Interfaces between the core and its plugins: one small Protocol per kind of component.

A component is made from its bound `Spec` and holds configuration, no hidden state. N is always
the number of independent cases, the last axis of an array.
"""

from __future__ import annotations

from hillsphere.base.arrays import Array, Integers
from hillsphere.interfaces.control import Compensator, SynthesisedLaw
from hillsphere.interfaces.dispersion import Dispersion
from hillsphere.interfaces.estimation import (
    AngularModel,
    ConsiderModel,
    EstimationModel,
    Estimator,
    LinearisedModel,
)
from hillsphere.interfaces.file_formats import ElementFormat, FileFormat, StatedOrbit
from hillsphere.interfaces.gravity import (
    ArrayGravityModel,
    BoundedGravity,
    BoundedSeries,
    GravityModel,
    Piecewise,
    SeriesGravity,
)
from hillsphere.interfaces.guidance import Guidance, GuidanceTask, GuidedFlight
from hillsphere.interfaces.orbits import OrbitFamily, OrbitProblem
from hillsphere.interfaces.plant import (
    ArrayConserved,
    ConservedQuantity,
    ExternalEvents,
    ExternalInputs,
    MirrorSymmetry,
    PiecewisePlant,
    Plant,
    TimedPlant,
)
from hillsphere.interfaces.quantities import Parameter, Scales, Variable
from hillsphere.interfaces.sensing import Channel, Scene, Sensor, StationSensor
from hillsphere.interfaces.stages import CaseStage, Context, NeedsCheck, Stage
from hillsphere.interfaces.surface import ArraySurface, Described, Enclosed, SlopedSurface, Surface
from hillsphere.interfaces.tracking import State, Tracker

__all__ = [
    "AngularModel",
    "Array",
    "ArrayConserved",
    "ArrayGravityModel",
    "ArraySurface",
    "BoundedGravity",
    "BoundedSeries",
    "CaseStage",
    "Channel",
    "Compensator",
    "ConservedQuantity",
    "ConsiderModel",
    "Context",
    "Described",
    "Dispersion",
    "ElementFormat",
    "Enclosed",
    "EstimationModel",
    "Estimator",
    "ExternalEvents",
    "ExternalInputs",
    "FileFormat",
    "GravityModel",
    "Guidance",
    "GuidanceTask",
    "GuidedFlight",
    "Integers",
    "LinearisedModel",
    "MirrorSymmetry",
    "NeedsCheck",
    "OrbitFamily",
    "OrbitProblem",
    "Parameter",
    "Piecewise",
    "PiecewisePlant",
    "Plant",
    "Scales",
    "Scene",
    "Sensor",
    "SeriesGravity",
    "SlopedSurface",
    "Stage",
    "State",
    "StatedOrbit",
    "StationSensor",
    "Surface",
    "SynthesisedLaw",
    "TimedPlant",
    "Tracker",
    "Variable",
]
