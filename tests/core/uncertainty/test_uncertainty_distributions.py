"""Distributions against closed forms, SciPy's own, and large samples."""

from __future__ import annotations

from math import asin, log, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Dispersion
from hillsphere.interfaces.dispersion import StageDispersion
from hillsphere.plugins import create, default_registry
from hillsphere.testing import example
from hillsphere.uncertainty.copula import correlated_factor
from hillsphere.uncertainty.samples import read_columns

NOMINAL = np.array([20.0, -4.0])


def made(type_: str, parameters: tuple[str, ...] = ("a", "b"), **keys: Any) -> Dispersion:
    model: Dispersion = create(
        "dispersions", type_, of="gravity.toy", parameters=parameters, **keys
    )
    return model


def uniform_numbers(count: int, rows: int = 2) -> Array:
    return np.random.default_rng(5).random((rows, count))


CASES: list[tuple[str, dict[str, Any], tuple[Any, Any]]] = [
    ("normal", {"sigma": 2.0}, (stats.norm(20, 2), stats.norm(-4, 2))),
    ("normal", {"sigma_relative": 0.1}, (stats.norm(20, 2), stats.norm(-4, 0.4))),
    (
        "normal",
        {"sigma": (2.0, 3.0), "offset": (1.0, -1.0), "scale": 2.0},
        (stats.norm(21, 4), stats.norm(-5, 6)),
    ),
    (
        "normal",
        {"sigma": 2.0, "truncate_sigmas": 1.5},
        (stats.truncnorm(-1.5, 1.5, 20, 2), stats.truncnorm(-1.5, 1.5, -4, 2)),
    ),
    ("uniform", {"half_width": 3.0}, (stats.uniform(17, 6), stats.uniform(-7, 6))),
    ("uniform", {"half_width_relative": 0.5}, (stats.uniform(10, 20), stats.uniform(-6, 4))),
    (
        "uniform",
        {"lower": (1.0, 2.0), "upper": (3.0, 6.0), "scale": 0.5},
        (stats.uniform(1.5, 1), stats.uniform(3, 2)),
    ),
    ("triangular", {"half_width": 3.0}, (stats.triang(0.5, 17, 6), stats.triang(0.5, -7, 6))),
    (
        "triangular",
        {"lower": (18.0, -8.0), "upper": (26.0, -4.0)},
        (stats.triang(0.25, 18, 8), stats.triang(1.0, -8, 4)),
    ),
    (
        "triangular",
        {"lower": (18.0, -8.0), "upper": (26.0, -3.0), "scale": 2.0},
        (stats.triang(0.25, 16, 16), stats.triang(0.8, -12, 10)),
    ),
]


@pytest.mark.parametrize(("type_", "keys", "expected"), CASES)
def test_quantiles_and_moments(type_: str, keys: dict[str, Any], expected: tuple[Any, Any]) -> None:
    model = made(type_, **keys)
    u = np.tile(np.concatenate([[1e-9, 1 - 1e-9], np.linspace(0.001, 0.999, 41)]), (2, 1))
    wanted = np.array([one.ppf(row) for one, row in zip(expected, u, strict=True)])
    assert_allclose(model.quantiles(u, NOMINAL), wanted, rtol=1e-9, atol=0)
    assert_allclose(model.mean(NOMINAL), [one.mean() for one in expected], rtol=1e-12)
    variances = [one.var() for one in expected]
    assert_allclose(model.covariance(NOMINAL), np.diag(variances), rtol=1e-9, atol=1e-300)


def test_log_normal() -> None:
    model = made("log_normal", factor=(1.2, 3.0), scale=2.0)
    expected = stats.lognorm(2 * log(1.2), scale=20.0), stats.lognorm(2 * log(3.0), scale=4.0)
    u = np.tile(np.linspace(0.001, 0.999, 31), (2, 1))
    wanted = np.array([expected[0].ppf(u[0]), -expected[1].ppf(u[1])])
    assert_allclose(model.quantiles(u, NOMINAL), wanted, rtol=1e-11)
    assert_allclose(model.mean(NOMINAL), [expected[0].mean(), -expected[1].mean()], rtol=1e-12)
    variances = np.diag(model.covariance(NOMINAL))
    assert_allclose(variances, [one.var() for one in expected], rtol=1e-12)
    lower, upper = model.bounds(NOMINAL, 1.5)
    assert_allclose(lower, [20.0 / 1.2**3, -4.0 * 27.0], rtol=1e-12)
    assert_allclose(upper, [20.0 * 1.2**3, -4.0 / 27.0], rtol=1e-12)


