"""Where two families in space nearly meet: a family ends before, and nothing else is lost.

Of the orbits around Deimos born in the vertical resonance 1:17 at x = 10.4 km, those of z > 4 km
come near another family: between two members the least singular value of the equations passes zero,
and no orbit lies where the curve through them leads (the nearest ones are 30 m aside).
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.products import Bifurcations
from hillsphere.testing import RecordingContext
from hillsphere_orbits.spatial_qso_families import group as spatial_group
from hillsphere_orbits.spatial_qso_families.crossings import _changes, count_connected
from hillsphere_orbits.spatial_qso_families.family import Spatial
from hillsphere_orbits.spatial_qso_families.group import BETWEEN, LEAPS
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies


@cache
def deimos() -> Any:
    moon = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=23458)
    gravity = create("gravity", "ellipsoid", axes_km=[7.8, 6.0, 5.1], gm_km3_s2=9.62e-5)
    return create("plant", "hill", body=moon, gravity=gravity)


@cache
def bifurcations() -> Bifurcations:
    plant = deimos()
    keys = {"x_amplitudes_km": [10.4], "x_min_km": 9.8, "x_max_km": 10.6, "curve_members": 31}
    family = create("stage", "qso_family", plant=plant, drift_revolutions=1, **keys)
    stage = create(
        "stage",
        "bifurcations",
        plant=plant,
        needs={"family": "family"},
        vertical=["1:17", "1:27"],
        n_max=1,
    )
    found = stage.run(RecordingContext(), family=family.run(RecordingContext()))
    assert isinstance(found, Bifurcations)
    return found


def run(*z_km: float, resonance: str = "1:17") -> SpatialFamilies:
    stage = create(
        "stage", "spatial_qso_families", plant=deimos(), needs={"bifurcations": "bifurcations"},
        resonances=[resonance], z_amplitudes_km=list(z_km),
    )  # fmt: skip
    found = stage.run(RecordingContext(), bifurcations=bifurcations())
    assert isinstance(found, SpatialFamilies)
    return found


@pytest.fixture(scope="module")
def family() -> SpatialFamilies:
    return run(3.0, 20.0)


@pytest.mark.slow
def test_the_family_ends_before_another_comes_near(family: SpatialFamilies) -> None:
    assert family.ends == (LEAPS,)
    assert family.members.labels == ("1:17, 3 km",)
    (missing,) = family.missing
    assert "no member of amplitude 20 km" in missing
    assert LEAPS in missing
    # what is left is one curve: every chord turns by less than 5 degrees from the one before
    z = family.curve.x0[[0, 2, 4]] / np.array([[1.0], [1.0], [1e-4]])
    chords = np.diff(z, axis=1)[:, 2:]
    chords /= np.linalg.norm(chords, axis=0)
    assert np.min(np.sum(chords[:, 1:] * chords[:, :-1], axis=0)) > np.cos(np.radians(5.0))
    assert family.members.residual.max() < 1e-9


@pytest.mark.slow
def test_what_cannot_be_computed_between_two_members_ends_the_family(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unseen(spatial: Spatial) -> list[int]:
        return [branch.size for branch in spatial.branches]

    monkeypatch.setattr(spatial_group, "connected", unseen)
    found = run(3.0, 20.0)
    assert found.ends == (BETWEEN,)
    assert found.members.labels == ("1:17, 3 km",)


@pytest.mark.slow
def test_where_families_cross_the_chain_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """The family 1:27 of x = 10.0 km passes a true crossing at z = 4.0 km and goes on."""
    seen: list[tuple[list[int], list[int], list[int]]] = []

    def watched(spatial: Spatial) -> list[int]:
        good = count_connected(spatial)
        seen.append((_changes(spatial, 0), good, [b.size for b in spatial.branches]))
        return good

    monkeypatch.setattr(spatial_group, "connected", watched)
    found = run(5.0, resonance="1:27")
    assert found.members.labels == ("1:27, 5 km",)
    for changes, good, sizes in seen:
        assert len(changes) == 1
        assert good == sizes
