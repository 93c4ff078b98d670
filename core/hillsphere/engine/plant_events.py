"""Event functions of a plant at given states, without a flight."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.interfaces.plant import ExternalEvents, Plant
from hillsphere.symbolic import constant, time, variable

__all__ = ["events_at"]


def events_at(
    plant: Plant, x: Array, t_s: Array, values: Mapping[str, float] | None = None
) -> dict[str, Array]:
    """Return the event functions of a plant at states.

    Parameters
    ----------
    plant : Plant
        The plant.
    x : ndarray, shape (n, K)
        States in the frame of the plant, SI.
    t_s : ndarray, shape (K,)
        Times, s.
    values : mapping of str to float, optional
        Parameters of the plant that differ from nominal, SI.

    Returns
    -------
    dict of str to ndarray, shape (K,)
        Positive while a flight may go on; NaN where it depends on a state that is NaN.
    """
    p = {q.name: (values or {}).get(q.name, q.value) for q in plant.parameters()}
    states = tuple(variable(v.name) for v in plant.states)
    events = plant.events(states, time, {name: constant(value) for name, value in p.items()})
    if not events:
        return {}
    terms = None
    if isinstance(plant, ExternalEvents) and plant.event_terms:
        outside, row = plant, np.array([*p.values()])[:, None]
        terms = (
            [variable(v.name) for v in plant.event_terms],
            lambda x, t, _: np.asarray(
                outside.event_terms_array(x, t, np.repeat(row, x.shape[1], axis=1))
            ),
        )
    function = ArrayFunction(list(events.values()), states, terms=terms)
    return dict(zip(events, function(x, t=t_s), strict=True))
