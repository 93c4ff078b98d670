"""Built-in controllers plugin: laws that command a thruster, sampled or continuous."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


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
