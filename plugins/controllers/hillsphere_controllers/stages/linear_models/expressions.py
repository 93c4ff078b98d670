"""Entries of matrices as numbers or as formulas of parameters, ``"-k / m1"``.

Arithmetic only: numbers, names of parameters, ``+ - * / **``, brackets and a few functions of one
number. Nothing else is read, and nothing is executed.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterator, Mapping

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError

__all__ = ["FUNCTIONS", "evaluate_entry", "parameter_names"]

FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "sin": math.sin, "cos": math.cos,
    "tan": math.tan, "abs": abs,
}  # fmt: skip
"""Functions that a formula may call."""

_LONGEST = 200
"""Characters of a formula at most. It keeps the parser's recursion and the time of evaluation small
for any mission file."""
_OPERATORS: Mapping[type[ast.AST], Callable[[float, float], float]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow,
}  # fmt: skip
_PLAIN = (ast.BinOp, ast.UnaryOp, ast.Name, ast.Load)
_SIGNS: Mapping[type[ast.AST], float] = {ast.UAdd: 1.0, ast.USub: -1.0}


def parameter_names(text: str) -> set[str]:
    """Return the names of the parameters in a formula.

    Raises
    ------
    InputError
        If it is no formula of the kind that is read.
    """
    return set(_names(_parse(text), text))


def evaluate_entry(entry: float | str, values: Mapping[str, float]) -> float:
    """Return the value of an entry for values of the parameters.

    Parameters
    ----------
    entry : float or str
        A number, or a formula.
    values : mapping of str to float
        Of the parameters.

    Raises
    ------
    InputError
        If it is no formula, a name is unknown, or the value is not finite and real.
    """
    if not isinstance(entry, str):
        return float(entry)
    known = dict(values) | {"pi": math.pi}
    tree = _parse(entry)
    for name in _names(tree, entry):
        if name not in known:
            hint = did_you_mean(name, known, otherwise="there are")
            raise InputError(f"{entry!r}: no parameter {name!r}{hint}")
    try:
        value = _value(tree, known)
    except (ArithmeticError, ValueError) as error:
        raise InputError(f"{entry!r} has no value for {_format_values(values)}: {error}") from error
    if isinstance(value, complex) or not math.isfinite(value):
        raise InputError(f"{entry!r} is not a finite real number for {_format_values(values)}")
    return value


def _parse(text: str) -> ast.expr:
    fault = f"{text[:60]!r} is no formula; write numbers, parameters, + - * / ** and brackets"
    if len(text) > _LONGEST:
        raise InputError(f"a formula has at most {_LONGEST} characters, got {len(text)}")
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise InputError(fault) from None
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            if (
                not isinstance(node.func, ast.Name)
                or node.func.id not in FUNCTIONS
                or len(node.args) != 1
                or node.keywords
            ):
                raise InputError(f"{text!r}: only {', '.join(FUNCTIONS)} of one number are known")
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, bool) or not isinstance(node.value, int | float):
                raise InputError(fault)
        elif not isinstance(node, (*_PLAIN, *_OPERATORS, *_SIGNS)):
            raise InputError(fault)
    return tree


def _names(tree: ast.expr, text: str) -> Iterator[str]:
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and id(node) not in called and node.id != "pi":
            yield node.id


def _value(node: ast.expr, values: Mapping[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name):
            return values[name]
        case ast.UnaryOp(op=sign, operand=inner):
            return _SIGNS[type(sign)] * _value(inner, values)
        case ast.BinOp(left=left, op=operation, right=right):
            return _OPERATORS[type(operation)](_value(left, values), _value(right, values))
        case ast.Call(func=ast.Name(id=name), args=[inner]):
            return FUNCTIONS[name](_value(inner, values))
    raise InputError("not a formula")


def _format_values(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in values.items()) or "no parameters"