def test_choice() -> None:
    model = made("choice", ("a",), values=(5.0, 1.0, 2.0), weights=(1.0, 2.0, 1.0))
    u = np.array([[0.01, 0.49, 0.51, 0.74, 0.76, 0.999999]])
    assert_array_equal(model.quantiles(u, NOMINAL[:1]), [[1.0, 1.0, 2.0, 2.0, 5.0, 5.0]])
    assert_allclose(model.mean(NOMINAL[:1]), [2.25])
    assert_allclose(model.covariance(NOMINAL[:1]), [[0.25 * 25 + 0.5 + 1.0 - 2.25**2]])
    assert_array_equal(model.bounds(NOMINAL[:1], 10.0), ([1.0], [5.0]))
    wide = made("choice", ("a",), values=(0.0, 4.0), scale=3.0)
    assert_array_equal(wide.quantiles(np.array([[0.2, 0.8]]), NOMINAL[:1]), [[-4.0, 8.0]])


def test_choice_of_weight_zero_is_never_made() -> None:
    model = made("choice", ("a",), values=(1.0, 2.0, 3.0), weights=(0.0, 1.0, 0.0))
    u = np.array([[0.0, 1e-300, 0.5, 1.0 - 2.0**-53, 1.0]])
    assert_array_equal(model.quantiles(u, NOMINAL[:1]), [[2.0] * 5])
    assert_array_equal(model.bounds(NOMINAL[:1], 5.0), ([2.0], [2.0]))


@pytest.mark.parametrize("unit", ["km", "deg"])
def test_units(unit: str) -> None:
    factor = {"km": 1e3, "deg": pi / 180}[unit]
    model = made("normal", unit=unit, sigma=2.0, offset=1.0)
    assert model.unit == {"km": "m", "deg": "rad"}[unit]
    assert_allclose(model.mean(NOMINAL), NOMINAL + factor, rtol=1e-15)
    assert_allclose(np.sqrt(np.diag(model.covariance(NOMINAL))), 2 * factor, rtol=1e-15)
    assert made("normal", sigma=1.0).unit == ""
    limits = made("uniform", unit=unit, lower=1.0, upper=3.0)
    assert_allclose(limits.mean(NOMINAL), 2 * factor, rtol=1e-15)


def test_a_speed_and_a_gravitational_parameter() -> None:
    assert made("normal", unit="mm_s", sigma=1.0).unit == "m/s"
    assert made("normal", unit="km3_s2", sigma=1.0).unit == "m3/s2"


# --- correlation --------------------------------------------------------------------------------


def joint(rho: float) -> tuple[tuple[float, float], tuple[float, float]]:
    return ((1.0, rho), (rho, 1.0))


