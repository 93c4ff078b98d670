"""Assembly of a mission's components from their Specs, with references injected."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hillsphere.base.errors import HillsphereError, InputError, PluginError
from hillsphere.base.problems import Key, MissionError, Problem, did_you_mean
from hillsphere.interfaces.surface import Described
from hillsphere.mission.links import Node, topological
from hillsphere.mission.load import Mission, load_mission
from hillsphere.plugins.registry import OUTCOME_KINDS
from hillsphere.spec.base import Spec

__all__ = ["Assembly", "build", "build_of", "problem_at", "problem_of"]

_KEYS = re.compile(r"([a-z]\w*(?:\.\w+)*): ")
"""Pattern of a dotted key at the beginning of a component's message."""


@dataclass
class Assembly:
    """The components of a mission, each made once, at its first use.

    Parameters
    ----------
    mission : Mission
        The mission.
    """

    mission: Mission
    _made: dict[Node, Any] = field(default_factory=dict, repr=False)

    def get(self, kind: str, name: str) -> Any:
        """Return the component of a table, after those that it refers to have been made.

        Parameters
        ----------
        kind, name : str
            The table ``[kind.name]``.

        Returns
        -------
        object
            The component. A stage's references to other stages (its needs) stay unbound, since the
            pipeline passes their products.

        Raises
        ------
        MissionError
            If the component refuses its Spec or cannot read its data; the message begins with the
            table's file, line and name, or with those of the key that names the data.
        PluginError
            If its class cannot be imported, or raises an error other than `HillsphereError`.
        """
        if kind in ("stage", *OUTCOME_KINDS):  # they refer to stages by name
            return self._one(kind, name)
        if (kind, name) not in self._made:
            # In order of dependence, so that a long chain of references needs no recursion.
            for other_kind, other in topological([(kind, name)], self.mission.specs):
                if other_kind != "stage":
                    self._one(other_kind, other)
        return self._made[kind, name]

    def descriptions(self) -> dict[str, tuple[str, ...]]:
        """Return what the shapes and gravity models made so far tell of themselves, by table."""
        return {
            f"{kind}.{name}": component.describe()
            for (kind, name), component in self._made.items()
            if kind in ("shape", "gravity") and isinstance(component, Described)
        }

    def bound(self, kind: str, name: str) -> Spec:
        """Return the Spec of a table with its references bound to their components."""
        spec = self.mission.specs[kind][name]
        return spec.bound(lambda other, ref: None if other == "stage" else self.get(other, ref))

    def _one(self, kind: str, name: str) -> Any:
        if (kind, name) not in self._made:
            target = self.mission.components[kind][name].load_target()
            spec = self.bound(kind, name)
            try:
                self._made[kind, name] = target(spec)
            except (MissionError, PluginError):
                raise
            except (HillsphereError, OSError) as error:
                raise MissionError([problem_of(self.mission, (kind, name), error)]) from error
            except ArithmeticError as error:
                # Every number is within its bounds, but a product or a quotient of them is not.
                text = (
                    f"it cannot be computed from these numbers ({type(error).__name__}: {error}); "
                    "one of them, or of the tables that it refers to, is far too large or too small"
                )
                raise MissionError([problem_at(self.mission, (kind, name), text)]) from error
            except Exception as error:  # the border of what a plugin's class may raise
                record = self.mission.components[kind][name]
                text = " ".join(f"{type(error).__name__}: {error}".split())
                raise PluginError(
                    f"{self.mission.places[kind, name]}: {kind}.{name}: plugin "
                    f"{record.plugin!r} cannot make it: {text}"
                ) from error
        return self._made[kind, name]


def problem_at(mission: Mission, key: Key, message: str) -> Problem:
    """Return a problem at a table of a mission, or at one of its keys that has a place.

    Parameters
    ----------
    mission : Mission
        The mission.
    key : tuple
        Kind and name of the table, then the key in it.
    message : str
        The fault.
    """
    place = mission.places.get(key) or mission.places[key[:2]]
    source, colon, line = place.rpartition(":")
    if colon and line.isdigit():
        return Problem(source, int(line), key, message)
    return Problem(place, None, key, message)


