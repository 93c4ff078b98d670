"""Gravity as a spherical-harmonic series."""

from __future__ import annotations

import logging
from math import isqrt, prod, sqrt

from hillsphere.errors import InputError
from hillsphere.formats.coefficients import Coefficient, CoefficientTable
from hillsphere.interfaces import Parameter
from hillsphere.symbolic import (
    Expr,
    Params,
    Vec3,
    absolute,
    constant,
    gradient,
    power,
    spherical_harmonics_potential,
    substitute,
    sum_of,
    variables,
)
from hillsphere.symbolic import sqrt as symbolic_sqrt
from hillsphere_gravity.coefficient_rows import read_coefficient_rows
from hillsphere_gravity.cof import read_cof
from hillsphere_gravity.icgem import read_icgem
from hillsphere_gravity.shadr import read_shadr
from hillsphere_gravity.specs import HarmonicsSpec, file_format_of

__all__ = ["Harmonics", "check_cost", "compile_time", "in_words", "normalisation_factor"]

_COMPILE_S, _COMPILE_MB = 0.02, 0.35
"""Time, s, and memory, MB, that compiling takes for each square of the degree: measured for the
gradient, the dearest evaluator, 2.3, 10, 20, 29 and 55 s at degrees 10, 20, 30, 40 and 60, and
1.3 GB at 60 (one core of a server of 2024). Acceleration alone takes a fifth. The equations
of a family of orbits with their variations take longer, see `_FAMILY`."""
_FAMILY = (0.22, 2.4)
"""Factor, s, and power of the degree of the time that the equations of a family of orbits compile,
of all coefficients and with variations: from 6.2, 17 and 33 s of CPU time at degrees 4, 6 and 8;
beyond these it is an extrapolation."""
_TOLD_FROM_S = 60.0
"""Estimated time from which it is told: a minute without any sign seems to be a fault."""
_MOST_UNASKED_S = 300.0
"""Estimated time up to which the degree of the file is taken where max_degree is not given."""
_PLAIN = variables("harmonics:x", "harmonics:y", "harmonics:z")


