"""Results of a finished run, presented again from its stored products."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from hillsphere.base.errors import StageError, describe_error
from hillsphere.mission.load import Mission
from hillsphere.runs.assembly import Assembly
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.wiring import inputs_of, product_class
from hillsphere.show.presentation import Presentation, check_presentation

__all__ = ["present_again"]


def present_again(
    earlier: EarlierRun,
    mission: Mission,
    stages: Collection[str],
    products: dict[str, Any] | None = None,
) -> Iterator[tuple[str, Presentation]]:
    """Present the stored products of stages; no stage is computed again.

    Parameters
    ----------
    earlier : EarlierRun
        The finished run.
    mission : Mission
        Its mission.
    stages : collection of str
        Names of the stages; they are presented in the order in which they ran.
    products : dict, optional
        Receives the products by stage, also those that the stages need.

    Yields
    ------
    (str, Presentation)
        Stage and what it shows.

    Raises
    ------
    InputError
        If a product is damaged.
    StageError
        If a product cannot be shown.
    """
    assembly = Assembly(mission)
    products = {} if products is None else products
    for stage in mission.order():
        if stage not in stages:
            continue
        spec = mission.specs["stage"][stage]
        for other in (stage, *(ref.name for _, _, ref in spec.needs_of())):
            if other not in products:
                products[other] = earlier.product(other, product_class(mission, other))
        try:
            component = assembly.get("stage", stage)
            made = component.present(products[stage], **inputs_of(spec, products))
            shown = check_presentation(made)
        # The border between the framework and a stage, as when the mission ran.
        except (Exception, SystemExit) as error:
            raise StageError(f"stage {stage!r} cannot be shown: {describe_error(error)}") from error
        yield stage, shown
