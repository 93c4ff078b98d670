"""Spec of the stage on planar orbits of several revolutions: the keys of a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import (
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    need,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_orbits.options import VARY_INSTEAD, label
from hillsphere_orbits.qso.specs import read_resonance

__all__ = ["SwingFamiliesNeeds", "SwingFamiliesSpec"]

_SYMMETRIES = ("x", "y", "asymmetric")


class SwingFamiliesNeeds(Spec):
    """Products of earlier stages that ``swing_qso_families`` uses."""

    examples = ({"bifurcations": "bifurcations"},)

    bifurcations: Ref = need(
        "hillsphere.products:Bifurcations",
        "bifurcations at which the families branch off: the planar ones",
    )
    family: Ref | None = need(
        "hillsphere_orbits.qso.products:QsoFamily",
        "orbits of one revolution, drawn beside the families",
        default=None,
    )


class SwingFamiliesSpec(StageSpec):
    """Families of planar orbits of n revolutions that branch off at planar bifurcations d:n.

    Two families leave every resonance: an orbit of one crosses an axis perpendicularly outside
    the bifurcating orbit, of the other inside it (n and d odd; both axes then) or on the other
    axis. Where a mirror breaks along a family, asymmetric orbits branch off in turn.
    """

    instead_of_repeating = VARY_INSTEAD
    results = ResultNames(
        metrics=(
            "swing_closure_max",
            "swing_closure_over_lambda_max",
            "swing_half_closure_max",
            "swing_families",
            "swing_asymmetric_families",
        ),
        tables={
            "swing_families": (),
            "swing_members": (),
            "swing_events": (),
        },
    )
    produces = "hillsphere_orbits.swing_qso_families.products:SwingFamilies"
    provides = ("hillsphere.products:OrbitSet",)
    examples = (
        {
            "plant": "hill",
            "needs": {"bifurcations": "bifurcations"},
            "resonances": ["1:4"],
            "curve_length": 1,
        },
        {
            "plant": "hill",
            "needs": {"bifurcations": "bifurcations", "family": "family"},
            "symmetries": ["x"],
            "jacobi_constants": [-1.4],
            "x_max_km": 60,
        },
    )

    needs: SwingFamiliesNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion of the bifurcations")
    resonances: tuple[str, ...] = option(
        "which planar bifurcations d:n to start from; left out: all that were found", default=()
    )
    symmetries: tuple[Literal["x", "y", "asymmetric"], ...] = option(
        "which families: of orbits symmetric about the x axis, about the y axis, and of those "
        "without a mirror that branch off them (or off the resonance, if the gravity has no "
        "mirror)",
        default=_SYMMETRIES,
    )
    jacobi_constants: tuple[float, ...] = option(
        "orbits asked for of every family, by Jacobi constant in natural units", default=()
    )
    periods_s: tuple[float, ...] = quantity(
        "time", "orbits asked for of every family, by the period of all revolutions",
        default=(), gt=0,
    )  # fmt: skip
    x_min_m: float | None = quantity(
        "length",
        "distance from the centre of mass at which a family ends; left out: at the surface, or "
        "without one where the gravity is sure to converge, at least a tenth of a natural unit",
        default=None,
        gt=0,
    )
    x_max_m: float | None = quantity(
        "length",
        "largest |x| at which a family ends; left out: three times that of its bifurcation",
        default=None,
        gt=0,
    )
    curve_length: float = option(
        "arclength at which a family ends, in natural units of its initial state and period",
        default=60.0,
        gt=0,
        le=1000,
    )
    secondary: bool = option(
        "locate the secondary bifurcations along the families by kind", default=True
    )
    accuracy: float = option(
        "half-period residual that every orbit must keep when it is propagated anew, natural "
        "units; one that does not ends its family",
        default=1e-10,
        ge=1e-13,
        le=1e-4,
    )
    label: str = label()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for text in self.resonances:
            if read_resonance(text) is None:
                raise rule("resonances", f"expected d:n such as '2:5', got {text[:40]!r}")
        for key in ("resonances", "symmetries", "jacobi_constants", "periods_s"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a value is listed twice")
        if not self.symmetries:
            raise rule("symmetries", "no family is asked for; give x, y or asymmetric")
        low, high = self.x_min_m, self.x_max_m
        if low is not None and high is not None and low >= high:
            raise rule("x_min_m", "the smallest distance must be below the largest")
        return self