class Harmonics:
    """U = (GM/R) Σ (R/r)^(n+1) P̄nm(sin φ) (C̄nm cos mλ + S̄nm sin mλ).

    φ and λ are latitude and east longitude in the body-fixed frame; P̄nm is 4π-normalised, without
    the Condon–Shortley phase ([1]_, §3.2). Finite at the poles. The series converges outside the
    sphere about the origin that holds the body (Brillouin sphere); nearer it may mean nothing.
    `hillsphere.gravity.GravityField` says what each degree costs to compile and to evaluate.

    Parameters
    ----------
    spec : HarmonicsSpec
        Its parameters. Run-time parameters: ``gm`` and, for each listed coefficient above degree
        0, ``Cn,m`` and (m > 0) ``Sn,m``, in the normalisation of the spec; list one as zero to
        disperse it about zero.

    Raises
    ------
    InputError
        If a file is malformed, contradicts the spec, lacks what the spec does not give, or does
        not reach `max_degree`.

    References
    ----------
    .. [1] O. Montenbruck, E. Gill (2000), Satellite Orbits.
    """

    frame = "body"

    def __init__(self, spec: HarmonicsSpec) -> None:
        table = _table(spec)
        degree = table.max_degree if spec.max_degree is None else spec.max_degree
        check_cost(spec.file or "the series", degree, asked=spec.max_degree is not None)
        tesseral = degree if spec.max_tesseral_degree is None else spec.max_tesseral_degree
        order = degree if spec.max_order is None else spec.max_order
        self._take(table, degree, order, tesseral)

    def _take(self, table: CoefficientTable, degree: int, order: int, tesseral: int) -> None:
        """Use the rows of a table up to a degree and an order."""
        self.degree, self.order = degree, order
        self.reference_radius_m = table.reference_radius_m
        self.normalisation = table.normalisation
        self.tide_system = table.tide_system
        used = sorted(
            row
            for row in table.rows
            if row.n <= self.degree and row.m <= self.order and (row.m == 0 or row.n <= tesseral)
        )
        # C00 scales the mass as gm does: only gm is a run-time parameter.
        self._c00 = next((row.c for row in used if row.n == 0), 1.0)
        self._rows = tuple(row for row in used if row.n > 0)
        self._gm = table.gm_m3_s2
        self.gm_m3_s2 = self._gm * self._c00

    @property
    def series_radius_m(self) -> float:
        """The reference radius: the Brillouin sphere is a matter of the body's shape."""
        return self.reference_radius_m

    def parameters(self) -> tuple[Parameter, ...]:
        """Return ``gm``, then the coefficients by degree and order, C before S."""
        parameters = [Parameter("gm", self._gm, "m3/s2", positive=True)]
        for row in self._rows:
            parameters.append(Parameter(f"C{row.n},{row.m}", row.c))
            if row.m > 0:
                parameters.append(Parameter(f"S{row.n},{row.m}", row.s))
        return tuple(parameters)

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the body-fixed position r, m."""
        zero = constant(0.0)
        pairs = {(0, 0): (constant(self._c00), zero)}
        for row in self._rows:
            n, m = row.n, row.m
            factor = normalisation_factor(n, m) if self.normalisation == "none" else 1.0
            pairs[n, m] = (
                p[f"C{n},{m}"] / factor,
                p[f"S{n},{m}"] / factor if m > 0 else zero,
            )
        triangle = [(n, m) for n in range(self.degree + 1) for m in range(n + 1)]
        coefficients = [pairs.get(place, (zero, zero)) for place in triangle]
        return spherical_harmonics_potential(r, coefficients, p["gm"], self.reference_radius_m)

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s², at the body-fixed position r, m."""
        x, y, z = _PLAIN
        slopes = gradient(self.potential((x, y, z), p), _PLAIN)
        gx, gy, gz = substitute(slopes, dict(zip(_PLAIN, r, strict=True)))
        return (gx, gy, gz)

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        r"""Return an upper bound of \|∇U\|, m/s².

        Of the terms of degree n, by Cauchy's inequality and the addition theorem, with the sums
        over all orders Σ P̄² = 2n+1 of the functions and n(n+1)(2n+1) of their squared slopes on
        the unit sphere,

        .. math::

            |\nabla U_n| \le \frac{GM}{R^2}\left(\frac Rr\right)^{n+2}
            (2n+1)\sqrt{n+1}\,\Big(\sum_m \bar C_{nm}^2 + \bar S_{nm}^2\Big)^{1/2} .

        Here (n+1)²(2n+1) of the radial slope and n(n+1)(2n+1) of the others add up to
        (2n+1)²(n+1). The first term is GM/r² exactly.
        """
        near = self.reference_radius_m / distance
        terms: list[Expr] = [abs(self._c00) * near * near]
        squares: dict[int, list[Expr]] = {}
        for row in self._rows:
            n, m = row.n, row.m
            factor = normalisation_factor(n, m) if self.normalisation == "none" else 1.0
            for name in (f"C{n},{m}", f"S{n},{m}") if m else (f"C{n},{m}",):
                value = p[name] * (1.0 / factor)
                squares.setdefault(n, []).append(value * value)
        for n, parts in squares.items():
            size = (2 * n + 1) * sqrt(n + 1)
            terms.append(size * power(near, n + 2) * symbolic_sqrt(sum_of(parts)))
        gm = p["gm"] / (self.reference_radius_m * self.reference_radius_m)
        return absolute(gm) * sum_of(terms)


def normalisation_factor(n: int, m: int) -> float:
    """Ratio of the normalised to the conventional Legendre function, P̄nm / Pnm.

    Parameters
    ----------
    n, m : int
        Degree and order.

    Returns
    -------
    float
        √((2 − δ0m) (2n+1) (n−m)! / (n+m)!); a conventional coefficient divided by it is the
        normalised one.
    """
    return sqrt((2 - (m == 0)) * (2 * n + 1)) / prod(sqrt(k) for k in range(n - m + 1, n + m + 1))


def _table(spec: HarmonicsSpec) -> CoefficientTable:
    """Return the coefficients of the Spec, or of a file completed by the Spec, as one table."""
    if spec.file is not None:
        return _merge_with_file(spec, _read_file(spec, spec.file))
    gm, radius = spec.gm_m3_s2, spec.reference_radius_m
    if gm is None or radius is None:
        raise InputError("coefficients need gm_m3_s2 and reference_radius_m")
    return CoefficientTable(
        name="",
        gm_m3_s2=gm,
        reference_radius_m=radius,
        max_degree=max(row.n for row in spec.coefficients),
        normalisation=spec.normalisation,
        tide_system=spec.tide_system,
        rows=tuple(Coefficient(row.n, row.m, row.c, row.s) for row in spec.coefficients),
    )


