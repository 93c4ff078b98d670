"""Linear control: the flat namespace of control engineers, and the plugin's control laws.

``import hillsphere_controllers as hc`` offers the usual names, such as `hinfsyn`, `mussv` and
`systune`. They are loaded from their modules on first use: the import itself is light. Systems may
be `LtiSystem` or those of python-control; who gives the latter gets them back.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from hillsphere.plugins import Component, hookimpl

if TYPE_CHECKING:
    from hillsphere.lti import LtiSystem
    from hillsphere_controllers.linear_fractional.transformation import Lft
    from hillsphere_controllers.systems.algebra import gain
    from hillsphere_controllers.systems.conversion import (
        from_control,
        to_control,
        transfer_function,
    )
    from hillsphere_controllers.systems.weights import performance_weight, shelving_weight
    from hillsphere_controllers.toolbox.delays import (
        DelayMargin,
        DelaySystem,
        connect,
        delay,
        delaymargin,
        freqresp,
        isstable,
        pade,
        padecover,
        with_delays,
        with_names,
    )
    from hillsphere_controllers.toolbox.responses import (
        Bode,
        Margins,
        SingularValues,
        StepResponse,
        bode,
        h2norm,
        hinfnorm,
        margins,
        sigma,
        step,
    )
    from hillsphere_controllers.toolbox.robustness import (
        DiskMargins,
        GainBounds,
        MuBounds,
        MuSynthesis,
        RobustMargin,
        diskmargin,
        mussv,
        musyn,
        robgain,
        robstab,
        wcgain,
    )
    from hillsphere_controllers.toolbox.synthesis import (
        GapMetric,
        H2Synthesis,
        HinfSynthesis,
        LoopShaping,
        MixedSensitivity,
        gapmetric,
        h2syn,
        hinfsyn,
        mixsyn,
        ncfmargin,
        ncfsyn,
    )
    from hillsphere_controllers.toolbox.tuning import (
        FixedStructure,
        GainGoal,
        GoalValue,
        PidGains,
        PolesGoal,
        Tuned,
        VarianceGoal,
        hinfstruct,
        systune,
        tunableGain,
        tunablePID,
        tunableSS,
        tunableTF,
    )
    from hillsphere_controllers.toolbox.uncertain import (
        PlantCover,
        append,
        feedback,
        lft,
        parallel,
        series,
        ucover,
        ultidyn,
        ureal,
        uss,
    )

__all__ = [
    "Bode",
    "DelayMargin",
    "DelaySystem",
    "DiskMargins",
    "FixedStructure",
    "GainBounds",
    "GainGoal",
    "GapMetric",
    "GoalValue",
    "H2Synthesis",
    "HinfSynthesis",
    "Lft",
    "LoopShaping",
    "LtiSystem",
    "Margins",
    "MixedSensitivity",
    "MuBounds",
    "MuSynthesis",
    "PidGains",
    "PlantCover",
    "PolesGoal",
    "RobustMargin",
    "SingularValues",
    "StepResponse",
    "Tuned",
    "VarianceGoal",
    "append",
    "bode",
    "connect",
    "delay",
    "delaymargin",
    "diskmargin",
    "feedback",
    "freqresp",
    "from_control",
    "gain",
    "gapmetric",
    "h2norm",
    "h2syn",
    "hillsphere_components",
    "hinfnorm",
    "hinfstruct",
    "hinfsyn",
    "isstable",
    "lft",
    "margins",
    "mixsyn",
    "mussv",
    "musyn",
    "ncfmargin",
    "ncfsyn",
    "pade",
    "padecover",
    "parallel",
    "performance_weight",
    "robgain",
    "robstab",
    "series",
    "shelving_weight",
    "sigma",
    "step",
    "systune",
    "to_control",
    "transfer_function",
    "tunableGain",
    "tunablePID",
    "tunableSS",
    "tunableTF",
    "ucover",
    "ultidyn",
    "ureal",
    "uss",
    "wcgain",
    "with_delays",
    "with_names",
]

_MODULES = {
    "hillsphere.lti": "LtiSystem",
    "hillsphere_controllers.linear_fractional.transformation": "Lft",
    "hillsphere_controllers.systems.algebra": "gain",
    "hillsphere_controllers.systems.conversion": "from_control to_control transfer_function",
    "hillsphere_controllers.systems.weights": "performance_weight shelving_weight",
    "hillsphere_controllers.toolbox.delays": (
        "DelayMargin DelaySystem connect delay delaymargin freqresp isstable pade padecover "
        "with_delays with_names"
    ),
    "hillsphere_controllers.toolbox.responses": (
        "Bode Margins SingularValues StepResponse bode h2norm hinfnorm margins sigma step"
    ),
    "hillsphere_controllers.toolbox.robustness": (
        "DiskMargins GainBounds MuBounds MuSynthesis RobustMargin diskmargin mussv musyn "
        "robgain robstab wcgain"
    ),
    "hillsphere_controllers.toolbox.synthesis": (
        "GapMetric H2Synthesis HinfSynthesis LoopShaping MixedSensitivity gapmetric h2syn "
        "hinfsyn mixsyn ncfmargin ncfsyn"
    ),
    "hillsphere_controllers.toolbox.tuning": (
        "FixedStructure GainGoal GoalValue PidGains PolesGoal Tuned VarianceGoal hinfstruct "
        "systune tunableGain tunablePID tunableSS tunableTF"
    ),
    "hillsphere_controllers.toolbox.uncertain": (
        "PlantCover append feedback lft parallel series ucover ultidyn ureal uss"
    ),
}
"""Module → the names that it offers here."""
_LAZY = {name: module for module, names in _MODULES.items() for name in names.split()}

if not TYPE_CHECKING:  # type checkers see the imports above, and report any other name

    def __getattr__(name: str) -> object:
        if name not in _LAZY:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = getattr(import_module(_LAZY[name]), name)
        return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "compensator",
            "pid",
            "hillsphere_controllers.pid:Pid",
            "hillsphere_controllers.specs:PidSpec",
            "proportional, integral and derivative action on each axis, held between samples",
        ),
        Component(
            "compensator",
            "state_space",
            "hillsphere_controllers.state_space:state_space",
            "hillsphere_controllers.specs:StateSpaceSpec",
            "linear compensator by its matrices: discrete, discretised, or with continuous states",
        ),
        Component(
            "compensator",
            "impulsive",
            "hillsphere_controllers.impulsive:Impulsive",
            "hillsphere_controllers.specs:ImpulsiveSpec",
            "linear feedback as impulses, with dead band and maximum",
        ),
        Component(
            "compensator",
            "lti",
            "hillsphere_controllers.lti:lti",
            "hillsphere_controllers.law_specs:LtiSpec",
            "linear controller from a synthesis, a .mat file or matrices, at samples or between",
        ),
        Component(
            "compensator",
            "lqr",
            "hillsphere_controllers.regulators:LinearQuadraticRegulator",
            "hillsphere_controllers.law_specs:LqrSpec",
            "linear-quadratic regulator near a point of a plant, optimal for samples and a hold",
        ),
        Component(
            "compensator",
            "lqg",
            "hillsphere_controllers.regulators:LinearQuadraticGaussian",
            "hillsphere_controllers.law_specs:LqgSpec",
            "linear-quadratic regulator on a Kalman filter's estimate, for samples and a hold",
        ),
        Component(
            "compensator",
            "lyapunov",
            "hillsphere_controllers.lyapunov:Lyapunov",
            "hillsphere_controllers.law_specs:LyapunovSpec",
            "command that lets a Lyapunov function of the deviation fall most in each period",
        ),
        Component(
            "compensator",
            "lyapunov_formation",
            "hillsphere_controllers.lyapunov_formation:LyapunovFormation",
            "hillsphere_controllers.formation_specs:LyapunovFormationSpec",
            "continuous control of a formation by a Lyapunov function of the estimated states",
        ),
        Component(
            "stage",
            "linearise",
            "hillsphere_controllers.stages.linearise.stage:LineariseStage",
            "hillsphere_controllers.stages.linearise.specs:LineariseSpec",
            "linear models of a plant at points of a trajectory, and what its parameters do there",
        ),
        Component(
            "stage",
            "linear_models",
            "hillsphere_controllers.stages.linear_models.stage:LinearModelsStage",
            "hillsphere_controllers.stages.linear_models.specs:LinearModelsSpec",
            "linear models of a plant and its weights, at one or more values of its parameters",
        ),
        Component(
            "stage",
            "lft",
            "hillsphere_controllers.stages.lft.stage:LftStage",
            "hillsphere_controllers.stages.lft.specs:LftSpec",
            "uncertain models M-Delta fitted to linear models over their parameters",
        ),
        Component(
            "stage",
            "synthesis",
            "hillsphere_controllers.stages.synthesis.stage:SynthesisStage",
            "hillsphere_controllers.stages.synthesis.specs:SynthesisSpec",
            "a controller of linear models by one of several methods, checked on all of them",
        ),
        Component(
            "stage",
            "mu_analysis",
            "hillsphere_controllers.stages.mu_analysis.stage:MuAnalysisStage",
            "hillsphere_controllers.stages.mu_analysis.specs:MuAnalysisSpec",
            "robustness of loops by the structured singular value, certified over frequency",
        ),
        Component(
            "stage",
            "sampled_loops",
            "hillsphere_controllers.stages.sampled_loops.stage:SampledLoopsStage",
            "hillsphere_controllers.stages.sampled_loops.specs:SampledLoopsSpec",
            "stability and margins of linear loops at their sample rates, exactly",
        ),
        Component(
            "stage",
            "worst_cases",
            "hillsphere_controllers.stages.worst_cases.stage:WorstCasesStage",
            "hillsphere_controllers.stages.worst_cases.specs:WorstCasesSpec",
            "worst cases that an analysis by mu has found, for a sweep of the flight",
        ),
        Component(
            "command",
            "mat",
            "hillsphere_controllers.stages.mat:app",
            "",
            "write the systems in a product of a run to a file for MATLAB",
        ),
    ]
