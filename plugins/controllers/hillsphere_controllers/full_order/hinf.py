r"""H∞ synthesis of full order by two Riccati equations.

The plant

.. math::

    \dot x &= A x + B_1 w + B_2 u \\
    z &= C_1 x + D_{11} w + D_{12} u \\
    y &= C_2 x + D_{21} w + D_{22} u

is brought to D12 = [0; I], D21 = [0 I] by orthogonal maps of z and w and scaling of u and y, and
D22 is taken out. A controller that keeps the gain from w to z below γ exists just if both Riccati
equations have stabilising solutions X, Y ≥ 0 with ρ(XY) < γ² [1]_, [2]_. The least γ is found by
bisection; near it the controller's poles run away, so that the controller returned is that of a γ a
little larger.

References
----------
.. [1] K. Glover, J. C. Doyle (1988), State-space formulae for all stabilizing controllers that
   satisfy an H∞-norm bound and relations to risk sensitivity, Systems & Control Letters 11,
   167-172.
.. [2] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, sections
   17.1 and 17.2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import schur

from hillsphere.errors import HillsphereError, InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import HinfNorm, hinf_norm
from hillsphere_controllers.errors import SingularProblemError, SynthesisFailedError
from hillsphere_controllers.full_order.gamma_problem import GammaProblem
from hillsphere_controllers.full_order.gamma_search import bisect_gamma, close_in, follow_gamma
from hillsphere_controllers.full_order.modes import describe_weakest_mode, is_surely_stable
from hillsphere_controllers.full_order.regularisation import Regularisation
from hillsphere_controllers.full_order.regularised_search import rank_norm, search_regularised
from hillsphere_controllers.full_order.response_bounds import frequency_bound
from hillsphere_controllers.full_order.scaling import Units
from hillsphere_controllers.slicot import hinf_guess
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["HinfDesign", "hinf_synthesis", "least_gamma"]

_BACK_OFFS = (1.0, 1.5, 3.0, 10.0, 30.0)
"""Multiples of the back-off that are tried until the closed loop has the norm it should. Near the
least γ the central controller has very fast poles; a larger back-off slows them."""
_TRIED, _ROUNDS = 12, 4
"""Values of γ tried where rounding, not proof, ended the bisection, ever nearer to the best."""
_DECADES = 8.0
"""Decades about the size of the problem that are scanned if the bisection has no upper end."""
_LOWER = 0.97
"""In a scan over rising γ a controller counts as better only if its norm is 3 % lower: at a larger
γ nearly the same controller results, with other rounding."""
_NEARLY = 0.99
"""A gap of 1 % between γ and its proved lower bound, or an improvement of less, does not justify a
scan."""
_AT_BOUND = 1.002
"""Ratio of a norm to its lower bound, beside the back-off, up to which nothing better is sought:
the bisection's tolerance and the margins of the proof leave no more."""
_WORTH = 0.999
"""Share of the norm below which a loop of a regularised problem replaces one without."""
_SHARES = (0.98, 0.9, 0.5)
"""Shares of the best γ at which a controller is tried before a scan, which takes up to 96
attempts."""
_SLOPE = 5.0
"""Slope of the slack over ln γ with which a search begins: it is two where X and Y hardly change
with γ, more where they do; a wrong one costs one step of the secant method."""
_CLOSE = 1e-2
"""Relative width of the bracket of γ in which the secant method begins."""
_STEPS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.2, 0.4)
"""Relative steps below the bisection's lower end at which a proof of the lower bound is tried. Just
below it X or Y is nearly infinite, and its rounding error exceeds what the proof needs."""