def check_cost(name: str, degree: int, *, asked: bool) -> None:
    """Say before anything is compiled that it takes minutes; refuse what nobody asked for.

    Parameters
    ----------
    name : str
        The series in words.
    degree : int
        Its degree.
    asked : bool
        Whether the mission gives the degree.

    Raises
    ------
    InputError
        If compiling takes more than `_MOST_UNASKED_S` and was not asked for.
    """
    seconds, megabytes = _COMPILE_S * degree**2, _COMPILE_MB * degree**2
    if seconds <= _TOLD_FROM_S:
        return
    text = (
        f"{name}: its degree {degree} takes about {in_words(seconds)} and "
        f"{megabytes / 1e3:.3g} GB of memory to compile, with its gradient; a smaller max_degree "
        "makes it shorter"
    )
    if not asked and seconds > _MOST_UNASKED_S:
        raise InputError(f"{text}, and max_degree = {degree} says that this is wanted")
    logging.getLogger("hillsphere").warning(text)


def compile_time(degree: int) -> float:
    """Return about how long, s, the equations of a family of orbits compile for a degree."""
    factor, exponent = _FAMILY
    return float(factor * degree**exponent)


def in_words(seconds: float) -> str:
    """Return a time that is forecast: in seconds, minutes or hours."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400.0 else f"{seconds / 3600:.0f} h"


def _read_file(spec: HarmonicsSpec, file: str) -> CoefficientTable:
    format_ = file_format_of(spec)
    # A degree that is refused for its cost need not be kept in memory.
    degree = isqrt(int(_MOST_UNASKED_S / _COMPILE_S)) + 1
    degree = degree if spec.max_degree is None else spec.max_degree
    if format_ == "icgem":
        return read_icgem(file, spec.epoch, degree)
    if format_ == "shadr":
        return read_shadr(file, degree)
    if format_ == "cof":
        return read_cof(file)
    if spec.gm_m3_s2 is None or spec.reference_radius_m is None:
        key = "gm_m3_s2" if spec.gm_m3_s2 is None else "reference_radius_m"
        raise InputError(f"{file} does not state {key}; give it beside file")
    rows, highest = read_coefficient_rows(file, degree)
    return CoefficientTable(
        name="",
        gm_m3_s2=spec.gm_m3_s2,
        reference_radius_m=spec.reference_radius_m,
        max_degree=highest,
        normalisation=None,
        tide_system=None,
        rows=rows,
    )


def _merge_with_file(spec: HarmonicsSpec, table: CoefficientTable) -> CoefficientTable:
    """Return the table of a file completed by the Spec.

    Raises
    ------
    InputError
        If a key is stated by neither, or differently by both, or the file does not reach the
        degree.
    """
    for key in ("gm_m3_s2", "reference_radius_m", "normalisation", "tide_system"):
        asked, stated = getattr(spec, key), getattr(table, key)
        if asked is None and stated is None:
            raise InputError(f"{spec.file} does not state {key}; give it beside file")
        if asked is not None and stated is not None and asked != stated:
            raise InputError(f"{key} is {asked}, but {spec.file} states {stated}; leave it out")
    if spec.max_degree is not None and spec.max_degree > table.max_degree:
        raise InputError(
            f"max_degree must be ≤ {table.max_degree}, the degree of {spec.file}, "
            f"got {spec.max_degree}"
        )
    degree = table.max_degree if spec.max_degree is None else spec.max_degree
    if spec.max_order is not None and spec.max_order > degree:
        raise InputError(f"max_order must be ≤ {degree}, the degree used, got {spec.max_order}")
    if spec.max_tesseral_degree is not None and spec.max_tesseral_degree > degree:
        raise InputError(
            f"max_tesseral_degree must be ≤ {degree}, the degree used, got "
            f"{spec.max_tesseral_degree}"
        )
    return CoefficientTable(
        name=table.name,
        gm_m3_s2=table.gm_m3_s2,
        reference_radius_m=table.reference_radius_m,
        max_degree=table.max_degree,
        normalisation=table.normalisation or spec.normalisation,
        tide_system=table.tide_system or spec.tide_system,
        rows=table.rows,
    )