@pytest.mark.parametrize("rho", [-1.0, -0.6, 0.3, 0.95, 1.0])
def test_covariance_of_correlated_pairs(rho: float) -> None:
    normal = made("normal", sigma=(2.0, 3.0), correlation=joint(rho))
    assert_allclose(normal.covariance(NOMINAL), [[4, 6 * rho], [6 * rho, 9]], rtol=1e-14)
    # Pearson's coefficient of uniform marginals under a Gaussian copula: 6/π arcsin(ρ/2).
    uniform = made("uniform", half_width=3.0, correlation=joint(rho))
    assert_allclose(uniform.covariance(NOMINAL)[0, 1], 18 / pi * asin(rho / 2), rtol=1e-9)
    logs = made("log_normal", factor=(1.2, 1.5), correlation=joint(rho))
    product = log(1.2) * log(1.5) * rho
    mean = logs.mean(NOMINAL)
    assert_allclose(
        logs.covariance(NOMINAL)[0, 1], mean[0] * mean[1] * (np.exp(product) - 1), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("type_", "keys"),
    [("normal", {"sigma": 1.0, "truncate_sigmas": 1.2}), ("triangular", {"half_width": 1.0})],
)
@pytest.mark.parametrize("rho", [-0.8, 0.5])
def test_covariance_by_series_against_quadrature(
    type_: str, keys: dict[str, Any], rho: float
) -> None:
    model = made(type_, correlation=joint(rho), **keys)
    plain = made(type_, **keys)

    nodes, weights = np.polynomial.legendre.leggauss(160)
    x, w = 8.0 * nodes, 8.0 * weights
    g = plain.quantiles(np.tile(stats.norm.cdf(x), (2, 1)), np.zeros(2))[0]
    a, b = np.meshgrid(x, x, indexing="ij")
    density = np.exp(-(a * a - 2 * rho * a * b + b * b) / (2 * (1 - rho**2)))
    expected = (w * g) @ density @ (w * g) / (2 * pi * sqrt(1 - rho**2))
    assert_allclose(model.covariance(np.zeros(2))[0, 1], expected, rtol=2e-5)


@pytest.mark.parametrize(
    ("type_", "keys"),
    [
        ("normal", {"sigma": (2.0, 0.1)}),
        ("normal", {"sigma": 1.0, "truncate_sigmas": 1.0}),
        ("uniform", {"half_width": 1.0}),
        ("triangular", {"half_width": (1.0, 5.0)}),
        ("log_normal", {"factor": 1.4}),
    ],
)
def test_drawn_numbers_have_the_covariance(type_: str, keys: dict[str, Any]) -> None:
    model = made(type_, correlation=joint(-0.7), **keys)
    values = model.quantiles(uniform_numbers(200_000), NOMINAL)
    spread = np.sqrt(np.diag(model.covariance(NOMINAL)))
    scale = np.outer(spread, spread)
    # Standard error of a sample covariance of 200 000: about 0.0025 of the scale.
    assert_allclose(np.cov(values) / scale, model.covariance(NOMINAL) / scale, rtol=0, atol=0.015)
    assert_allclose(values.mean(axis=1), model.mean(NOMINAL), rtol=0, atol=0.01 * spread.max())


def test_correlation_that_is_singular_or_impossible() -> None:
    ones = np.ones((3, 3))
    lower = correlated_factor(ones)
    assert_allclose(lower @ lower.T, ones, rtol=1e-14)
    assert_allclose(lower, [[1, 0, 0]] * 3, rtol=0, atol=1e-7)
    matrix = np.array([[1, 0.5, 0.2], [0.5, 1, -0.3], [0.2, -0.3, 1]])
    assert_allclose(correlated_factor(matrix), np.linalg.cholesky(matrix), rtol=0, atol=1e-14)
    with pytest.raises(InputError, match=r"the matrix has the eigenvalue -0\.8"):
        made(
            "normal",
            ("a", "b", "c"),
            sigma=1.0,
            correlation=((1.0, 0.9, 0.9), (0.9, 1.0, -0.9), (0.9, -0.9, 1.0)),
        )


def test_correlated_numbers_do_not_depend_on_their_company() -> None:
    k = 40
    correlation = 0.7 ** np.abs(np.subtract.outer(np.arange(k), np.arange(k)))
    model = made(
        "normal", tuple(f"q{i}" for i in range(k)), sigma=1.0, correlation=correlation.tolist()
    )
    u = uniform_numbers(100, k)
    whole = model.quantiles(u, np.zeros(k))
    for count in (1, 2, 3, 63, 99):
        assert_array_equal(model.quantiles(u[:, :count], np.zeros(k)), whole[:, :count])


def test_fully_correlated_quantities_move_together() -> None:
    model = made("normal", sigma=(1.0, 2.0), correlation=joint(1.0))
    values = model.quantiles(uniform_numbers(50), np.zeros(2))
    assert_allclose(values[1], 2 * values[0], rtol=1e-6)


# --- what is refused when it meets its quantities -------------------------------------------