@dataclass(frozen=True)
class HinfDesign:
    """An H∞ controller, its closed loop and bounds of γ.

    Parameters
    ----------
    controller : LtiSystem
        From y to u, of the order of the plant.
    gamma : float
        The closed loop's norm, computed from the closed loop; its upper bound `norm.upper` where
        rounding may have changed the norm by more than 1 % (`norm.doubt` says so), as where the
        norm is next to nothing beside the plant's entries.
    closed_loop : LtiSystem
        From w to z.
    norm : HinfNorm
        Of it, with its peak's frequency.
    least : float
        The largest γ of which is proved, beyond the errors of rounding, that no controller of any
        order reaches it with the plant as given: as a rule the bisection's tolerance below
        `solvable`, lower (or 0) where the data are so badly conditioned or the problem so singular
        that this cannot be told; 0 with a regularisation that was given, which poses another
        problem.
    solvable : float
        The least γ found for which the Riccati equations are solvable, those of the regularised
        problem if a regularisation was given; `gamma` where rounding hides whether they are, or
        the regularisation was chosen here.
    added : Regularisation or None
        Weights and noise that were added for the synthesis alone; None if there are none. `gamma`,
        `norm` and `closed_loop` are those of the plant without them.
    """

    controller: LtiSystem
    gamma: float
    closed_loop: LtiSystem
    norm: HinfNorm
    least: float
    solvable: float
    added: Regularisation | None = None


def hinf_synthesis(
    plant: LtiSystem,
    controls: int,
    measurements: int,
    *,
    tolerance: float = 1e-4,
    back_off: float = 0.005,
    regularisation: float | None = None,
    slicot: bool = False,
) -> HinfDesign:
    """Return a controller that nearly minimises the gain from w to z.

    Parameters
    ----------
    plant : LtiSystem
        Its last inputs are the controls u, its last outputs the measurements y; in discrete time
        its bilinear image is used.
    controls, measurements : int
        Numbers of u and y.
    tolerance : float
        Relative width at which the bisection of γ ends.
    back_off : float
        By how much the γ of the controller is larger than the least one; it is enlarged where the
        controller does not pass the check of its closed loop. Where a regularisation is chosen here
        (`HinfDesign.added`), it only says from which γ on the search goes on: it has no effect
        below what that search reaches.
    regularisation : float or None
        Weight that is put on every control, and size of the noise that is put on every measurement,
        for the synthesis only: makes problems solvable in which D12 or D21 lacks full rank, for a γ
        that is a little larger. The closed loop is that of the plant as given. None: problems that
        are singular, fail, or end more than the back-off and 0.2 % above their lower bound are
        regularised by weights and noise of many sizes, on states too, and the best loop is taken;
        what was added is in `HinfDesign.added`. 0: never.
    slicot : bool
        Whether the bisection begins beside what SLICOT's SB10AD finds, which saves most of its
        steps. The Riccati equations are solved on both sides of it here, and the same is checked:
        the result is the same within the tolerance, its last bits are others.

    Returns
    -------
    HinfDesign
        The controller, checked.

    Raises
    ------
    InputError
        If the numbers do not fit, an option is out of its range, or SLICOT is asked for and the
        package slycot is not installed.
    NotStabilisableError
        If u cannot stabilise the plant, or y does not show an unstable mode.
    SingularProblemError
        If no regularisation is allowed, or none helps, and a control has no weight (D12 without
        full column rank), a measurement no noise (D21 without full row rank), or the plant from u
        to z or from w to y a zero on the imaginary axis.
    SynthesisFailedError
        If no controller found passes the check.
    """
    (p, m), (k, q) = plant.shape, (controls, measurements)
    if not (0 < k <= m and 0 < q <= p):
        raise InputError(f"{k} controls and {q} measurements do not fit a plant of {p} × {m}")
    if not 1e-12 <= tolerance < 1.0:
        raise InputError(f"tolerance must be from 1e-12 to 1, got {tolerance}")
    for what, value in (("back-off", back_off), ("regularisation", regularisation)):
        if value is not None and not 0.0 <= value < np.inf:
            raise InputError(f"a {what} must be ≥ 0 and finite, got {value}")
    units = Units.of(plant, k, q)
    scaled = units.scale(plant)
    image = scaled if plant.dt_s is None else continuous(scaled)
    if regularisation is None:
        made = _solve_regularising(image, units, tolerance, back_off, slicot)
    else:
        made = _solve_given(image, units, tolerance, back_off, regularisation, slicot)
    if plant.dt_s is not None:
        added, least = made.added, made.least
        made = _verify_design(scaled, discrete(made.controller, plant.dt_s), made.solvable)
        made = replace(_attach_lower_bound(made, least), added=added)
    return replace(made, controller=units.restore(made.controller))


