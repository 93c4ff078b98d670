"""Spec of the stage ``lft``: keys of its table in a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, need, option, reference, rule

__all__ = ["BoundSpec", "LftNeeds", "LftSpec", "UncertainBlockSpec"]


class BoundSpec(Spec):
    """Between which values a parameter may be."""

    examples = ({"parameter": "k", "lower": 0.5, "upper": 2, "nominal": 1.25},)

    parameter: str = option("name of the parameter in the models")
    lower: float = option("least value, in the parameter's unit")
    upper: float = option("largest value, in the parameter's unit")
    nominal: float | None = option("nominal value; left out: the middle", default=None)

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.lower < self.upper:
            raise rule("upper", f"must be above the lower bound, {self.lower:g}")
        if self.nominal is not None and not self.lower < self.nominal < self.upper:
            raise rule("nominal", f"must lie between {self.lower:g} and {self.upper:g}")
        return self


class UncertainBlockSpec(Spec):
    """Anything of norm one at most, or one number on all channels, between models' signals."""

    examples = (
        {"name": "actuator", "outputs": ["z_delta"], "inputs": ["w_delta"]},
        {"name": "coupling", "kind": "real", "outputs": ["z_od"], "inputs": ["w_od"]},
        {"name": "actuator.gain.ax", "kind": "real", "lower": 0.95, "upper": 1.05,
         "outputs": ["z_act[0]"], "inputs": ["w_act[0]"]},
        {"name": "mass", "kind": "real", "lower": 0.9, "upper": 1.2, "nominal": 1.0,
         "normalise": True, "outputs": ["z_mass"], "inputs": ["w_mass"]},
    )  # fmt: skip

    name: str = option("name of the uncertainty")
    outputs: tuple[str, ...] = option(
        "outputs of the models that the uncertainty takes", min_length=1
    )
    inputs: tuple[str, ...] = option(
        "inputs of the models that the uncertainty gives", min_length=1
    )
    kind: Literal["full", "complex", "real"] = option(
        "a matrix of norm one at most; or one number of modulus one at most, complex or real, "
        "times the identity: as many inputs as outputs, a copy of it for each",
        default="full",
    )
    dynamic: bool = option(
        "'full', 'complex': whether it may be any stable system, or complex numbers only",
        default=True,
    )
    lower: float = option(
        "'real': what the number -1 stands for in tables and worst cases; the models' signals "
        "carry the number from -1 to 1, and so its size, unless normalise is true",
        default=-1.0,
    )
    upper: float = option("'real': what the number 1 stands for", default=1.0)
    normalise: bool = option(
        "'real': whether the models' inputs carry the deviation of the value from its nominal one "
        "instead, in its unit",
        default=False,
    )
    nominal: float | None = option(
        "'real' with normalise: the value that the models have where these inputs are zero, which "
        "the number 0 stands for; left out: the middle of lower and upper. Elsewhere the value "
        "p = nominal + g n/(1 + c n) of a number n is no straight line but the fraction through "
        "the three, c = (2 nominal - upper - lower)/(upper - lower), "
        "g = (upper - nominal)(1 + c)",
        default=None,
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        if not self.lower < self.upper:
            raise rule("upper", f"must be above lower, {self.lower:g}")
        if self.kind != "real" and (self.lower, self.upper) != (-1.0, 1.0):
            raise rule("lower", "only a real number has bounds; leave them out")
        if self.normalise and not {"lower", "upper"} <= self.model_fields_set:
            raise rule("normalise", "it is by lower and upper; give both, for a real number")
        if self.nominal is not None:
            if not self.normalise:
                raise rule(
                    "nominal",
                    "the models' signals carry the number from -1 to 1 itself, whose nominal value "
                    "is zero; leave it out, or set normalise = true",
                )
            if not self.lower < self.nominal < self.upper:
                raise rule(
                    "nominal",
                    f"must lie between lower and upper, {self.lower:g} and {self.upper:g}, got "
                    f"{self.nominal:g}",
                )
        return self


class LftNeeds(Spec):
    """Products of earlier stages that ``lft`` takes."""

    models: Ref = need(
        "hillsphere_controllers.linear_products:LinearModels",
        "models at several values of their parameters",
    )


class LftSpec(StageSpec):
    """An uncertain model M-Δ: polynomials fitted to models over their parameters, and blocks."""

    results = ResultNames(
        metrics=(
            "lft_size",
            "lft_response_error",
            "lft_left_out",
            "lft_fit_error",
        ),
        tables={
            "lft_blocks": (),
            "lft_sizes": (),
            "lft_terms": (),
        },
    )
    produces = "hillsphere_controllers.stages.lft.products:FittedModels"
    provides = ("hillsphere_controllers.linear_products:UncertainModels",)
    examples = (
        {"needs": {"models": "models"}, "degree": 1},
        {
            "needs": {"models": "models"},
            "bounds": [{"parameter": "rate", "lower": 0.6, "upper": 1.4}],
            "blocks": [{"name": "sensor", "outputs": ["z_error"], "inputs": ["r"]}],
            "reduction": 0.01,
        },
        {"needs": {"models": "models"}, "dispersions": ["rates"], "sigmas": 2},
        {
            "needs": {"models": "models"},
            "known": ["point"],
            "dispersions": ["field"],
            "fit": "affine",
            "truncation": 0.05,
            "compare_sigmas": [2, 3],
        },
    )

    needs: LftNeeds = option("products of earlier stages")
    bounds: tuple[BoundSpec, ...] = option(
        "bounds of parameters; of those left out: dispersions, or the range of the models",
        default=(),
    )
    dispersions: tuple[Ref, ...] = reference(
        "dispersions", "distributions that bound the parameters of the same names", default=()
    )
    sigmas: float = option(
        "by how many standard deviations dispersions bound their parameters", default=3.0, gt=0
    )
    known: tuple[str, ...] = option(
        "parameters that are not uncertain: one uncertain model for each combination of their "
        "values, such as points along a trajectory",
        default=(),
    )
    blocks: tuple[UncertainBlockSpec, ...] = option(
        "uncertainties between signals of the models, beside the parameters", default=()
    )
    fit: Literal["polynomial", "affine"] = option(
        "how the matrices depend on the parameters: polynomials by least squares; or affine, exact "
        "from the nominal model and one for each parameter, and refused if another model "
        "contradicts",
        default="polynomial",
    )
    degree: int = option("'polynomial': largest sum of exponents of a term", default=3, ge=0, le=12)
    tolerance: float = option(
        "'polynomial': error of an entry, relative to its range over the models, at which no more "
        "terms are added",
        default=1e-6, gt=0,
    )  # fmt: skip
    most_terms: int | None = option(
        "'polynomial': so many terms suffice, whatever the error", default=None, ge=1
    )
    reduction: float = option(
        "'polynomial': error that fewer copies of parameters may cost, relative to the largest "
        "change of the matrices over the models; 0: only copies without effect are taken out",
        default=0.0, ge=0, lt=1,
    )  # fmt: skip
    truncation: float = option(
        "'affine': the weakest directions of all parameters are left out as long as the root of "
        "the sum of their squares is no more than this share of truncation_of; 0: none are. A "
        "block covers them in an analysis by µ",
        default=0.0, ge=0, lt=1,
    )  # fmt: skip
    truncation_of: Literal["change", "nominal"] = option(
        "'affine': of what truncation is a share: of the same root of all directions, the size of "
        "the change that the parameters make; or of the Frobenius norm of the nominal matrix on "
        "the rows and columns that change, which may leave out all of a small change of it",
        default="change",
    )
    compare_sigmas: tuple[float, ...] = option(
        "'affine': numbers of standard deviations of the dispersions for which the copies are "
        "counted, for a table and a figure",
        default=(), gt=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _of_its_fit(self) -> Self:
        own = {
            "polynomial": ("degree", "tolerance", "most_terms", "reduction"),
            "affine": ("truncation", "truncation_of", "compare_sigmas"),
        }
        for fit, keys in own.items():
            for key in keys:
                if fit != self.fit and key in self.model_fields_set:
                    raise rule(key, f"belongs to fit = {fit!r}; leave it out")
        if self.compare_sigmas and not self.dispersions:
            raise rule("compare_sigmas", "needs dispersions, whose standard deviations are meant")
        return self

    @model_validator(mode="after")
    def _once(self) -> Self:
        for key, names in (
            ("bounds", [bound.parameter for bound in self.bounds]),
            ("blocks", [block.name for block in self.blocks]),
            ("known", list(self.known)),
        ):
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise rule(key, f"the name {twice[0]!r} is listed twice")
        for side in ("outputs", "inputs"):
            signals = [name for block in self.blocks for name in getattr(block, side)]
            if twice := sorted({name for name in signals if signals.count(name) > 1}):
                raise rule("blocks", f"signal {twice[0]!r} belongs to two blocks")
        if both := {bound.parameter for bound in self.bounds} & set(self.known):
            raise rule("known", f"{min(both)!r} has bounds: it is not known")
        return self
