"""The stage ``bifurcations``: where other families branch off a family of planar orbits.

A family of orbits that close after n revolutions branches off where a pair of multipliers is
e^{±2πi d/n}, that is where the stability index of its plane is b = 2 cos(2π d/n).

References
----------
.. [1] Robin, I. A., Markellos, V. V., Numerical determination of three-dimensional periodic orbits
   generated from vertical self-resonant satellite orbits, Celestial Mechanics 21, 1980, p. 395.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, gcd, pi

import numpy as np

from hillsphere.errors import StageError
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Presentation
from hillsphere.products import Bifurcations
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.correction import tangents
from hillsphere_orbits.members import insert_members, members_where
from hillsphere_orbits.qso.families import Qso
from hillsphere_orbits.qso.figures import resonance_chart
from hillsphere_orbits.qso.presentation import label_identifier
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.qso.qso_family import family_of
from hillsphere_orbits.qso.specs import BifurcationSpec, read_resonance
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.stability import stability_indices
from hillsphere_orbits.survey import Surveyor, require_accuracy

__all__ = ["BifurcationStage", "resonances_up_to"]

_SAME_EQUATIONS = 1e-8
"""Largest residual, natural units, of orbits of the family that count as solutions of this plant's
equations. By default they are
computed to 1e-10 or better; other equations (another gravity model, say) give far more."""
_RESOLUTION = 1e-4  # of the index: extrema this shallow are seen
_PLANES = ("planar", "vertical")


def resonances_up_to(d_max: int, n_max: int) -> list[tuple[int, int]]:
    """Return every d:n in lowest terms with d ≤ d_max, n ≤ n_max and d ≤ n/2, and 1:1."""
    resonances = [
        (d, n)
        for n in range(1, n_max + 1)
        for d in range(1, min(d_max, max(1, n // 2)) + 1)
        if gcd(d, n) == 1
    ]
    return sorted(resonances, key=lambda pair: (pair[0], pair[1]))


class BifurcationStage:
    """Bifurcations along a family, at which other families branch off.

    Parameters
    ----------
    spec : BifurcationSpec
        With its references bound.
    """

    def __init__(self, spec: BifurcationSpec) -> None:
        self.spec = spec
        self.qso = family_of(
            spec.plant.get() if spec.plant else None,
            spec.family.get() if spec.family else None,
            spec.accuracy,
        )

    def run(
        self, ctx: Context, family: QsoFamily, compare: QsoFamily | None = None
    ) -> Bifurcations:
        """Find every bifurcation asked for, each of them wherever it occurs.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        family : QsoFamily
            The family that is searched.
        compare : QsoFamily, optional
            Shown beside it only.

        Returns
        -------
        Bifurcations
            In the order asked for, planar before vertical, and along the family.

        Raises
        ------
        StageError
            If the family is one of other equations than this stage's.
        InputError
            If a vertical resonance is asked for of orbits whose vertical motion is not separate.
        """
        problem, branch = self._branch(family)
        surveyor = Surveyor(self.qso.plant, problem)
        columns: list[Array] = []
        plane_of: list[str] = []
        pairs: list[tuple[int, int]] = []
        advance = ctx.track("bifurcations", len(_PLANES))
        for row, plane in enumerate(_PLANES):
            wanted = self._resonances_to_find(plane)
            if wanted:

                def index(z: Array, row: int = row) -> Array:
                    return stability_indices(problem.monodromy(z))[row]

                members = members_where(
                    problem,
                    insert_members(problem, branch, index, _RESOLUTION),
                    index,
                    np.array([2.0 * cos(2.0 * pi * d / n) for d, n in wanted]),
                )
                columns.append(members.z)
                plane_of += [plane] * len(members.target)
                pairs += [wanted[k] for k in members.target]
                for k in members.missing(len(wanted)):
                    ctx.info(f"no {plane} bifurcation {wanted[k][0]}:{wanted[k][1]} on this family")
            advance(1)
        z = np.concatenate(columns, axis=1) if columns else branch.z[:, :0]
        labels = tuple(f"{p} {d}:{n}" for p, (d, n) in zip(plane_of, pairs, strict=True))
        orbits = surveyor.orbits(z, labels)
        require_accuracy(orbits, self.qso.accuracy)
        indices = np.array(stability_indices(orbits.monodromy))
        rows = [_PLANES.index(plane) for plane in plane_of]
        return Bifurcations(
            orbits=orbits,
            plane=tuple(plane_of),
            d=tuple(d for d, _ in pairs),
            n=tuple(n for _, n in pairs),
            index=indices[rows, np.arange(len(rows))],
        )

    def present(
        self, product: Bifurcations, family: QsoFamily, compare: QsoFamily | None = None
    ) -> Presentation:
        """Show the list and the stability indices with the resonances marked."""
        label = self.spec.label
        low, high = family.curve.x0[0, [-1, 0]] / 1e3
        verdict = [
            f"{len(product.plane)} bifurcations of the resonances asked for lie between "
            f"x = {low:.6g} km and {high:.6g} km."
        ]
        absent = [
            f"{plane} {d}:{n}"
            for plane in _PLANES
            for d, n in self._resonances_to_find(plane)
            if (plane, d, n) not in set(zip(product.plane, product.d, product.n, strict=True))
        ]
        if absent:
            verdict.append(f"Not met there: {', '.join(absent)}.")
        own = label_identifier("bifurcations", label)
        return Presentation(
            tables={own: tabulate("Bifurcations of the family", _columns(product))},
            figures={
                label_identifier("resonances", label): resonance_chart(
                    family, compare, product, own
                )
            },
            verdict=verdict,
        )

    def _resonances_to_find(self, plane: str) -> Sequence[tuple[int, int]]:
        listed = self.spec.planar if plane == "planar" else self.spec.vertical
        pairs = [pair for text in listed if (pair := read_resonance(text))]
        if self.spec.n_max is not None:
            pairs += resonances_up_to(self.spec.d_max, self.spec.n_max)
        return list(dict.fromkeys(pairs))

    def _branch(self, family: QsoFamily) -> tuple[Shooting, Branch]:
        """Rebuild the family's curve on this stage's own equations."""
        qso: Qso = self.qso
        problem, _ = qso.problem
        system, curve = problem.flow.system, family.curve
        scales = qso.plant.scales
        z = problem.unknowns_at(curve.x0 / system.unit[:, None], curve.period_s / scales.time_s)
        problem = problem.with_steps(
            problem.flow.steps_for(problem.state(z), z[-1], 0.1 * qso.accuracy)
        )
        error = float(np.max(np.abs(problem.residual(z)[0])))
        if curve.frame != system.frame or not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the family's orbits (frame {curve.frame}) do not solve the equations of this "
                f"stage's plant (frame {system.frame}; residual {error:.1e}); give the plant with "
                "which the family was computed"
            )
        ends = family.ends
        return problem, Branch(z, tangents(problem, z, np.gradient(z, axis=1)), ends)


def _columns(product: Bifurcations) -> list[FilledColumn]:
    orbits, pairs = product.orbits, zip(product.d, product.n, strict=True)
    of, own = FieldColumns(orbits, "orbits"), FieldColumns(product, "bifurcations")
    speed = orbits.length_m / orbits.time_s
    return [
        own("plane"),
        text_column("resonance", [f"{d}:{n}" for d, n in pairs], "d:n"),
        own("d"),
        own("n"),
        column("x0_km", orbits.x0[0], "x at the crossing", 12),
        column("period", orbits.period_s / orbits.time_s, "period in 1/n", 12),
        of("period_s", digits=8),
        column("vy0", orbits.x0[4] / speed, "ẏ at the crossing", 12),
        of("integral", "jacobi", digits=10),
        own("index", "b"),
    ]
