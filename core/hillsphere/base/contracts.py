"""Contracts: protocols whose check accepts delegating wrappers.

From Python 3.12 on ``isinstance(x, SomeProtocol)`` looks members up with
`inspect.getattr_static`, which does not call ``__getattr__``. A wrapper that delegates to the
object inside it, as a plugin author writes to record calls or to add noise, then satisfies no
protocol, although every call would work. A protocol that derives from `Contract` is checked with
`hasattr` on every supported version of Python.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

__all__ = ["Contract"]

if TYPE_CHECKING:
    from abc import ABCMeta as _ProtocolMeta
else:
    _ProtocolMeta = type(Protocol)


if sys.version_info >= (3, 14):
    from annotationlib import Format, get_annotations

    def _annotated(contract: type) -> Iterable[str]:
        # As text: what an annotation names need not be there at run time.
        return get_annotations(contract, format=Format.STRING)
else:
    from inspect import get_annotations

    def _annotated(contract: type) -> Iterable[str]:
        return get_annotations(contract)


class _AnsweredContract(_ProtocolMeta):
    """Metaclass of contracts: an instance has every member of the protocol, own or delegated."""

    def __instancecheck__(self, instance: Any) -> bool:
        """Return whether an object has the members of a protocol, its own or delegated ones."""
        if not self.__dict__.get("_is_protocol", False):
            return super().__instancecheck__(instance)  # a class that implements a contract
        for name in _members(self):
            try:
                answer = getattr(instance, name)
            except AttributeError:
                return False
            # A class says that it has no such method by setting it to None, as for ``__hash__``.
            if answer is None and callable(getattr(self, name, None)):
                return False
        return True


@cache
def _members(contract: type) -> frozenset[str]:
    """Return the names of the members of a protocol and of the protocols that it extends."""
    bases = [base for base in contract.__mro__ if base.__dict__.get("_is_protocol", False)]
    declared = {name for base in bases for name in (*base.__dict__, *_annotated(base))}
    # What Python itself puts into a class is private: _is_protocol, __init__, __annotations__ …
    return frozenset(name for name in declared if not name.startswith("_"))


@runtime_checkable
class Contract(Protocol, metaclass=_AnsweredContract):
    """Base of protocols that plugins may implement: ``class Sensor(Contract, Protocol)``.

    Members are public attributes, properties and methods. The check evaluates properties; an error
    other than AttributeError is passed on.
    """
