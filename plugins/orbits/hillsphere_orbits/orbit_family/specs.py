"""Spec of the stage ``orbit_family``: the keys of a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, option, quantity, reference, rule
from hillsphere_orbits.options import VARY_INSTEAD, label

__all__ = ["OrbitFamilySpec", "VarySpec"]

_ASKED = ("amplitudes_m", "periods_s", "jacobi_constants")


class VarySpec(Spec):
    """A parameter of the equations that changes, in its own SI unit."""

    examples = (
        {"parameter": "gravity.density", "to": 1900.0},
        {"parameter": "gravity.axis_x", "start": 11100.0, "to": 13030.0},
    )

    parameter: str = option(
        "name among the plant's parameters: 'mean_motion', 'gravity.axis_x' …; its mass is "
        "'gravity.gm' where the gravity is given by its GM, 'gravity.density' by its density",
        min_length=1,
        max_length=100,
    )
    to: float = option("value at the end of the path, SI")
    start: float | None = option(
        "value at the start of the path, SI; left out: the plant's own", default=None
    )


class OrbitFamilySpec(StageSpec):
    """A family of periodic orbits, its members at prescribed values, carried along other equations.

    The family is one that is declared in a table of its own, or the one to which an orbit near a
    guess belongs. Orbits are asked for by amplitude (as the family measures it; x at the start
    with a guess), period or integral of motion. With `vary`, the parameters of the equations then
    change along a straight line, all together, while the quantity by which an orbit was asked for
    (or the one named in `hold`) keeps its value; what is returned are the orbits at the end.
    """

    instead_of_repeating = VARY_INSTEAD
    results = ResultNames(
        metrics=(
            "orbits_asked_for",
            "orbits_found",
            "largest_closure",
        ),
        tables={
            "orbit_family": (),
            "orbit_family_parameters": (),
        },
    )
    produces = "hillsphere_orbits.orbit_family.products:FollowedFamily"
    provides = ("hillsphere.products:OrbitSet",)
    examples = (
        {
            "plant": "hill",
            "guess": {"x": 2.0, "vy": -4.1, "period": 5.8},
            "amplitudes_km": [50],
            "curve_members": 21,
        },
        {"family": "halo", "amplitudes_km": [5], "periods_h": [3.5]},
        {
            "family": "qso",
            "jacobi_constants": [-1.0],
            "vary": [{"parameter": "mean_motion", "to": 2.3e-4}],
        },
    )

    family: Ref | None = reference("orbit_family", "the family", default=None)
    plant: Ref | None = reference(
        "plant", "instead of a family: the equations of an orbit near a guess", default=None
    )
    guess: dict[str, float] = option(
        "with plant: states at the start, where the orbit crosses y = 0, and its full period, in "
        "the plant's natural units; states left out are zero, and an orbit without z and vz is "
        "sought in the plane z = 0",
        default={},
    )
    amplitudes_m: tuple[float, ...] = quantity(
        "length", "orbits asked for, by amplitude", default=(), gt=0
    )
    periods_s: tuple[float, ...] = quantity("time", "orbits asked for, by period", default=(), gt=0)
    jacobi_constants: tuple[float, ...] = option(
        "orbits asked for, by the plant's integral of motion in its natural units", default=()
    )
    amplitude_min_m: float | None = quantity(
        "length",
        "where the family is to begin; left out: where it begins by itself, with a guess at half "
        "its amplitude at most",
        default=None,
        gt=0,
    )
    amplitude_max_m: float | None = quantity(
        "length",
        "where the family is to end; left out: a little beyond the largest amplitude asked for, "
        "and where orbits are asked for otherwise at four natural units of length; with a guess at "
        "twice its amplitude at least",
        default=None,
        gt=0,
    )
    curve_members: int = option("orbits along the family", default=81, ge=21, le=4001)
    vary: tuple[VarySpec, ...] = option("parameters of the equations that change", default=())
    hold: Literal["amplitude", "period", "jacobi"] | None = option(
        "quantity held as the parameters change; left out: the quantity that selected the orbit",
        default=None,
    )
    method: Literal["arclength", "natural"] = option(
        '"arclength" passes the folds at which the parameters turn back, "natural" steps through '
        "the parameters, all orbits at once",
        default="arclength",
    )
    accuracy: float = option(
        "closure relative to size, natural units, that every orbit must keep propagated anew",
        default=1e-11,
        ge=1e-12,
        le=1e-4,
    )
    label: str = label()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.plant is None) == (self.family is None):
            if self.plant is not None:
                raise rule("family", "plant and family both name the equations; keep one")
            raise rule("family", "missing: family, or plant with a guess")
        if self.plant is not None and "x" not in self.guess:
            raise rule("guess", "missing beside plant: at least x, vy and period of an orbit")
        if self.plant is not None and self.guess.get("period", 0.0) <= 0.0:
            raise rule("guess", "a period > 0 is missing")
        if self.family is not None and self.guess:
            raise rule("guess", "goes with plant; a family knows where it begins")
        if not any(getattr(self, key) for key in _ASKED):
            text = "no orbit is asked for; give amplitudes_km, periods_h or jacobi_constants"
            raise rule("amplitudes_m", text)
        for key in _ASKED:
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a value is listed twice")
        low, high = self.amplitude_min_m, self.amplitude_max_m
        if low is not None and high is not None and low >= high:
            raise rule("amplitude_min_m", "the smallest amplitude must be below the largest")
        outside = [
            f"{a / 1e3:g} km"
            for a in self.amplitudes_m
            if (low is not None and a < low) or (high is not None and a > high)
        ]
        if outside:
            text = f"outside the range from amplitude_min to amplitude_max: {', '.join(outside)}"
            raise rule("amplitudes_m", text)
        names = [v.parameter for v in self.vary]
        if len(set(names)) < len(names):
            raise rule("vary", "a parameter is listed twice")
        if not self.vary and {"hold", "method"} & self.model_fields_set:
            raise rule("vary", "hold and method say how parameters change; name some in vary")
        return self