@pytest.mark.parametrize(
    ("type_", "keys", "message"),
    [
        ("normal", {"sigma": (1.0, 2.0, 3.0)}, "sigma is given for 3 quantities, but"),
        ("normal", {"sigma_relative": (1.0,)}, "sigma_relative is given for 1 quantities, but"),
        ("normal", {"sigma": 1.0, "offset": (1.0, 1.0, 1.0)}, "offset is given for 3"),
        ("uniform", {"half_width": (1.0,)}, "half_width is given for 1"),
        ("uniform", {"lower": (0.0,), "upper": 1.0}, "lower is given for 1"),
        ("log_normal", {"factor": (2.0,)}, "factor is given for 1"),
        ("normal", {"sigma": 1.0, "correlation": ((1.0,),)}, "correlation is given for 1"),
        ("samples", {"rows": ((1.0,), (2.0,))}, "a column is given for 1"),
        ("triangular", {"lower": 0.0, "upper": 30.0}, "the nominal value -4, the most probable"),
    ],
)
def test_sizes_that_do_not_fit(type_: str, keys: dict[str, Any], message: str) -> None:
    model = made(type_, **keys)
    with pytest.raises(InputError, match=message):
        model.quantiles(uniform_numbers(3), NOMINAL)
    again = model.covariance if "correlation" in keys else lambda x: model.bounds(x, 3.0)
    with pytest.raises(InputError, match=message):
        again(NOMINAL)


def test_limits_that_are_no_limits() -> None:
    with pytest.raises(InputError, match=r"lower must not be above upper, got 2\.0 and 1\.0"):
        made("uniform", lower=2.0, upper=1.0)
    with pytest.raises(InputError, match="lower is given for 2 quantities, upper for 3"):
        made("triangular", lower=(1.0, 2.0), upper=(1.0, 2.0, 3.0))


# --- samples --------------------------------------------------------------------------------------

ROWS = ((1.0, 10.0), (2.0, 30.0), (6.0, 20.0))


def test_samples_are_drawn_whole() -> None:
    model = made("samples", rows=ROWS, unit="km")
    values = model.quantiles(np.array([[0.1, 0.5, 0.99], [0.9, 0.2, 0.3]]), NOMINAL)
    assert_array_equal(values, 1e3 * np.array(ROWS).T)
    assert_allclose(model.mean(NOMINAL), [3e3, 20e3])
    assert_allclose(model.covariance(NOMINAL), np.cov(1e3 * np.array(ROWS).T, bias=True))
    lower, upper = model.bounds(NOMINAL, 9.0)
    assert_array_equal((lower, upper), ([1e3, 10e3], [6e3, 30e3]))
    half = made("samples", rows=ROWS, scale=0.5)
    assert_allclose(half.covariance(NOMINAL), 0.25 * np.cov(np.array(ROWS).T, bias=True))
    assert_allclose(half.quantiles(np.array([[0.1], [0.9]]), NOMINAL), [[2.0], [15.0]])


