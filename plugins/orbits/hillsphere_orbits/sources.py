"""Members of families of any kind as one set of orbits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.errors import StageError
from hillsphere.products import OrbitSet, PeriodicOrbits

__all__ = ["members_of"]


def members_of(*families: OrbitSet) -> PeriodicOrbits:
    """Return the members of all families given, in order, as one set.

    Parameters
    ----------
    *families : OrbitSet
        Products of stages.

    Returns
    -------
    PeriodicOrbits
        All of them; labels as they were, numbered where two orbits have the same.

    Raises
    ------
    StageError
        If they differ in frame, states or units, or there is none.
    """
    sets = [family.members for family in families]
    if not sets:
        raise StageError("no family is given")
    first = sets[0]
    for other in sets[1:]:
        for name in ("frame", "states", "length_m", "time_s"):
            if (mine := getattr(first, name)) != (theirs := getattr(other, name)):
                raise StageError(
                    f"orbits of families in different {name}: {mine!r} and {theirs!r}; compute "
                    "them with the same plant"
                )
    return replace(
        first,
        x0=np.concatenate([o.x0 for o in sets], axis=1),
        period_s=np.concatenate([o.period_s for o in sets]),
        integral=np.concatenate([o.integral for o in sets]),
        monodromy=np.concatenate([o.monodromy for o in sets], axis=2),
        residual=np.concatenate([o.residual for o in sets]),
        labels=_distinct([label for o in sets for label in o.labels]),
    )


def _distinct(labels: list[str]) -> tuple[str, ...]:
    """Return unique labels: from the second of a name on they are numbered."""
    names: dict[str, None] = {}
    for label in labels:
        name, number = label, 1
        while name in names:
            number += 1
            name = f"{label} #{number}"
        names[name] = None
    return tuple(names)
