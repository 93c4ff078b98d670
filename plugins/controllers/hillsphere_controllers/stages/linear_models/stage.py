"""The stage ``linear_models``: one generalised plant for each combination of parameters."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product as combinations

import numpy as np

from hillsphere.base.matching import match_names
from hillsphere.errors import InputError
from hillsphere.interfaces import Context
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.linear_models.presentation import present_linear_models
from hillsphere_controllers.stages.linear_models.specs import LinearModelsSpec
from hillsphere_controllers.stages.linear_models.systems import build_parts, connect_systems

__all__ = ["LinearModelsStage"]


_FORESEEN = 16
"""Models that are made before anything runs, if no product is needed: faults of systems, files and
junctions show in the first. More would take the time of the run twice."""


class LinearModelsStage:
    """Linear models built from the systems and junctions of a mission.

    Parameters
    ----------
    spec : LinearModelsSpec
        Parameters, systems, how they are connected.
    """

    def __init__(self, spec: LinearModelsSpec) -> None:
        self.spec = spec

    def check_needs(self, models: object = None) -> None:
        """Check before the run that systems can be made and connect, where no product is needed."""
        spec = self.spec
        if models is None:
            names = [parameter.name for parameter in spec.parameters]
            for point in _points(spec)[:_FORESEEN]:
                values = dict(zip(names, point, strict=True))
                connect_systems(spec, build_parts(spec, values, spec.period_s))

    def run(self, ctx: Context, models: LinearModels | None = None) -> LinearModels:
        """Make the models.

        Parameters
        ----------
        ctx : Context
            Progress.
        models : LinearModels, optional
            Each of which is connected to the other systems.

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
        given = _select_systems(models, spec.which)
        points = _points(spec)
        names = [parameter.name for parameter in spec.parameters]
        if models is not None and (both := set(names) & set(models.parameters)):
            raise InputError(f"parameters: the models of needs.models have {min(both)!r} already")
        advance = ctx.track("models", len(points) * len(given))
        systems: list[LtiSystem] = []
        parts: list[tuple[LtiSystem, ...]] = []
        for point in points:
            values = dict(zip(names, point, strict=True))
            own: tuple[LtiSystem, ...] | None = None
            for one in given:
                made = build_parts(spec, values, spec.period_s, one.system, own)
                own = own or made
                parts.append(made)
                systems.append(connect_systems(spec, made))
                advance(1)
        controls, measurements = _width(spec, systems[0])
        units = tuple(parameter.unit for parameter in spec.parameters)
        nominal = np.array([parameter.nominal for parameter in spec.parameters])
        return LinearModels(
            systems=tuple(systems),
            labels=_labels(spec, points, [one.label for one in given]),
            parameters=(*(models.parameters if models else ()), *names),
            units=(*(models.units if models else ()), *units),
            values=np.array([(*one.values, *point) for point in points for one in given])
            .reshape(len(systems), -1)
            .T,
            nominal=np.concatenate([models.nominal if models else np.zeros(0), nominal]),
            controls=controls,
            measurements=measurements,
            weights=_weights(parts, systems[0], measurements, models),
        )

    def present(self, product: LinearModels, models: LinearModels | None = None) -> Presentation:
        """Show orders, poles and the gains from controls to measurements."""
        return present_linear_models(product)


@dataclass(frozen=True)
class _Given:
    """A model that the others are connected to, or none."""

    system: LtiSystem | None
    label: str
    values: tuple[float, ...]


def _select_systems(models: LinearModels | None, which: tuple[str, ...]) -> list[_Given]:
    if models is None:
        return [_Given(None, "", ())]
    names = match_names(which, models.labels, "which: needs.models", "model") if which else ()
    return [
        _Given(system, label, tuple(values))
        for system, label, values in zip(
            models.systems, models.labels, models.values.T.tolist(), strict=True
        )
        if not which or label in names
    ]


def _points(spec: LinearModelsSpec) -> list[tuple[float, ...]]:
    """Return the values of the parameters, model by model."""
    axes = [parameter.values or (parameter.nominal,) for parameter in spec.parameters]
    if spec.combine == "grid":
        return list(combinations(*axes))
    count = max((len(axis) for axis in axes), default=1)
    spread = (axis if len(axis) == count else axis * count for axis in axes)
    return list(zip(*spread, strict=True)) or [()]


def _labels(
    spec: LinearModelsSpec, points: list[tuple[float, ...]], given: list[str]
) -> tuple[str, ...]:
    varying = [k for k, one in enumerate(spec.parameters) if len(one.values) > 1]
    own = [
        ", ".join(f"{spec.parameters[k].name}={point[k]:.6g}" for k in varying) for point in points
    ]
    labels = [
        ", ".join(filter(None, (label, text))) or "nominal" for text in own for label in given
    ]
    if len(set(labels)) < len(labels):
        labels = [f"{label} ({k})" for k, label in enumerate(labels)]
    return tuple(labels)


def _width(spec: LinearModelsSpec, system: LtiSystem) -> tuple[int, int]:
    """Return the numbers of controls and measurements, some of which may be named by one name."""

    def count(signals: tuple[str, ...], names: tuple[str, ...]) -> int:
        return sum(
            signal in names or signal.partition("[")[0].partition("(")[0] in names
            for signal in signals
        )

    return count(system.inputs, spec.controls), count(system.outputs, spec.measurements)


def _weights(
    parts: list[tuple[LtiSystem, ...]],
    system: LtiSystem,
    measurements: int,
    models: LinearModels | None,
) -> tuple[LtiSystem, ...]:
    """Return square systems whose outputs are the models', the same in all of them."""
    seen = set(system.outputs[: len(system.outputs) - measurements])
    weights = [one for one in (models.weights if models else ()) if set(one.outputs) <= seen]
    for versions in zip(*parts, strict=True):
        one = versions[0]
        same = all(
            one is other
            or all(np.array_equal(getattr(one, key), getattr(other, key)) for key in "abcd")
            for other in versions[1:]
        )
        if same and one.shape[0] == one.shape[1] and set(one.outputs) <= seen:
            weights.append(one)
    return tuple(weights)
