"""Mutants of a module: small faults of the kinds that are made by hand, one at a time.

`generate_mutants` lists every place of a module's source where one of the operators below applies;
`draw_mutants` takes some of them by a seed. What is drawn depends on a hash of the seed, the
function and the source text, not on line numbers: an edit elsewhere in the file does not change it.

Not mutated, because a test of behaviour says nothing about it: docstrings, annotations, imports,
strings and the messages of errors, decorators, ``__all__``, plain numbers at the top of a module
and powers of ten outside 1e-5 to 1e5: how long a search goes on and how exactly. What is computed
from them is mutated. A dropped guard is a mutant, its message is not.
"""

from __future__ import annotations

import ast
from collections import Counter
from dataclasses import dataclass
from hashlib import sha256
from itertools import zip_longest

__all__ = ["Mutant", "draw_mutants", "generate_mutants"]

PER_LINE = 2
"""Most mutants drawn of one line: a dense formula would otherwise fill the sample."""

ARITHMETIC = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*"}
COMPARISONS = {
    ast.Lt: ("<=", ">"),
    ast.LtE: ("<", ">"),
    ast.Gt: (">=", "<"),
    ast.GtE: (">", "<"),
    ast.Eq: ("!=",),
    ast.NotEq: ("==",),
    ast.Is: ("is not",),
    ast.IsNot: ("is",),
    ast.In: ("not in",),
    ast.NotIn: ("in",),
}
SWAPS = {
    **{"min": "max", "minimum": "maximum", "argmin": "argmax", "fmin": "fmax", "floor": "ceil"},
    **{"any": "all", "sin": "cos", "zeros": "ones", "triu": "tril", "real": "imag"},
}
SWAPS |= {new: old for old, new in SWAPS.items()}
SYMMETRIC = {
    *("min", "max", "minimum", "maximum", "fmin", "fmax", "hypot", "add", "multiply", "zip"),
    *("isinstance", "issubclass", "dot", "allclose", "isclose", "array_equal"),
}
"""Functions whose first two arguments may be exchanged, or are of different kinds."""