def least_gamma(
    plant: LtiSystem,
    controls: int,
    measurements: int,
    *,
    tolerance: float = 1e-6,
    regularisation: float = 0.0,
    near: tuple[float, float] | None = None,
) -> tuple[float, float]:
    """Return the least γ at which the Riccati equations are solvable, without a controller.

    Parameters
    ----------
    plant, controls, measurements
        As of `hinf_synthesis`; in continuous time.
    tolerance : float
        Relative accuracy of γ.
    regularisation : float
        As of `hinf_synthesis`, given.
    near : tuple of float, optional
        What was returned for a plant nearly the same: the search begins there.

    Returns
    -------
    gamma : float
        The least γ.
    slope : float
        Slope of the slack γ²/ρ(X Y) − 1 over ln γ there.

    Raises
    ------
    NotStabilisableError, SingularProblemError, SynthesisFailedError
        As of `hinf_synthesis`.
    """
    units = Units.of(plant, controls, measurements)
    problem = _pose(units.scale(plant), units, regularisation)
    if near is not None and (found := follow_gamma(problem, *near, tolerance)) is not None:
        return found
    low, high = problem.bracket()
    if high is None:
        raise SynthesisFailedError("the Riccati equations were solved for no γ")
    low, high = close_in(problem, low, high, _CLOSE)
    found = follow_gamma(problem, high, _SLOPE, tolerance)
    return found or (close_in(problem, low, high, tolerance)[1], _SLOPE)


def _pose(plant: LtiSystem, units: Units, regularisation: float) -> GammaProblem:
    """Return the problem of a plant in these units, with a given regularisation or none."""
    if regularisation:
        k, q = units.controls.size, units.measurements.size
        added = Regularisation.even(regularisation, k, q, plant.order)
        plant = units.scale_added(added).add_to(plant)
    # the Riccati equations are solved for the balanced states; the controller is the same
    return GammaProblem(balance_states(plant)[0], units.controls.size, units.measurements.size)


def _solve_given(
    plant: LtiSystem,
    units: Units,
    tolerance: float,
    back_off: float,
    regularisation: float,
    slicot: bool,
) -> HinfDesign:
    """Return the design with a given regularisation or none; the plant is in these units."""
    k, q = units.controls.size, units.measurements.size
    if not regularisation:
        problem = _pose(plant, units, 0.0)
        made = _search_gamma(plant, problem, tolerance, back_off, slicot)
        return _attach_lower_bound(made, problem.proved)
    added = Regularisation.even(regularisation, k, q, plant.order)
    try:
        problem = _pose(plant, units, regularisation)
        made = _search_gamma(plant, problem, tolerance, back_off, slicot)
    except SingularProblemError as error:
        what, _, _ = str(error).partition(";")
        raise SingularProblemError(
            f"with the regularisation given, {regularisation:g}: {what}; in the units of this "
            "plant it is too small, or weights on controls and noise on measurements are not what "
            "is missing: give a larger one, or none, and one is chosen for these units"
        ) from error
    return replace(_attach_lower_bound(made, 0.0), added=added)


