"""Specs of the orbit families and stages: the keys of a mission."""

from __future__ import annotations

from math import gcd
from typing import Any, Self

from pydantic import model_validator

from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_orbits.options import VARY_INSTEAD, label

__all__ = [
    "BifurcationNeeds",
    "BifurcationSpec",
    "QsoFamilyNeeds",
    "QsoFamilySpec",
    "QsoSpec",
    "read_resonance",
]

_FAMILY = "hillsphere_orbits.qso.products:QsoFamily"


def _accuracy() -> Any:
    return option(
        "closure and drift of the Jacobi constant, relative to size, natural units, that every "
        "orbit must keep when it is propagated anew; raise it for gravity that is not smooth",
        default=1e-11,
        ge=1e-12,
        le=1e-4,
    )


class QsoSpec(Spec):
    """Quasi-satellite orbits of a plant."""

    examples = ({"plant": "hill"},)

    plant: Ref = reference("plant", "equations of motion about a locked moon, e.g. 'hill'")
    accuracy: float = _accuracy()


class _OfFamily(StageSpec):
    """Options common to the stages: the family's equations."""

    instead_of_repeating = VARY_INSTEAD

    plant: Ref | None = reference(
        "plant", "equations of motion; their quasi-satellite orbits are meant", default=None
    )
    family: Ref | None = reference(
        "orbit_family", "the family, where it is declared in a table of its own", default=None
    )
    accuracy: float = _accuracy()
    label: str = label()

    @model_validator(mode="after")
    def _one_family(self) -> Self:
        if (self.plant is None) == (self.family is None):
            if self.plant is not None:
                raise rule("family", "plant and family say the same thing; keep one")
            raise rule("plant", "missing: plant (or family); which equations the orbits solve")
        if self.family is not None and "accuracy" in self.model_fields_set:
            raise rule("accuracy", "belongs in the table of the family that is named here")
        return self


class QsoFamilyNeeds(Spec):
    """Products of earlier stages that ``qso_family`` can use."""

    compare: Ref | None = need(
        _FAMILY, "another family, over whose range this one is computed and shown", default=None
    )


