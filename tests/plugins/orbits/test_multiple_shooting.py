"""Multiple shooting: continuous flights nearest to given nodes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.multiple_shooting import reconverge

GM = 7.0875e5
N = np.sqrt(42828.37e9 / 9377e3**3)
KM = 1e3


class TabulatedPointMass:
    """A point mass that hides its formula, as a table would."""

    frame = "body"
    gm_m3_s2 = GM

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(GM / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-GM * r / np.linalg.norm(r, axis=0) ** 3)

    def gradient_array(self, r: Array, p: Array) -> Array:
        d = np.linalg.norm(r, axis=0)
        outer = 3.0 * r[:, None] * r[None] / d**5
        return np.asarray(GM * (outer - np.eye(3)[:, :, None] / d**3))


@cache
def hill(kind: str = "point_mass") -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0
    )
    gravity = create("gravity", "point_mass", gm_m3_s2=GM) if kind != "array" else None
    return create("plant", "hill", body=body, gravity=gravity or TabulatedPointMass())


def flights(arcs: int = 12, cases: int = 3) -> tuple[Array, Array]:
    """Return times and nodes of true flights about the moon, SI."""
    flow = flow_of(hill())
    x0 = np.zeros((6, cases))
    x0[0] = np.linspace(1.2, 2.5, cases)
    x0[2] = 0.3
    x0[4] = -2.2 * x0[0]
    nodes = flow.plain.trajectory(x0, 0.6 * arcs, 40 * arcs)[:, ::40]
    t = np.linspace(0.0, 0.6 * arcs, arcs + 1) * flow.system.time_unit_s
    return t, nodes * flow.system.unit[:, None, None]


def disturbed(nodes: Array, size: float) -> Array:
    unit = flow_of(hill()).system.unit[:, None, None]
    return np.asarray(nodes + size * unit * np.random.default_rng(3).normal(size=nodes.shape))


def test_gaps_close_and_scipy_agrees() -> None:
    t, nodes = flights()
    found = reconverge(hill(), t, disturbed(nodes, 1e-2))
    assert found.converged.all()
    assert np.max(found.gap) < 1e-10
    assert found.reasons == ("",) * 3
    assert np.all(found.iterations >= 2)

    def motion(_: float, y: Array) -> Array:
        pull = -GM * y[:3] / np.linalg.norm(y[:3]) ** 3
        return np.array(
            [*y[3:], 2 * N * y[4] + 3 * N**2 * y[0] + pull[0],
             -2 * N * y[3] + pull[1], -(N**2) * y[2] + pull[2]]
        )  # fmt: skip

    for lane in range(3):
        flown = solve_ivp(
            motion, (0, t[-1]), found.x[:, 0, lane], method="DOP853", t_eval=t, rtol=1e-12,
            atol=1e-9,
        ).y  # fmt: skip
        np.testing.assert_allclose(flown[:3], found.x[:3, :, lane], rtol=0, atol=1e-2)


def test_flight_is_the_nearest() -> None:
    """The displacement is orthogonal to every change of the flight that keeps it continuous."""
    t, nodes = flights(arcs=8, cases=1)
    unit = flow_of(hill()).system.unit
    given = disturbed(nodes, 1e-3)
    found = reconverge(hill(), t, given)
    away = (found.x - given)[:, :, 0] / unit[:, None]
    flow = flow_of(hill())
    x, phi = found.x[:, 0] / unit[:, None], np.eye(6)
    tangents = [phi]
    for step in np.diff(t) / flow.system.time_unit_s:
        x, one = flow.with_matrix(x, step, 60)
        phi = one[:, :, 0] @ phi
        tangents.append(phi)
    slope = sum(tangents[k].T @ away[:, k] for k in range(len(t)))
    size = np.sqrt(sum(np.sum(tangent**2, axis=0) for tangent in tangents))
    assert np.max(np.abs(slope / size)) < 1e-3 * np.linalg.norm(away)
    assert np.linalg.norm(away) < np.linalg.norm((given - nodes)[:, :, 0] / unit[:, None])


def test_held_states_stay() -> None:
    """The ends of a transfer: positions held, velocities free."""
    t, nodes = flights()
    given = disturbed(nodes, 3e-3)
    freedom = np.ones((6, len(t)))
    freedom[:3, [0, -1]] = 0.0
    found = reconverge(hill(), t, given, freedom=freedom)
    assert found.converged.all()
    np.testing.assert_allclose(found.x[:3, [0, -1]], given[:3, [0, -1]], rtol=0, atol=1e-9)
    assert np.max(np.abs(found.x[3:, 0] - given[3:, 0])) > 1e-4


def test_true_flights_are_left_alone() -> None:
    t, nodes = flights()
    found = reconverge(hill(), t, nodes)
    assert found.converged.all()
    np.testing.assert_allclose(found.x, nodes, rtol=0, atol=1e-6)


def test_flights_do_not_depend_on_each_other() -> None:
    t, nodes = flights()
    given = disturbed(nodes, 1e-2)
    together = reconverge(hill(), t, given)
    alone = reconverge(hill(), t, given[:, :, 1:2])
    np.testing.assert_allclose(alone.x[:, :, 0], together.x[:, :, 1], rtol=0, atol=1e-4)


def test_a_flight_that_cannot_be_is_a_row() -> None:
    t, nodes = flights()
    given = disturbed(nodes, 1e-2)
    given[:, 4, 1] = 0.0  # at rest in the centre of the moon
    found = reconverge(hill(), t, given)
    assert found.converged.tolist() == [True, False, True]
    assert "centre" in found.reasons[1]
    assert np.isnan(found.gap[1])
    assert np.array_equal(found.x[:, :, 1], given[:, :, 1])


def test_gravity_from_arrays() -> None:
    t, nodes = flights(arcs=3, cases=2)
    given = disturbed(nodes, 1e-3)
    found = reconverge(hill("array"), t, given)
    assert found.converged.all()
    expected = reconverge(hill(), t, given)
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-4)


def test_bad_input_is_named() -> None:
    t, nodes = flights()
    with pytest.raises(InputError, match="nodes must be"):
        reconverge(hill(), t, nodes[:5])
    with pytest.raises(InputError, match="rising times"):
        reconverge(hill(), t[::-1], nodes)
    with pytest.raises(InputError, match="rising times"):
        reconverge(hill(), t[:-1], nodes)
    with pytest.raises(InputError, match="freedom must be"):
        reconverge(hill(), t, nodes, freedom=np.ones((6, 2)))
    with pytest.raises(InputError, match="more freedom"):
        reconverge(hill(), t, disturbed(nodes, 1e-3), freedom=np.zeros((6, len(t))))
