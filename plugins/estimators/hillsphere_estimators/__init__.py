"""Built-in estimators plugin: filters, smoothers, bounds and consistency tests."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "estimator",
            "unscented",
            "hillsphere_estimators.unscented:BatchedUnscented",
            "hillsphere_estimators.specs:BatchedUnscentedSpec",
            "unscented filter in square-root form on all cases: plain, tempered or iterated",
        ),
        Component(
            "estimator",
            "gaussian_sum",
            "hillsphere_estimators.gaussian_sum:GaussianSum",
            "hillsphere_estimators.specs:GaussianSumSpec",
            "Gaussian-sum filter on all cases, for wide priors and ambiguous measurements",
        ),
        Component(
            "estimator",
            "iterated_extended",
            "hillsphere_estimators.iterated_extended:IteratedExtended",
            "hillsphere_estimators.specs:IteratedExtendedSpec",
            "extended filter on all cases, its update damped and iterated",
        ),
        Component(
            "estimator",
            "information",
            "hillsphere_estimators.information:Information",
            "hillsphere_estimators.specs:InformationSpec",
            "square-root information filter on all cases",
        ),
        Component(
            "estimator",
            "ukf",
            "hillsphere_estimators.sequential:SequentialUnscented",
            "hillsphere_estimators.specs:SequentialUnscentedSpec",
            "FilterPy's unscented Kalman filter, case by case",
        ),
        Component(
            "estimator",
            "ekf",
            "hillsphere_estimators.sequential:SequentialExtended",
            "hillsphere_estimators.specs:SequentialExtendedSpec",
            "FilterPy's extended Kalman filter, case by case",
        ),
        Component(
            "stage",
            "orbit_refinement",
            "hillsphere_estimators.orbit_refinement.stage:OrbitRefinementStage",
            "hillsphere_estimators.orbit_refinement.specs:OrbitRefinementSpec",
            "an asteroid's orbit by telescopes, then with tracked spacecraft near it",
        ),
        Component(
            "stage",
            "orbit_fit",
            "hillsphere_estimators.orbit_fit.stage:OrbitFitStage",
            "hillsphere_estimators.orbit_fit.specs:OrbitFitSpec",
            "an orbit from recorded tracking data, by least squares and by a filter",
        ),
        Component(
            "stage",
            "navigation",
            "hillsphere_estimators.navigation.stage:NavigationStage",
            "hillsphere_estimators.navigation.specs:NavigationSpec",
            "spacecraft that find their way by sensors and a filter, controlled by its estimate",
        ),
        Component(
            "stage",
            "navigation_comparison",
            "hillsphere_estimators.navigation_comparison.stage:NavigationComparisonStage",
            "hillsphere_estimators.navigation_comparison.specs:NavigationComparisonSpec",
            "sets of sensors side by side: errors, order, bound, consistency, the lightest",
        ),
        Component(
            "stage",
            "initialisation",
            "hillsphere_estimators.initialisation.stage:InitialisationStage",
            "hillsphere_estimators.initialisation.specs:InitialisationSpec",
            "a first belief of spacecraft states from sensors alone, by least squares",
        ),
    ]
