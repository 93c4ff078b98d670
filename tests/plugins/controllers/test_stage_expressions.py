"""Formulas of parameters: what is read, what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere_controllers.stages.linear_models.expressions import evaluate_entry, parameter_names


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-k / m1", -2.5),
        ("2*k**2 - +m1", 2.0 * 25.0 - 2.0),
        ("sqrt(k / m1)", math.sqrt(2.5)),
        ("cos(pi) * abs(-k)", -5.0),
        (" (k + 1) * 1e-3 ", 6e-3),
        (3.5, 3.5),
    ],
)
def test_formulas_have_their_values(text: float | str, value: float) -> None:
    assert evaluate_entry(text, {"k": 5.0, "m1": 2.0}) == pytest.approx(value, rel=1e-15)


def test_names_are_those_of_parameters_only() -> None:
    assert parameter_names("sqrt(k) * m1 - pi") == {"k", "m1"}


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')", "k.real", "k[0]", "lambda: 1", "k if k else 1", "'k'", "True", "k < 1",
        "sqrt(k, 2)", "open(k)", "k; k", "", "1 +", "(" * 150, "k" * 201, "1j", "[k]", "k // 2",
        "sqrt(*k)",
    ],
)  # fmt: skip
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parameter_names(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 / (k - 5)", "no value"),
        ("(-k) ** 0.5", "no finite|not a finite"),
        ("k ** 1e9", "no value"),
        ("log(-k)", "no value"),
        ("stiffness", "no parameter 'stiffness'"),
        ("1e308 * 10", "not a finite"),
    ],
)
def test_what_has_no_value_is_said(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        evaluate_entry(text, {"k": 5.0})


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.text(max_size=40))
def test_no_text_does_anything_but_have_a_value_or_be_refused(text: str) -> None:
    try:
        value = evaluate_entry(text, {"k": 1.0})
    except InputError:
        return
    assert math.isfinite(value)
