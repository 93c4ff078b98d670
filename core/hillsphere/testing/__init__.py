"""Conformance kit for authors of plugins: contract checks by kind of component.

Each check is a plain function that returns None (or the object that it made) if the component
fulfils the contract of its kind. Otherwise it raises `ContractViolation`, an `AssertionError`, with
the violated rule and the value. A plugin's tests call the checks with any test runner::

    import numpy as np
    import hillsphere_dumbbell
    from hillsphere.testing import check_gravity, check_plugin, example

    def test_plugin():
        check_plugin(hillsphere_dumbbell)

    def test_gravity():
        points = np.random.default_rng(1).normal(size=(3, 20)) * 30e3
        check_gravity(example("gravity", "dumbbell"), points)

`example` makes any installed component from the examples of its Spec.
"""

from hillsphere.testing.case_stages import check_case_stage
from hillsphere.testing.compensators import check_compensator
from hillsphere.testing.context import RecordingContext
from hillsphere.testing.contract import ContractViolation
from hillsphere.testing.estimators import check_estimator
from hillsphere.testing.examples import example, example_product
from hillsphere.testing.gravity import check_gravity
from hillsphere.testing.guidance import check_guidance
from hillsphere.testing.orbit_families import check_orbit_family
from hillsphere.testing.plants import check_plant
from hillsphere.testing.plugins import HEAVY_MODULES, check_plugin, check_spec
from hillsphere.testing.sensors import check_sensor
from hillsphere.testing.shapes import check_shape
from hillsphere.testing.stages import check_presentation, check_product, check_stage
from hillsphere.testing.trackers import check_tracker

__all__ = [
    "HEAVY_MODULES",
    "ContractViolation",
    "RecordingContext",
    "check_case_stage",
    "check_compensator",
    "check_estimator",
    "check_gravity",
    "check_guidance",
    "check_orbit_family",
    "check_plant",
    "check_plugin",
    "check_presentation",
    "check_product",
    "check_sensor",
    "check_shape",
    "check_spec",
    "check_stage",
    "check_tracker",
    "example",
    "example_product",
]
