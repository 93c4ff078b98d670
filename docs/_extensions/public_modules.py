"""Modules whose public names the reference documents; all other modules are private."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["MODULES"]

MODULES: Mapping[str, tuple[str, ...]] = {
    "Runs and motion": ("hillsphere", "hillsphere.mission", "hillsphere.errors"),
    "Equations and their integration": (
        "hillsphere.symbolic", "hillsphere.dynamics", "hillsphere.simulation", "hillsphere.gravity",
        "hillsphere.lti", "hillsphere.time",
    ),
    "Results and their presentation": (
        "hillsphere.products", "hillsphere.products.fields", "hillsphere.presentation",
        "hillsphere.show.tables",
    ),
    "For plugins": (
        "hillsphere.plugins", "hillsphere.spec", "hillsphere.interfaces", "hillsphere.testing",
        "hillsphere.estimation", "hillsphere.sensor_suite",
    ),
    "Uncertainty": (
        "hillsphere.uncertainty.distribution", "hillsphere.uncertainty.distributions",
        "hillsphere.uncertainty.samples", "hillsphere.uncertainty.copula",
        "hillsphere.uncertainty.dispersed",
    ),
    "Control in the usual names": ("hillsphere_controllers",),
    "Linear systems and their analysis": tuple(
        f"hillsphere_controllers.{name}"
        for name in (
            "systems.algebra", "systems.balancing", "systems.bilinear", "systems.conversion",
            "systems.exchange", "systems.holding", "systems.interconnection", "systems.sampling",
            "systems.truncation", "systems.weights", "analysis.disk_margins", "analysis.frequency",
            "analysis.h2_norm", "analysis.hinf_norm", "analysis.margins", "analysis.sampled_loop",
            "analysis.stability", "analysis.worst_case_samples", "delays.algebra", "delays.cover",
            "delays.margin", "delays.norms", "delays.stability", "delays.system",
        )
    ),
    "Synthesis of controllers": tuple(
        f"hillsphere_controllers.{name}"
        for name in (
            "full_order.h2", "full_order.hinf", "full_order.lqg", "full_order.mixed_sensitivity",
            "full_order.sampled_data", "lmi.output_feedback", "lmi.polytopes", "lmi.state_feedback",
            "structured.bounded", "structured.requirements", "structured.scenarios",
            "structured.single_loop", "structured.structure", "structured.synthesis",
            "structured.verification", "dk.reduction", "dk.synthesis", "errors",
        )
    ),
    "Uncertain systems and µ": tuple(
        f"hillsphere_controllers.{name}"
        for name in (
            "linear_fractional.affine", "linear_fractional.algebra", "linear_fractional.fitting",
            "linear_fractional.left_out", "linear_fractional.polynomials",
            "linear_fractional.reduction",
            "linear_fractional.transformation", "linear_fractional.uncertainties", "mu.blocks",
            "mu.certified", "mu.division", "mu.lower_bound",
            "mu.robustness", "mu.sensitivities", "mu.upper_bound", "mu.worst_case",
            "mu.worst_case_gain",
        )
    ),
    "Estimation": (
        *(f"hillsphere_estimators.{name}" for name in (
            "unscented", "iterated_extended", "information", "sequential", "smoother",
            "gaussian_sum", "batch_gaussian_sum", "mixture", "batch_least_squares",
            "consistency", "verdict", "linearity", "remainders", "cramer_rao", "observability",
            "covariance_intersection", "bias_states", "fixed_lag", "plant_model",
        )),
        "hillsphere_sensors.camera_image", "hillsphere_sensors.lit_disc",
    ),
}  # fmt: skip
"""Heading → modules: the faces of the core, and the modules that the guides use."""