def _solve_regularising(
    plant: LtiSystem,
    units: Units,
    tolerance: float,
    back_off: float,
    slicot: bool,
) -> HinfDesign:
    """Return the design without a regularisation if it is near its bound, else the best."""
    k, q = units.controls.size, units.measurements.size
    failed: HillsphereError | None = None
    best, least = None, 0.0
    even, _ = balance_states(plant)
    try:
        problem = GammaProblem(even, k, q)
    except SingularProblemError as error:
        failed = error
    else:
        try:
            best = _search_gamma(plant, problem, tolerance, back_off, slicot, scans=False)
            if not is_surely_stable(best.closed_loop.a):
                # a zero on the axis, cancelled: the loop has a mode there but for rounding
                best, failed = (
                    None,
                    SynthesisFailedError(
                        "the closed loop has a mode so near to the imaginary axis that rounding "
                        "decides whether it is stable"
                    ),
                )
        except (SingularProblemError, SynthesisFailedError) as error:
            failed = error
        least = problem.proved
    goal = (1.0 + back_off) * (1.0 + tolerance) * least * _AT_BOUND
    if best is None or rank_norm(best.norm) > goal:
        least = max(least, frequency_bound(plant, k, q))

        def attempt(
            problem: GammaProblem, gamma: float, added: Regularisation
        ) -> HinfDesign | None:
            made = _design_in_schur_form(plant, problem, gamma)
            if made is None:
                return None
            return replace(
                made, solvable=made.gamma, added=units.restore_added(added) if added else None
            )

        other = search_regularised(plant, k, q, best, attempt, goal)
        if other is not None and (
            best is None or rank_norm(other.norm) < _WORTH * rank_norm(best.norm)
        ):
            best = other
    if best is None:
        assert failed is not None
        b, c = even.b[:, plant.shape[1] - k :], even.c[plant.shape[0] - q :]
        weakest = describe_weakest_mode(even.a, b, c)
        raise type(failed)(
            f"{failed}; with weights and noise of any size added no stable loop was found either"
            + (f"; {weakest}" if weakest else "")
        ) from failed
    return _attach_lower_bound(best, least)


def _search_gamma(
    plant: LtiSystem,
    problem: GammaProblem,
    tolerance: float,
    back_off: float,
    slicot: bool,
    *,
    scans: bool = True,
) -> HinfDesign:
    """Return the design of a problem for a plant in continuous time, without a lower bound.

    Without scans of γ where the bisection is in doubt: another search follows.
    """
    low, high = problem.bracket()
    if problem.by_pencil and (singular := problem.singular()) is not None:
        raise singular
    if high is None:
        span = problem.size / 10.0**_DECADES, 10.0**_DECADES * problem.size
        best = _scan_gamma(plant, problem, span) if scans else None
        if best is None:
            raise SynthesisFailedError(
                f"the Riccati equations of the plant, of order {plant.order}, were solved for no "
                "γ, though no zero on the imaginary axis was found: its poles and zeros or its "
                "units lie too many decades apart for double precision; take very slow or fast "
                "modes out, or enlarge the weights of controls and noise"
            )
        return best
    if slicot:
        guess = hinf_guess(problem.plant, *problem.channels, high, 0.1 * tolerance)
        low, high = _bracket_guess(problem, guess, low, high, tolerance)
    low, high = bisect_gamma(problem, low, high, tolerance)
    # where X or Y is nearly infinite, a proof may be had a little below
    for step in _STEPS:
        if problem.proved < low * (1.0 - step):
            problem.solve(low * (1.0 - step))
    best = _back_off(plant, problem, high, back_off)
    below = max(problem.proved, high / 10.0**_DECADES)
    if scans and (
        best is None
        or (problem.proved < _NEARLY * low and _improves_below(plant, problem, best, below))
    ):
        best = _better(best, _scan_gamma(plant, problem, (below, 10.0 * high)))
    if best is None:
        raise SynthesisFailedError(
            f"the Riccati equations are solvable for γ = {high:.6g}, but no controller near it "
            "makes a stable closed loop in floating point; scale inputs and outputs to order "
            "one, or use a larger back_off"
        )
    return best


def _attach_lower_bound(design: HinfDesign, least: float) -> HinfDesign:
    """Return the design with a lower bound, none if the design itself refutes it."""
    if least > design.gamma * (1.0 + 1e-9):
        least = 0.0
    return replace(design, least=min(least, design.gamma))


def _better(one: HinfDesign | None, other: HinfDesign | None) -> HinfDesign | None:
    if one is None or other is None:
        return one or other
    return other if rank_norm(other.norm) < rank_norm(one.norm) else one