def problem_of(mission: Mission, node: Node, error: HillsphereError | OSError) -> Problem:
    """Return the error of a component as a problem, located at the key that it concerns.

    Parameters
    ----------
    mission : Mission
        The mission.
    node : tuple of str
        Kind and name of the table.
    error : HillsphereError or OSError
        Its message may begin with a key of the table (``structured.parts: …``) or with the name of
        an input file.
    """
    kind, name = node
    message = str(error)
    if where := _key_of_file(error, mission.specs[kind][name]):
        return problem_at(mission, (kind, name, *where), message)
    if match := _KEYS.match(message):
        key = _as_written(mission, node, match[1].split("."))
        if key in mission.places:
            return problem_at(mission, key, message[match.end() :])
        if key[:3] in mission.places:
            return problem_at(mission, key[:3], message)
    return problem_at(mission, node, message)


def _as_written(mission: Mission, node: Node, path: Sequence[str]) -> Key:
    """Return a key as the mission writes it: ``duration_min`` for ``duration_s``."""
    part: Any = mission.specs[node[0]][node[1]]
    written: Key = node
    for step in path:
        spellings = type(part).units_by_field().get(step, ()) if isinstance(part, Spec) else ()
        given = (other for other in spellings if (*written, other) in mission.places)
        written = (*written, next(given, step))
        part = getattr(part, step, None)
    return written


def _key_of_file(error: HillsphereError | OSError, spec: Spec) -> Key:
    """Return the key of the input file that an error concerns; empty if it concerns none.

    An `OSError` carries the file; a reader's message begins with its path or name, as in
    ``orbits.csv:3: …``.
    """
    for where, path in spec.data_paths():
        heads = (f"{path}:", f"{path} ", f"{os.path.basename(path)}:")
        carried = isinstance(error, OSError) and error.filename == path
        if carried or str(error).startswith(heads):
            return where
    return ()


def build(
    mission: Mission | str | os.PathLike[str], kind: str, name: str, *, allow_path: bool = False
) -> Any:
    """Make one component of a mission, and those that it refers to.

    A script that computes with the results of a mission takes the mission's own plant, since a
    constant that the mission sets and a plant made by hand lacks moves every orbit.

    Parameters
    ----------
    mission : Mission, str or path
        A mission, the name of a packaged one, or the path of a mission file.
    kind, name : str
        The table ``[kind.name]``.
    allow_path : bool
        As for `hillsphere.load_mission`; without effect on a `Mission`.

    Returns
    -------
    object
        The component. Those of one run are `RunResult.build`.

    Raises
    ------
    InputError
        If the mission has no such table, or the component cannot be made; see `Assembly.get`.

    Examples
    --------
    >>> from hillsphere import build
    >>> build("phobos-qso", "gravity", "ellipsoid").frame
    'body'
    """
    if not isinstance(mission, Mission):
        mission = load_mission(mission, allow_path=allow_path)
    return build_of(Assembly(mission), kind, name)


def build_of(assembly: Assembly, kind: str, name: str) -> Any:
    """Return the component of a table that a script names, which may be misspelt.

    Parameters
    ----------
    assembly : Assembly
        The components of a mission.
    kind, name : str
        The table ``[kind.name]``.

    Raises
    ------
    InputError
        If the mission has no such table; the message gives the nearest one.
    """
    specs = assembly.mission.specs
    if name not in specs.get(kind, {}):
        kinds = [one for one, tables in specs.items() if tables]
        tables = specs.get(kind, {})
        hint = (
            did_you_mean(name, tables, otherwise="it has")
            if tables
            else did_you_mean(kind, kinds, otherwise="it has tables of")
        )
        raise InputError(f"mission {assembly.mission.name!r} has no table [{kind}.{name}]{hint}")
    return assembly.get(kind, name)
