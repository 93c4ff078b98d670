"""Specs of the families of libration orbits: the keys of a mission."""

from __future__ import annotations

from typing import Any, Literal

from hillsphere.spec import Ref, Spec, option, reference

__all__ = ["HaloSpec", "LyapunovSpec"]


def _plant() -> Any:
    return reference("plant", "equations of motion about a body at rest in a rotating frame")


def _point() -> Any:
    return option(
        'libration point: "L1" lies between the body and its primary, "L2" on the other side'
    )


def _accuracy() -> Any:
    return option(
        "closure relative to size, natural units, to which the orbits are propagated",
        default=1e-11,
        ge=1e-12,
        le=1e-4,
    )


class LyapunovSpec(Spec):
    """Planar Lyapunov orbits about L1 or L2 of a plant."""

    examples = ({"plant": "hill", "point": "L1"}, {"plant": "hill", "point": "L2"})

    plant: Ref = _plant()
    point: Literal["L1", "L2"] = _point()
    accuracy: float = _accuracy()


class HaloSpec(Spec):
    """Halo orbits about L1 or L2 of a plant, from where they branch off the Lyapunov orbits."""

    examples = (
        {"plant": "hill", "point": "L1"},
        {"plant": "hill", "point": "L2", "branch": "south"},
    )

    plant: Ref = _plant()
    point: Literal["L1", "L2"] = _point()
    branch: Literal["north", "south"] = option(
        "on which side of the plane the orbits cross y = 0 far from the body, where they spend "
        "most of their time; the other side holds the mirror image",
        default="north",
    )
    accuracy: float = _accuracy()
