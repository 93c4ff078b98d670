"""Specs of guidance laws: the keys of ``[compensator.NAME]`` in a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Ref, Spec, option, quantity, reference, rule
from hillsphere_guidance.site_specs import SiteSpec

__all__ = ["OpenLoopSpec", "ZemZevSpec"]


class OpenLoopSpec(Spec):
    """No command of its own: a flight on the reference's command alone."""

    examples = ({"period_s": 60},)

    period_s: float = quantity("time", "time between samples", gt=0)
    controls: int = option("how many controls the plant has", default=3, ge=1, le=300)


class ZemZevSpec(Spec):
    """Zero-effort-miss/zero-effort-velocity guidance: the least ∫|a|² for the time that is left."""

    examples = (
        {"plant": "hill", "period_s": 60, "duration_s": 7980},
        {"plant": "hill", "period_s": 60, "duration_min": 20, "prediction": "field"},
        {
            "plant": "hill",
            "period_s": 60,
            "duration_min": 20,
            "towards": "reference",
            "maximum_mm_s2": 10,
        },
    )

    plant: Ref = reference("plant", "plant whose field is predicted")
    period_s: float = quantity("time", "time between samples", gt=0)
    duration_s: float = quantity(
        "time", "time from the first sample to the arrival, a multiple of the period", gt=0
    )
    towards: Literal["target", "site", "reference"] = option(
        "'target': to the flight's target, without any reference; 'site': to a landing site, "
        "likewise; 'reference': back to a reference, whose own command arrives by itself",
        default="target",
    )
    site: SiteSpec | None = option("the landing site", default=None)
    touchdown_speed_m_s: float | None = quantity(
        "speed", "with a site: speed at the arrival, along the inward normal", default=None, ge=0
    )
    prediction: Literal["constant", "field"] = option(
        "what is predicted without effort: 'constant', the field's acceleration where the "
        "spacecraft is; 'field', the flight in the full field (not towards a reference)",
        default="constant",
    )
    maximum_m_s2: float | None = quantity(
        "acceleration", "a larger command is cut to this, its direction kept", default=None, gt=0
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        periods = self.duration_s / self.period_s
        if abs(periods - round(periods)) > 1e-9 * periods or round(periods) < 2:
            raise rule("duration_s", "must be a multiple of period_s, two at least")
        if self.towards == "reference" and self.prediction == "field":
            raise rule(
                "prediction",
                "'field' does not go with a reference: what that will command is not known",
            )
        given = self.site is not None, self.touchdown_speed_m_s is not None
        if given != (self.towards == "site",) * 2:
            raise rule("site", "towards = 'site', site and touchdown_speed_m_s belong together")
        return self