def test_samples_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "samples.csv"
    path.write_text('# of an estimation\nb,"C2,0",a\n10,0,1\n30,0,2\n\n20,0,6\n')
    model = made("samples", file=str(path))
    assert_array_equal(model.quantiles(np.full((2, 1), 0.5), NOMINAL), [[2.0], [30.0]])
    assert made("samples", ("C2,0",), file=str(path)).mean(NOMINAL[:1]) == 0.0
    with pytest.raises(InputError, match=r"samples\.csv: no column 'c'; it has b, C2,0, a"):
        made("samples", ("c",), file=str(path))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"a,b\n", r"t\.csv: needs a line of column names and at least one row"),
        (b"", r"t\.csv: needs a line of column names"),
        (b"a,b\n1,2\n3\n", r"t\.csv:3: 2 numbers expected, got 1"),
        (b"a,b\n1,x\n", r"t\.csv:2: b: expected a number, got 'x'"),
        (b"a,b\n1,inf\n", r"t\.csv:2: b: must be finite, got 'inf'"),
        (b"a,a\n1,2\n", r"t\.csv:1: column names must be there and differ"),
        (b"a,\n1,2\n", r"t\.csv:1: column names must be there and differ"),
        (b'a,"b\n1,2\n', r"t\.csv: not a CSV table"),
        (b"a,b\n1,\xff\n", r"t\.csv: not UTF-8 text"),
    ],
)
def test_tables_that_are_none(tmp_path: Path, text: bytes, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(text)
    with pytest.raises(InputError, match=message):
        read_columns(path)


# --- for all ----------------------------------------------------------------------------------


class Started:
    """A stage whose start has a covariance."""

    def start_covariance(self) -> Array:
        root = np.random.default_rng(1).normal(size=(6, 6))
        return np.asarray(root @ root.T)


@pytest.mark.parametrize(
    ("type_", "number"),
    [
        (record.component.type, number)
        for record in default_registry().of_kind("dispersions")
        for number in range(len(record.load_spec().examples))
    ],
)
def test_every_example_keeps_the_interface(type_: str, number: int) -> None:
    model: Dispersion = example("dispersions", type_, number)
    if isinstance(model, StageDispersion):
        model = model.bind_to(Started())
    count = len(model.keys)
    nominal = np.resize([20.2e3, 20.1e3], count)
    u = uniform_numbers(4000, count)
    values = model.quantiles(u, nominal)
    assert values.shape == u.shape
    assert np.isfinite(values).all()
    assert_array_equal(model.quantiles(u[:, 7:9], nominal), values[:, 7:9])
    mean, covariance = model.mean(nominal), model.covariance(nominal)
    assert mean.shape == (count,)
    assert_allclose(covariance, covariance.T, rtol=1e-14)
    deviation = np.sqrt(np.diag(covariance))
    assert_allclose(values.mean(axis=1), mean, rtol=0, atol=0.1 * deviation.max())
    for sigmas in (0.0, 1.0, 30.0):
        lower, upper = model.bounds(nominal, sigmas)
        assert (lower <= upper).all()
    assert ((values >= lower[:, None]) & (values <= upper[:, None])).all()


SIZES = st.floats(1e-6, 1e6)
VALUES = st.floats(-1e6, 1e6)
NUMBERS = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20)


@settings(max_examples=150, deadline=None)
@given(nominal=VALUES, size=SIZES, cut=st.floats(0.1, 6.0), u=NUMBERS, scale=st.floats(0.0, 5.0))
def test_bounded_support_is_never_left(
    nominal: float, size: float, cut: float, u: list[float], scale: float
) -> None:
    about = np.array([nominal])
    ordered = np.sort(np.array([u]))
    for model in (
        made("normal", ("a",), sigma=size, truncate_sigmas=cut, scale=scale),
        made("uniform", ("a",), half_width=size, scale=scale),
        made("triangular", ("a",), half_width=size, scale=scale),
        made("triangular", ("a",), lower=nominal, upper=nominal + size, scale=scale),
        made("choice", ("a",), values=(nominal, size), scale=scale),
    ):
        values = model.quantiles(ordered, about)
        least, largest = model.bounds(about, 1e3)
        slack = 1e-13 * (abs(nominal) + size * (1.0 + scale * cut))
        assert np.isfinite(values).all()
        assert (values >= least - slack).all()
        assert (values <= largest + slack).all()
        assert (np.diff(values) >= -slack).all()  # quantiles rise
        lower, upper = model.bounds(about, 1.0)
        mean = model.mean(about)
        assert (least - slack <= lower).all()
        assert (lower <= mean + slack).all()
        assert (mean <= upper + slack).all()
        assert (upper <= largest + slack).all()


@settings(max_examples=100, deadline=None)
@given(nominal=VALUES, sigma=SIZES, u=st.floats(1e-12, 0.5))
def test_symmetric_about_the_mean(nominal: float, sigma: float, u: float) -> None:
    about = np.array([nominal])
    for keys in ({"sigma": sigma}, {"sigma": sigma, "truncate_sigmas": 2.0}):
        model = made("normal", ("a",), **keys)
        below, above = model.quantiles(np.array([[u, 1.0 - u]]), about)[0]
        # 1 − u holds u to 1e-16 only.
        slack = sigma * 1e-16 / u * 10 + 1e-13 * (abs(nominal) + sigma)
        assert abs((below - nominal) + (above - nominal)) <= slack
