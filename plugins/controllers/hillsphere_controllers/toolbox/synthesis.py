"""Synthesis of full order and distances of plants, under their usual names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gap import gap, nu_gap
from hillsphere_controllers.full_order.h2 import h2_synthesis
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.full_order.loop_shaping import coprime_margin, loop_shaping
from hillsphere_controllers.full_order.mixed_sensitivity import mixed_sensitivity
from hillsphere_controllers.full_order.regularisation import Regularisation
from hillsphere_controllers.systems.conversion import as_lti, like
from hillsphere_controllers.toolbox.results import Readable, System

__all__ = [
    "GapMetric", "H2Synthesis", "HinfSynthesis", "LoopShaping", "MixedSensitivity", "gapmetric",
    "h2syn", "hinfsyn", "mixsyn", "ncfmargin", "ncfsyn",
]  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class HinfSynthesis(Readable, Generic[System]):
    """An H∞ controller.

    Parameters
    ----------
    K : System
        u = K y, of the order of the plant.
    CL : System
        The closed loop from w to z.
    gamma : float
        Its H∞ norm, computed from the closed loop; its upper bound where `doubt` says something.
    lower_bound : float
        No controller of any order reaches a γ below this.
    upper : float
        A level that the gain of CL exceeds nowhere, rounding included.
    added : Regularisation or None
        Weights and noise that were added for the synthesis alone; None if there are none.
    doubt : str
        Where rounding may have changed the norm by more than 1 %, in words; else empty.
    """

    K: System
    CL: System
    gamma: float
    lower_bound: float
    upper: float
    added: Regularisation | None = None
    doubt: str = ""


def hinfsyn(
    P: System,
    nmeas: int,
    ncont: int,
    *,
    tolerance: float = 1e-4,
    back_off: float = 0.005,
    regularisation: float | None = None,
) -> HinfSynthesis[System]:
    """Return the controller that nearly minimises the H∞ norm from w to z.

    Parameters
    ----------
    P : LtiSystem or system of python-control
        Generalised plant; its last inputs are the controls, its last outputs the measurements.
    nmeas, ncont : int
        Numbers of measurements and controls.
    tolerance, back_off, regularisation
        As of `hillsphere_controllers.full_order.hinf.hinf_synthesis`.

    Returns
    -------
    HinfSynthesis
        K, CL and γ; systems of python-control if P is one.

    Raises
    ------
    InputError, NotStabilisableError, SingularProblemError, SynthesisFailedError
        As `hinf_synthesis`.
    """
    design = hinf_synthesis(
        as_lti(P, "the plant P"), ncont, nmeas, tolerance=tolerance, back_off=back_off,
        regularisation=regularisation,
    )  # fmt: skip
    return HinfSynthesis(
        like(design.controller, P), like(design.closed_loop, P), design.gamma, design.least,
        design.norm.upper, design.added, design.norm.doubt,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class H2Synthesis(Readable, Generic[System]):
    """An H2 controller.

    Parameters
    ----------
    K : System
        u = K y, of the order of the plant.
    CL : System
        The closed loop from w to z.
    gamma : float
        Its H2 norm; where nothing was added, no controller has a smaller one.
    added : Regularisation or None
        As of `HinfSynthesis`.
    """

    K: System
    CL: System
    gamma: float
    added: Regularisation | None = None


def h2syn(
    P: System, nmeas: int, ncont: int, *, regularisation: float | None = None
) -> H2Synthesis[System]:
    """Return the controller that minimises the H2 norm from w to z.

    Parameters
    ----------
    P, nmeas, ncont
        As of `hinfsyn`.
    regularisation : float or None
        As of `hillsphere_controllers.full_order.h2.h2_synthesis`.

    Returns
    -------
    H2Synthesis
        K, CL and its norm; systems of python-control if P is one.

    Raises
    ------
    InputError, NotStabilisableError, SingularProblemError, SynthesisFailedError
        As `hillsphere_controllers.full_order.h2.h2_synthesis`.
    """
    design = h2_synthesis(as_lti(P, "the plant P"), ncont, nmeas, regularisation=regularisation)
    return H2Synthesis(
        like(design.controller, P), like(design.closed_loop, P), design.norm, design.added
    )


@dataclass(frozen=True, eq=False, repr=False)
class MixedSensitivity(Readable, Generic[System]):
    """A controller of a mixed-sensitivity problem and the transfers that it shapes.

    Parameters
    ----------
    K : System
        u = K e with the error e = r − y.
    CL : System
        The weighted closed loop [W₁ S; W₂ K S; W₃ T].
    gamma, lower_bound, upper : float
        Its H∞ norm and its bounds, as of `HinfSynthesis`.
    S, KS, T : System
        Sensitivity, K S and complementary sensitivity, without weights.
    added : Regularisation or None
        As of `HinfSynthesis`.
    doubt : str
        As of `HinfSynthesis`.
    """

    K: System
    CL: System
    gamma: float
    lower_bound: float
    upper: float
    S: System
    KS: System
    T: System
    added: Regularisation | None = None
    doubt: str = ""


def mixsyn(
    G: System,
    W1: LtiSystem | float | None = None,
    W2: LtiSystem | float | None = None,
    W3: LtiSystem | float | None = None,
    *,
    disturbance: float = 0.0,
    back_off: float = 0.005,
    regularisation: float | None = None,
) -> MixedSensitivity[System]:
    """Return the controller that nearly minimises the H∞ norm of [W₁ S; W₂ K S; W₃ T].

    Parameters
    ----------
    G : LtiSystem or system of python-control
        The plant.
    W1, W2, W3 : LtiSystem, system of python-control, float or None
        Weights of the error, the controls and the outputs; None: left out.
    disturbance : float
        Size of a disturbance at the controls, which plants with poles on the axis need.
    back_off : float
        By how much γ is larger than the least one, as in
        `hillsphere_controllers.full_order.hinf.hinf_synthesis`.
    regularisation : float or None
        As there.

    Returns
    -------
    MixedSensitivity
        K and what it shapes; systems of python-control if G is one.

    Raises
    ------
    InputError, NotStabilisableError, SingularProblemError, SynthesisFailedError
        As `hillsphere_controllers.full_order.mixed_sensitivity.mixed_sensitivity`.
    """
    weights = [
        w if w is None or isinstance(w, float | int) else as_lti(w, f"the weight W{k}")
        for k, w in enumerate((W1, W2, W3), 1)
    ]
    design = mixed_sensitivity(
        as_lti(G, "the plant G"), *weights, disturbance=disturbance, back_off=back_off,
        regularisation=regularisation,
    )  # fmt: skip
    full = design.design
    return MixedSensitivity(
        like(design.controller, G), like(full.closed_loop, G), design.gamma, full.least,
        full.norm.upper, like(design.sensitivity, G), like(design.control, G),
        like(design.complementary, G), full.added, full.norm.doubt,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class LoopShaping(Readable, Generic[System]):
    """A controller of H∞ loop shaping.

    Parameters
    ----------
    K : System
        W₁ Kₛ W₂, u = K y without a change of sign.
    CL : System
        [I; Kₛ] (I − Gₛ Kₛ)⁻¹ [I Gₛ].
    gamma : float
        Its H∞ norm.
    emax : float
        The largest margin of any controller for changes of the coprime factors; 1/γ is that of
        this one.
    Gs, Ks : System
        The shaped plant W₂ G W₁ and its controller.
    """

    K: System
    CL: System
    gamma: float
    emax: float
    Gs: System
    Ks: System


def ncfsyn(
    G: System, W1: LtiSystem | None = None, W2: LtiSystem | None = None, *, back_off: float = 0.01
) -> LoopShaping[System]:
    """Return the controller of H∞ loop shaping, of Glover and McFarlane.

    Parameters
    ----------
    G : LtiSystem or system of python-control
        The plant.
    W1, W2 : LtiSystem, system of python-control or None
        Weights at its inputs and its outputs; 1 if left out.
    back_off : float
        By how much γ is larger than its least value 1/emax.

    Returns
    -------
    LoopShaping
        The controller; systems of python-control if G is one. The loop is closed by positive
        feedback, u = K y, as in MATLAB.

    Raises
    ------
    InputError, NotStabilisableError, SynthesisFailedError
        As `hillsphere_controllers.full_order.loop_shaping.loop_shaping`.
    """
    w1, w2 = (
        None if w is None else as_lti(w, f"the weight W{k}") for k, w in enumerate((W1, W2), 1)
    )
    design = loop_shaping(as_lti(G, "the plant G"), w1, w2, back_off=back_off)
    return LoopShaping(
        like(design.controller, G), like(design.closed_loop, G), design.gamma, 1.0 / design.least,
        like(design.shaped_plant, G), like(design.shaped_controller, G),
    )  # fmt: skip


def ncfmargin(P: LtiSystem, C: LtiSystem, sign: int = -1) -> float:
    """Return the margin b(P, C) for changes of the normalised coprime factors of P.

    Parameters
    ----------
    P, C : LtiSystem or system of python-control
        Plant and controller.
    sign : {-1, 1}
        Negative feedback, u = −C y, or positive.

    Returns
    -------
    float
        From 0, for a loop that is not stable, to 1.
    """
    controller = as_lti(C, "the controller C")
    return coprime_margin(as_lti(P, "the plant P"), controller * float(sign))


@dataclass(frozen=True, repr=False)
class GapMetric(Readable):
    """Distances of two plants, from 0 to 1.

    Parameters
    ----------
    gap : float
        The gap.
    nugap : float
        The ν-gap, which is never larger.
    """

    gap: float
    nugap: float


def gapmetric(P1: LtiSystem, P2: LtiSystem, *, tolerance: float = 1e-5) -> GapMetric:
    """Return the gap and the ν-gap of two plants.

    Parameters
    ----------
    P1, P2 : LtiSystem or system of python-control
        Of one shape and one sampling period.
    tolerance : float
        Relative accuracy of the gap.

    Returns
    -------
    GapMetric
        Both gaps, between zero and one.

    Raises
    ------
    InputError, NotStabilisableError, SynthesisFailedError
        As `hillsphere_controllers.analysis.gap.gap`.
    """
    first, second = as_lti(P1, "the plant P1"), as_lti(P2, "the plant P2")
    return GapMetric(gap(first, second, tolerance=tolerance), nu_gap(first, second))