class QsoFamilySpec(_OfFamily):
    """The family of quasi-satellite orbits and its members at prescribed values.

    An amplitude is x at the crossing of the x axis on the far side from the primary.
    """

    results = ResultNames(
        metrics=(
            "closure_max",
            "jacobi_drift_max",
            "determinant_error_max",
            "planar_index_largest",
            "vertical_index_largest",
            "x0_largest",
            "x0_smallest",
            "gravity_error_max",
        ),
        tables={
            "table_1": (
                "name",
                "x0_km",
                "y_max_km",
                "vy_m_s",
                "vx_m_s",
                "period_h",
                "jacobi",
                "vy0",
                "period",
                "b_planar",
                "b_vertical",
            ),
        },
    )
    produces = _FAMILY
    provides = ("hillsphere.products:OrbitSet",)
    examples = (
        {"plant": "hill", "x_amplitudes_km": [100, 50], "curve_members": 41},
        {"plant": "hill", "periods_h": [7.0], "jacobi_constants": [-1.0], "x_max_km": 120},
    )

    needs: QsoFamilyNeeds = option("products of earlier stages", default=QsoFamilyNeeds())
    x_amplitudes_m: tuple[float, ...] = quantity(
        "length", "orbits asked for, by amplitude", default=(), gt=0
    )
    periods_s: tuple[float, ...] = quantity("time", "orbits asked for, by period", default=(), gt=0)
    jacobi_constants: tuple[float, ...] = option(
        "orbits asked for, by Jacobi constant: ½(3x² − z²) + U − ½v² in natural units", default=()
    )
    x_min_m: float | None = quantity(
        "length",
        "smallest amplitude of the family; left out: that of the family compared with, or the "
        "orbit that grazes the surface",
        default=None,
        gt=0,
    )
    x_max_m: float | None = quantity(
        "length",
        "largest amplitude of the family; left out: that of the family compared with, or a little "
        "beyond the largest one asked for, at least 4 natural units",
        default=None,
        gt=0,
    )
    curve_members: int = option(
        "orbits along the family, for figures and for searches along it",
        default=161,
        ge=21,
        le=4001,
    )
    drift_revolutions: int = option(
        "revolutions over which the drift of the Jacobi constant is measured",
        default=100,
        ge=1,
        le=10000,
    )
    reference: DataPath | None = data_path(
        "cited CSV of published orbits, matched by x0_km, shown beside the computed ones",
        default=None,
    )

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        if not (self.x_amplitudes_m or self.periods_s or self.jacobi_constants):
            raise rule(
                "x_amplitudes_m",
                "no orbit is asked for; give x_amplitudes_km, periods_h or jacobi_constants",
            )
        for key in ("x_amplitudes_m", "periods_s", "jacobi_constants"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a value is listed twice")
        low, high = self.x_min_m, self.x_max_m
        if low is not None and high is not None and low >= high:
            raise rule("x_min_m", "the smallest amplitude must be below the largest")
        outside = [
            f"{x / 1e3:g} km"
            for x in self.x_amplitudes_m
            if (low is not None and x < low) or (high is not None and x > high)
        ]
        if outside:
            text = f"outside the range from x_min to x_max: {', '.join(outside)}"
            raise rule("x_amplitudes_m", text)
        return self


class BifurcationNeeds(Spec):
    """Products of earlier stages that ``bifurcations`` uses."""

    family: Ref = need(_FAMILY, "the family that is searched")
    compare: Ref | None = need(
        _FAMILY, "another family, shown beside it in the figure", default=None
    )


class BifurcationSpec(_OfFamily):
    """Where other families branch off a family: its stability index is 2 cos(2π d/n)."""

    results = ResultNames(
        tables={
            "bifurcations": (
                "plane",
                "resonance",
                "d",
                "n",
                "x0_km",
                "period",
                "period_h",
                "vy0",
                "jacobi",
                "b",
            ),
        },
    )
    produces = "hillsphere.products:Bifurcations"
    examples = (
        {"plant": "hill", "needs": {"family": "family"}, "vertical": ["1:5"], "planar": ["1:4"]},
        {"plant": "hill", "needs": {"family": "family"}, "n_max": 7, "d_max": 2},
    )

    needs: BifurcationNeeds = option("products of earlier stages")
    vertical: tuple[str, ...] = option(
        "out-of-plane resonances d:n, orbits of n revolutions", default=()
    )
    planar: tuple[str, ...] = option("in-plane resonances d:n", default=())
    n_max: int | None = option(
        "search every resonance of both planes up to this n as well", default=None, ge=1, le=100
    )
    d_max: int = option("with n_max: largest d of these resonances", default=1, ge=1, le=50)

    @model_validator(mode="after")
    def _resonances(self) -> Self:
        for key in ("vertical", "planar"):
            listed = getattr(self, key)
            for text in listed:
                if fault := _fault_of(text):
                    raise rule(key, fault)
            if len(set(listed)) < len(listed):
                raise rule(key, "a resonance is listed twice")
        if not (self.vertical or self.planar or self.n_max):
            raise rule("vertical", "no resonance is asked for; give vertical, planar or n_max")
        return self


def read_resonance(text: str) -> tuple[int, int] | None:
    """Return (d, n) of ``"d:n"``, or None if it is not written so."""
    d, colon, n = text.partition(":")
    if not (colon and d.isascii() and n.isascii() and d.isdigit() and n.isdigit()):
        return None
    if len(d) > 4 or len(n) > 4 or int(d) < 1 or int(n) < 1:
        return None
    return int(d), int(n)


def _fault_of(text: str) -> str:
    """Return the fault of a resonance; empty without one."""
    pair = read_resonance(text)
    if pair is None:
        return f"expected d:n such as '1:17', got {text[:40]!r}"
    d, n = pair
    if (common := gcd(d, n)) > 1:
        return f"{text} is {d // common}:{n // common}; write it so"
    if n == 1:
        return "" if d == 1 else f"{text} is 1:1; write it so"
    if 2 * d > n:
        same = abs((d + n // 2) % n - n // 2)
        return f"{text} has the stability index of {same}:{n}; write it so"
    return ""
