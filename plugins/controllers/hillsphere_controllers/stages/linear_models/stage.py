"""The stage ``linear_models``: one generalised plant for each combination of parameters."""

from __future__ import annotations

from itertools import product as combinations

import numpy as np

from hillsphere.interfaces import Context
from hillsphere.linear_products import LinearModels
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere_controllers.stages.linear_models.presentation import presented
from hillsphere_controllers.stages.linear_models.specs import LinearModelsSpec
from hillsphere_controllers.stages.linear_models.systems import connected_of

__all__ = ["LinearModelsStage"]


class LinearModelsStage:
    """Linear models by what a mission says of their parts.

    Parameters
    ----------
    spec : LinearModelsSpec
        Parameters, systems, how they are connected.
    """

    def __init__(self, spec: LinearModelsSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> LinearModels:
        """Make the models.

        Parameters
        ----------
        ctx : Context
            Progress.

        Returns
        -------
        LinearModels
            Those square systems whose outputs are outputs of the models, and that are the same in
            all of them, count as weights.

        Raises
        ------
        InputError
            If a system cannot be made, or they do not connect.
        """
        spec = self.spec
        names = [parameter.name for parameter in spec.parameters]
        axes = [parameter.values or (parameter.nominal,) for parameter in spec.parameters]
        if spec.combine == "list":
            count = max((len(axis) for axis in axes), default=1)
            points = list(
                zip(*(axis if len(axis) == count else axis * count for axis in axes), strict=True)
            ) or [()]
        else:
            points = list(combinations(*axes))
        advance = ctx.track("models", len(points))
        systems: list[LtiSystem] = []
        parts: list[tuple[LtiSystem, ...]] = []
        for point in points:
            made, beside = connected_of(spec, dict(zip(names, point, strict=True)), spec.period_s)
            systems.append(made)
            parts.append(beside)
            advance(1)
        varying = [k for k, axis in enumerate(axes) if len(axis) > 1]
        labels = [
            ", ".join(f"{names[k]}={point[k]:.6g}" for k in varying) or "nominal"
            for point in points
        ]
        if len(set(labels)) < len(labels):
            labels = [f"{label} ({k})" for k, label in enumerate(labels)]
        controls, measurements = _width(spec, systems[0])
        return LinearModels(
            systems=tuple(systems),
            labels=tuple(labels),
            parameters=tuple(names),
            units=tuple(parameter.unit for parameter in spec.parameters),
            values=np.array(points, dtype=float).reshape(len(points), len(names)).T,
            nominal=np.array([parameter.nominal for parameter in spec.parameters]),
            controls=controls,
            measurements=measurements,
            weights=_weights(parts, systems[0], measurements),
        )

    def present(self, product: LinearModels) -> Presentation:
        """Show orders, poles and the gains from controls to measurements."""
        return presented(product)


def _width(spec: LinearModelsSpec, system: LtiSystem) -> tuple[int, int]:
    """Return the numbers of controls and measurements, some of which may be named by one name."""

    def count(signals: tuple[str, ...], names: tuple[str, ...]) -> int:
        return sum(
            signal in names or signal.partition("[")[0].partition("(")[0] in names
            for signal in signals
        )

    return count(system.inputs, spec.controls), count(system.outputs, spec.measurements)


def _weights(
    parts: list[tuple[LtiSystem, ...]], system: LtiSystem, measurements: int
) -> tuple[LtiSystem, ...]:
    seen = set(system.outputs[: len(system.outputs) - measurements])
    found = []
    for versions in zip(*parts, strict=True):
        one = versions[0]
        same = all(
            np.array_equal(getattr(one, key), getattr(other, key))
            for other in versions[1:]
            for key in "abcd"
        )
        if same and one.shape[0] == one.shape[1] and set(one.outputs) <= seen:
            found.append(one)
    return tuple(found)
