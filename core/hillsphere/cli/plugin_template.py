"""A new plugin package that installs, passes its tests and runs: `hillsphere new plugin`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from keyword import iskeyword
from string import Template

from hillsphere import __version__
from hillsphere.base.errors import InputError, UnknownComponentError
from hillsphere.base.problems import did_you_mean
from hillsphere.plugins.registry import KINDS, Registry, kind_words

__all__ = ["TEMPLATES", "plugin_files"]

TEMPLATES: Mapping[str, str] = {
    "gravity": "a point mass off the origin",
    "shape": "a spheroid",
    "plant": "motion near a satellite on a circular orbit",
    "orbit_family": "direct orbits about a moon, from the Kepler circles close to it",
    "guidance": "positions as polynomials of fourth degree in time",
    "compensator": "proportional and derivative action on each axis",
    "estimator": "extended Kalman filter with derivatives by differences",
    "sensor": "distance from the centre, with noise and a bias",
    "tracker": "corrections of node and mean anomaly in proportion",
    "stage": "acceleration of gravity along the x axis",
    "format": "table of states that says to what they refer",
}
"""Kinds with a template, and the summary of its component."""
_NAME = re.compile(r"[a-z][a-z0-9]*(?:[-_][a-z0-9]+)*")
_LONGEST = 60
"""Longest name: the types of components in a mission have at most 64 characters."""
_PREFIX = "hillsphere_"


def plugin_files(name: str, kind: str, registry: Registry) -> dict[str, str]:
    """Return the files of a plugin package with one component.

    Parameters
    ----------
    name : str
        Name of the distribution, such as ``"limb-ranger"`` or ``"hillsphere-limb-ranger"``; both
        offer the type ``limb_ranger``.
    kind : str
        Kind of the component, of `TEMPLATES`.
    registry : Registry
        The installed components.

    Returns
    -------
    dict of str to str
        Path within the package's folder → text.

    Raises
    ------
    InputError
        If the name is not usable, belongs to an importable package or to an installed component,
        or the kind has no template.
    """
    if kind not in TEMPLATES:
        hint = (
            f"; kinds with a template: {', '.join(TEMPLATES)}"
            if kind in KINDS
            else did_you_mean(kind, TEMPLATES, otherwise="kinds with a template")
        )
        raise InputError(f"there is no template of kind {kind[:60]!r}{hint}")
    package = name.replace("-", "_")
    type_ = package.removeprefix(_PREFIX)
    _check_names(name, package, type_)
    _check_free(package, kind, type_, registry)
    words = type_.replace("_", " ")
    values = {
        "name": name,
        "package": package,
        "type": type_,
        "module": type_,
        "kind": kind,
        "kind_words": kind_words(kind),
        "class_name": "".join(part.capitalize() for part in f"{type_}_{kind}".split("_")),
        "words": words[0].upper() + words[1:],
        "summary": TEMPLATES[kind],
        "version": __version__,
    }
    sources = {
        "pyproject.toml": "pyproject.toml",
        "README.md": "README.md",
        f"src/{package}/__init__.py": "init.py",
        f"src/{package}/specs.py": f"{kind}_specs.py",
        f"src/{package}/{type_}.py": f"{kind}.py",
        f"tests/test_{package}.py": f"{kind}_test.py",
    }
    folder = files("hillsphere.cli") / "templates"
    made = {
        path: Template((folder / f"{source}.in").read_text("utf-8")).substitute(values)
        for path, source in sources.items()
    }
    return {**made, f"src/{package}/py.typed": ""}


def _check_names(name: str, package: str, type_: str) -> None:
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        raise InputError(
            f"{name[:_LONGEST]!r} cannot name a plugin: use small letters, digits, '-' and '_', "
            f"beginning with a letter, at most {_LONGEST} characters"
        )
    if iskeyword(package) or iskeyword(type_) or not type_.isidentifier() or type_ == "specs":
        raise InputError(f"{name!r} cannot name a plugin: {type_!r} cannot be one of its modules")


def _check_free(package: str, kind: str, type_: str, registry: Registry) -> None:
    if find_spec(package) is not None:
        raise InputError(
            f"a package {package!r} is installed, or part of Python; give the plugin another name"
        )
    try:
        record = registry.get(kind, type_)
    except UnknownComponentError:
        return
    raise InputError(
        f"plugin {record.plugin!r} offers a {kind_words(kind)} {type_!r}; give the new one another "
        "name"
    )