def _bracket_guess(
    problem: GammaProblem, guess: float, low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Return a bracket of γ around a guess, as far as the guess is right."""
    for gamma in (guess * (1.0 + 0.4 * tolerance), guess * (1.0 - 0.4 * tolerance)):
        if low < gamma < high:  # not if the guess is NaN
            if problem.solve(gamma) is None:
                low = gamma
            else:
                high = gamma
    return low, high


def _improves_below(
    plant: LtiSystem, problem: GammaProblem, best: HinfDesign, below: float
) -> bool:
    """Return whether a γ that the bisection has refused gives a better controller."""
    bisected = problem.by_pencil
    tried = [share * best.gamma for share in _SHARES if share * best.gamma > below]
    designs = []
    for problem.by_pencil in (False, True):
        designs += [_design_at(plant, problem, gamma, checked=False) for gamma in tried]
    problem.by_pencil = bisected
    limit = _NEARLY * best.norm.upper
    return any(made is not None and made.norm.upper < limit for made in designs)


def _scan_gamma(
    plant: LtiSystem, problem: GammaProblem, span: tuple[float, float]
) -> HinfDesign | None:
    """Return the best controller over a grid of γ, judged by its closed loop alone."""
    best: HinfDesign | None = None
    for problem.by_pencil in (False, True):
        own: HinfDesign | None = None
        at, width = float(np.sqrt(span[0] * span[1])), float(np.sqrt(span[1] / span[0]))
        for _ in range(_ROUNDS):  # after the first beside the best
            lowest = np.inf
            for gamma in np.geomspace(at / width, at * width, _TRIED):
                made = _design_at(plant, problem, float(gamma), checked=False)
                if made is None:
                    continue
                own = _better(own, replace(made, solvable=made.gamma))
                # a larger γ gives nearly the same controller, whatever rounding makes of it
                if made.norm.upper < _LOWER * lowest:
                    lowest, where = made.norm.upper, float(gamma)
            if lowest == np.inf:
                break
            at, width = where, width ** (2.0 / (_TRIED - 1))
        best = _better(best, own)
    return best


def _design_at(
    plant: LtiSystem,
    problem: GammaProblem,
    gamma: float,
    *,
    checked: bool = True,
    turned: bool = False,
) -> HinfDesign | None:
    """Return the central controller's design at a γ, None if there is none that works."""
    try:
        solved = problem.solve(gamma, checked=checked)
        controller = None if solved is None else problem.controller(gamma, *solved)
        if controller is None:
            return None
        if turned:
            controller = _turn_to_schur_form(controller)
        made = _verify_design(plant, controller, gamma)
        return None if turned and not is_surely_stable(made.closed_loop.a) else made
    except (SynthesisFailedError, InputError, np.linalg.LinAlgError):
        return None


def _design_in_schur_form(
    plant: LtiSystem, problem: GammaProblem, gamma: float
) -> HinfDesign | None:
    """Return the design at a γ whose controller has a block triangular A, None if none works.

    Near the least γ the controller has fast poles. In the states of the formulas they mix with the
    slow ones, and rounding spoils these; in balanced Schur form a loop's norm has two digits more.
    """
    made = None
    for problem.by_pencil in (False, True):
        made = _better(made, _design_at(plant, problem, gamma, checked=False, turned=True))
        if made is not None and not made.norm.doubt:
            break
    return made


def _turn_to_schur_form(controller: LtiSystem) -> LtiSystem:
    even, _ = balance_states(controller)
    if not even.order:
        return even
    a, turn = schur(even.a)
    turned = replace(even, a=a, b=turn.T @ even.b, c=even.c @ turn)
    return balance_states(turned)[0]


def _back_off(
    plant: LtiSystem, problem: GammaProblem, least: float, back_off: float
) -> HinfDesign | None:
    """Return the controller of the least back-off whose closed loop has the norm it should."""
    best: HinfDesign | None = None
    for factor in _BACK_OFFS:
        gamma = least * (1.0 + back_off * factor)
        best = _better(best, _design_at(plant, problem, gamma))
        if best is not None and best.gamma <= gamma * (1.0 + 1e-6):
            break
    return None if best is None else replace(best, solvable=least)


def _verify_design(plant: LtiSystem, controller: LtiSystem, solvable: float) -> HinfDesign:
    loop = lower_lft(plant, controller)
    if not loop.is_stable:
        raise SynthesisFailedError("the closed loop is not stable")
    norm = hinf_norm(loop)
    if not np.isfinite(norm.upper):
        raise SynthesisFailedError("the closed loop's entries do not determine its norm")
    gamma = norm.upper if norm.doubt else norm.value
    return HinfDesign(controller, gamma, loop, norm, 0.0, solvable)
