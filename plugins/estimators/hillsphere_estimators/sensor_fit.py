"""Checks, when a mission is validated, that the sensors of a stage can be used in it.

The Spec of a sensor may state in `takes` the names of what it needs from the scene, and in `noise`
the size of its noise by the keys that set it. The Spec of a plant states in `gives` the names of
what its scene holds. A sensor that states nothing is not checked.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from hillsphere.spec import Ref, Spec

__all__ = ["BY_STAGE", "EARTH", "noiseless", "two_dates", "unseen"]

Place = tuple[str | int, ...]
Tables = Mapping[str, Mapping[str, Spec]]

BY_STAGE = ("boresight", "attitude")
"""Names that every stage adds to the scene."""
EARTH = ("earth", "earth_axes")
"""Names that a stage adds which knows of the Earth."""
_ANGLES = ("inclination", "node", "periapsis")


def noiseless(sensors: Iterable[tuple[Place, Ref]], tables: Tables) -> Iterator[tuple[Place, str]]:
    """Yield (location, message) for sensors without noise: a filter divides by its variance."""
    for place, ref in sensors:
        noise: Mapping[str, float] = getattr(tables.get("sensor", {}).get(ref.name), "noise", {})
        for keys, size in noise.items():
            if size == 0.0:
                message = (
                    f"sensor {ref.name!r} has no noise, {keys} = 0; a filter weighs each "
                    "measurement by its noise, which must be more than 0"
                )
                yield place, message


def unseen(
    sensors: Iterable[tuple[Place, Ref]],
    plants: Iterable[Ref],
    tables: Tables,
    earth: Ref | None = None,
    epoch: str | None = None,
    *,
    takes_earth: bool = True,
) -> Iterator[tuple[Place, str]]:
    """Yield (location, message) for sensors that would not find what they take from the scene.

    Parameters
    ----------
    sensors : iterable of (location, Ref)
        The sensors.
    plants : iterable of Ref
        The believed and the true plant.
    tables : mapping
        Kind → name → Spec.
    earth, epoch
        Keys of the stage.
    takes_earth : bool
        Whether the stage has such keys.
    """
    specs = [(ref.name, spec) for ref in plants if (spec := tables.get("plant", {}).get(ref.name))]
    for place, ref in sensors:
        taken: tuple[str, ...] = getattr(tables.get("sensor", {}).get(ref.name), "takes", ())
        for name, plant in specs:
            gives = (*BY_STAGE, *EARTH, *getattr(plant, "gives", ()))
            if lost := [repr(key) for key in taken if key not in gives]:
                message = (
                    f"sensor {ref.name!r} takes {', '.join(lost)} from the scene, and plant "
                    f"{name!r} gives none; take one of type 'proximity', or leave the sensor out"
                )
                yield place, message
            elif set(taken) & set(EARTH):
                needs = ["a stage that knows of the Earth (type 'navigation')"]
                if takes_earth:
                    needs = _earth_needs(plant, tables, earth, epoch)
                if needs:
                    yield (
                        place,
                        f"sensor {ref.name!r} stands on the Earth: needs {'; '.join(needs)}",
                    )


def two_dates(
    plants: Iterable[Ref], tables: Tables, epoch: str | None
) -> Iterator[tuple[Place, str]]:
    """Yield (location, message) if the stage and a body both state the date of time 0."""
    for ref in plants:
        body, own = _beginning(tables.get("plant", {}).get(ref.name), tables)
        if None not in (epoch, own) and own != epoch:
            message = (
                f"{epoch}, but plant {ref.name!r} begins with the mean anomaly of body {body!r}, "
                f"which is that at {own}; leave one of the two dates out"
            )
            yield ("epoch",), message


def _beginning(plant: Spec | None, tables: Tables) -> tuple[str | None, str | None]:
    """Return the name of a plant's body, and the date at which it says that the plant begins."""
    of = getattr(plant, "body", None)
    if not isinstance(of, Ref):
        return None, None
    body = tables.get("body", {}).get(of.name)
    begun = getattr(plant, "true_anomaly_rad", None) is not None
    if begun or getattr(body, "mean_anomaly_rad", None) is None:
        return of.name, None
    return of.name, getattr(body, "epoch", None)


def _earth_needs(plant: Spec, tables: Tables, earth: Ref | None, epoch: str | None) -> list[str]:
    """Return what is missing to compute the position of the Earth relative to the asteroid."""
    needs = [] if earth else ["earth (a body of type 'solar_orbit' or 'spice')"]
    name, own = _beginning(plant, tables)
    if own is None and epoch is None:
        needs.append("epoch (date and time, TDB, at which time is 0)")
    body = tables.get("body", {}).get(name or "")
    missing = [f"{key}_deg" for key in _ANGLES if getattr(body, f"{key}_rad", None) is None]
    if body is not None and missing:
        needs.append(f"{', '.join(missing)} of body {name!r}")
    return needs