@dataclass(frozen=True)
class Mutant:
    """One changed place of a source file.

    Parameters
    ----------
    function : str
        Qualified name of the function or class around it; "" at the top of the module.
    operator : str
        Kind of change: sign, factor, index, comparison, guard, …
    before, after : str
        Lines of the place without and with the change, stripped of surrounding blanks.
    line : int
        Number of the first of them.
    source : str
        The whole module with the change.
    """

    function: str
    operator: str
    before: str
    after: str
    line: int
    source: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What names the mutant while other lines move."""
        return self.function, self.before, self.after

    def __str__(self) -> str:
        """Return one line for the table of survivors."""
        where = f"{self.line} {self.function or '(module)'}"
        return f"{where} [{self.operator}]\n    - {self.before}\n    + {self.after}"


def generate_mutants(source: str) -> list[Mutant]:
    """Return all mutants of a module, in the order of its lines."""
    walker = _Walker(source)
    walker.visit(ast.parse(source))
    distinct = {mutant.key: mutant for mutant in walker.mutants}
    return sorted(distinct.values(), key=lambda mutant: (mutant.line, mutant.key))


def draw_mutants(mutants: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """Return `count` mutants, or all if there are fewer: every operator in turn.

    Parameters
    ----------
    mutants : list of Mutant
        From `generate_mutants`.
    count : int
        How many.
    seed : int
        Fixes the order within an operator.
    """

    def order(mutant: Mutant) -> bytes:
        return sha256("\0".join([str(seed), mutant.operator, *mutant.key]).encode()).digest()

    kinds: dict[str, list[Mutant]] = {}
    for mutant in sorted(mutants, key=order):
        kinds.setdefault(mutant.operator, []).append(mutant)
    drawn: list[Mutant] = []
    lines: Counter[tuple[str, str]] = Counter()
    for turn in zip_longest(*(kinds[name] for name in sorted(kinds))):
        for mutant in turn:
            if mutant is None or len(drawn) == count:
                continue
            place = (mutant.function, mutant.before)
            lines[place] += 1
            if lines[place] <= PER_LINE:
                drawn.append(mutant)
    return drawn


class _Walker(ast.NodeVisitor):
    """Collects the mutants of a module."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.raw = source.encode()
        self.lines = source.splitlines()
        starts = [0]
        for line in self.raw.splitlines(keepends=True):
            starts.append(starts[-1] + len(line))
        self.starts = starts
        self.scope: list[str] = []
        self.mutants: list[Mutant] = []
        self.indices = 0  # depth of subscripts and of `axis=…`: integers there are indices

    def _span(self, node: ast.AST) -> tuple[int, int]:
        """Return the byte offsets of a node."""
        begin = self.starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
        end = self.starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
        return begin, end

    def _text(self, node: ast.AST) -> str:
        begin, end = self._span(node)
        return self.raw[begin:end].decode()

    def _add(self, operator: str, node: ast.AST, new: str) -> None:
        """Record that a node's text is replaced; what does not compile is no mutant."""
        begin, end = self._span(node)
        source = (self.raw[:begin] + new.encode() + self.raw[end:]).decode()
        first, last = node.lineno - 1, node.end_lineno  # type: ignore[attr-defined]
        grown = len(source.splitlines()) - len(self.lines)
        before = "\n".join(line.strip() for line in self.lines[first:last])
        after = "\n".join(line.strip() for line in source.splitlines()[first : last + grown])
        if before == after:
            return
        try:
            compile(source, "mutant", "exec", dont_inherit=True)
        except SyntaxError:
            return
        name = ".".join(self.scope)
        self.mutants.append(Mutant(name, operator, before, after, first + 1, source))

    # What is passed over

    def visit_Import(self, node: ast.Import) -> None:
        pass

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        pass

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass

    def visit_Raise(self, node: ast.Raise) -> None:
        pass

    def visit_Assert(self, node: ast.Assert) -> None:
        pass

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None and "TypeAlias" not in ast.dump(node.annotation):
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        plain = not self.scope and not any(
            isinstance(part, ast.Call | ast.BinOp | ast.Dict) for part in ast.walk(node.value)
        )
        if not plain:
            self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self.scope.append(node.name)
        for child in node.body:
            self.visit(child)
        self.scope.pop()

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.scope.append(node.name)
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        for child in node.body:
            self.visit(child)
        self.scope.pop()

    # The operators

    def visit_BinOp(self, node: ast.BinOp) -> None:
        left, right = self._text(node.left), self._text(node.right)
        kind = type(node.op)
        text = isinstance(node.left, ast.JoinedStr | ast.Constant) and isinstance(
            getattr(node.left, "value", ""), str
        )
        between = self._between(node.left, node.right)
        if kind in ARITHMETIC and not text:
            name = "sign" if kind in (ast.Add, ast.Sub) else "factor"
            self._infix(name, node, between, ARITHMETIC[kind])
        elif kind is ast.MatMult:
            self._add("transposed", node, f"({right}) @ ({left})")
        elif kind in (ast.BitAnd, ast.BitOr):
            self._infix("and/or", node, between, "|" if kind is ast.BitAnd else "&")
        self.generic_visit(node)

    def _between(self, left: ast.AST, right: ast.AST) -> str:
        """Return the text from the end of one operand to the beginning of the next."""
        return self.raw[self._span(left)[1] : self._span(right)[0]].decode()

    def _infix(self, operator: str, node: ast.BinOp, between: str, new: str) -> None:
        """Replace the operator of a binary operation, and nothing else of its text."""
        old = {ast.Pow: "**", ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/",
               ast.BitAnd: "&", ast.BitOr: "|"}[type(node.op)]  # fmt: skip
        self._replace_between(operator, node, node.left, between, old, new)

    def _replace_between(
        self, operator: str, node: ast.AST, left: ast.AST, between: str, old: str, new: str
    ) -> None:
        begin, cut = self._span(node)[0], self._span(left)[1]
        whole = self._text(node)
        head = self.raw[begin:cut].decode()
        tail = whole[len(head) + len(between) :]
        self._add(operator, node, head + between.replace(old, new, 1) + tail)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub):
            self._add("sign", node, self._text(node.operand))
        elif isinstance(node.op, ast.Invert):
            self._add("guard", node, self._text(node.operand))
        elif isinstance(node.op, ast.Not):
            self._add("guard", node, f"bool({self._text(node.operand)})")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._add("constant", node, str(not value))
        elif isinstance(value, int):
            new = {0: 1, 1: 0 if self.indices else 2, 2: 1}.get(value, value + 1)
            self._add("index" if self.indices else "constant", node, str(new))
        elif isinstance(value, float) and not (value and not 1e-5 <= abs(value) <= 1e5):
            new_value = {0.0: 1.0, 1.0: 2.0, 2.0: 1.0, 0.5: 1.0}.get(value, 2.0 * value)
            self._add("factor", node, repr(new_value))

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        self.indices += 1
        self.visit(node.slice)
        self.indices -= 1

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg == "strict":  # of zip: no test can tell while the lengths agree
            return
        inside = node.arg in ("axis", "axis1", "axis2", "k", "offset")
        self.indices += inside
        self.visit(node.value)
        self.indices -= inside

    def visit_Compare(self, node: ast.Compare) -> None:
        names = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==",
                 ast.NotEq: "!=", ast.Is: "is", ast.IsNot: "is not", ast.In: "in",
                 ast.NotIn: "not in"}  # fmt: skip
        left: ast.AST = node.left
        for op, right in zip(node.ops, node.comparators, strict=True):
            for new in COMPARISONS[type(op)]:
                between = self._between(left, right)
                self._replace_between("comparison", node, left, between, names[type(op)], new)
            left = right
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._replace_between("and/or", node, left, self._between(left, right), old, new)
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        test = self._text(node.test)
        self._add("guard", node.test, f"not ({test})")
        self._add("guard", node.test, "False")
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._add("guard", node.test, f"not ({self._text(node.test)})")
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        for test in node.ifs:
            self._add("guard", test, "True")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        between = self._between(node.target, node.value)
        old = between.strip()
        opposite = {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "&=": "|="}
        for new in ("=", opposite.get(old)):
            if new:
                self._replace_between("assignment", node, node.target, between, old, new)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name in ("cast", "TypeVar", "NewType"):
            return
        if name in SWAPS:
            end = self._text(node.func).removesuffix(name) + SWAPS[name]
            self._add("function", node.func, end)
        if name == "swapaxes" and len(node.args) == 3:
            self._add("transposed", node, self._text(node.args[0]))
        pair = node.args[1:3] if name in ("where", "select") else node.args[:2]
        alike = len(pair) == 2 and type(pair[0]) is type(pair[1])
        if alike and name not in SYMMETRIC | {"swapaxes", "range"}:
            self._exchange(node, *pair)
        self.visit(node.func)
        for arg in node.args:
            self.visit(arg)
        for keyword in node.keywords:
            self.visit(keyword)

    def _exchange(self, call: ast.Call, one: ast.expr, two: ast.expr) -> None:
        """Exchange two arguments of a call."""
        if isinstance(one, ast.Starred):
            return
        (begin, end), (a, b), (c, d) = map(self._span, (call, one, two))
        parts = (self.raw[begin:a], self.raw[c:d], self.raw[b:c], self.raw[a:b], self.raw[d:end])
        self._add("arguments", call, b"".join(parts).decode())

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if node.attr == "T":
            self._add("transposed", node, self._text(node.value))
        elif node.attr in SWAPS and node.attr in ("real", "imag"):
            self._add("function", node, f"{self._text(node.value)}.{SWAPS[node.attr]}")
        self.visit(node.value)
