"""Pickling of work for other processes, which refuses objects that these cannot import."""

from __future__ import annotations

import pickle
from io import BytesIO
from types import FunctionType
from typing import Any

from hillsphere.base.errors import StageError
from hillsphere.interfaces.tasks import Work

__all__ = ["Unsendable", "pickle_work"]


class Unsendable(StageError):  # noqa: N818 - a state of the work, not a fault
    """Work that no other process can be given."""


def pickle_work(work: Work) -> bytes:
    """Return work as bytes; `Unsendable` if it cannot be sent, or not be found again elsewhere."""
    stream = BytesIO()
    try:
        _Pickler(stream, protocol=pickle.HIGHEST_PROTOCOL).dump(work)
    except Exception as error:  # what pickle raises depends on what it met
        raise Unsendable(
            f"the work cannot be sent to other processes ({error}); define its classes at the top "
            "level of modules that can be imported, or compute in this process alone"
        ) from error
    return stream.getvalue()


class _Pickler(pickle.Pickler):
    """Pickler that refuses classes and functions of the program that was started."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, type | FunctionType) and obj.__module__ == "__main__":
            raise pickle.PicklingError(
                f"{obj.__qualname__} is defined in the program that was started, not in a module"
            )
        return NotImplemented
