"""What the doctor finds, also where something is wrong."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hillsphere.cli import doctor, self_test
from hillsphere.cli.doctor import Finding, examine, file_system
from hillsphere.errors import PropagationError
from hillsphere.plugins import Component, Registry, hookimpl


def named(findings: list[Finding], name: str) -> Finding:
    (found,) = [f for f in findings if f.name == name]
    return found


def test_this_installation_is_sound() -> None:
    findings = examine()
    assert [f for f in findings if not f.ok] == []
    assert named(findings, "numpy").detail == np.__version__
    assert {f.name for f in findings if f.group == "self-test"} == set(self_test.CHECKS)


@pytest.mark.parametrize(
    ("mean_anomaly", "eccentricity", "eccentric_anomaly"),
    # Meeus (1998), Astronomical Algorithms, 2nd ed., chapter 30: examples of Kepler's equation.
    [(np.radians(5.0), 0.1, np.radians(5.554589)), (0.2, 0.99, 1.066997365282)],
)
def test_kepler_state_solves_keplers_equation(
    mean_anomaly: float, eccentricity: float, eccentric_anomaly: float
) -> None:
    x = self_test.kepler_state(mean_anomaly, eccentricity)[0]
    assert x == pytest.approx(np.cos(eccentric_anomaly) - eccentricity, abs=2e-9)


def test_missing_requirements(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = [
        "absent-library>=1",
        "absent-extra>=2 ; extra == 'far'",
        "numpy",
        "numpy ; extra=='x'",
    ]
    monkeypatch.setattr(metadata, "requires", lambda name: wanted)
    findings = list(doctor._versions())
    assert named(findings, "absent-library").state == "fail"
    extra = named(findings, "absent-extra")
    assert (extra.state, extra.ok, extra.group) == ("absent", True, "extra far")
    assert "hillsphere[far]" in extra.detail
    assert named(findings, "numpy").state == "ok"


def test_broken_and_disabled_plugins() -> None:
    class Plugin:
        @hookimpl
        def hillsphere_components(self) -> list[Component]:
            """Return one whose class is nowhere, and a command."""
            return [
                Component(
                    "gravity", "gone", "no_module:Gone", "hillsphere.model.bodies:MoonSpec", "gone"
                ),
                Component("command", "here", "hillsphere.cli.commands:app", "", "here"),
            ]

    registry = Registry(disabled=("asleep",))
    registry.add_plugin("mixed", Plugin())
    registry.add_plugin("empty", SimpleNamespace())
    findings = list(doctor._plugins(registry))
    assert [(f.name, f.state) for f in findings] == [
        ("mixed", "ok"),
        ("empty", "fail"),
        ("asleep", "absent"),
        ("gravity gone", "fail"),
    ]
    assert "No module named 'no_module'" in findings[-1].detail


def test_a_cache_that_cannot_be_written(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    (finding,) = doctor._compile_cache(blocked / "compiled")
    assert finding.state == "fail"
    assert "HILLSPHERE_CACHE" in finding.detail


def test_a_cache_on_a_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "file_system", lambda path, mounts: "nfs4")
    first, second = doctor._compile_cache(tmp_path / "compiled")
    assert (first.state, second.state) == ("ok", "fail")
    assert "network file system" in second.detail


def test_file_system_is_that_of_the_nearest_mount(tmp_path: Path) -> None:
    home = tmp_path / "my home"
    (home / "cache").mkdir(parents=True)
    mounts = tmp_path / "mounts"
    escaped = str(home).replace(" ", "\\040")
    mounts.write_text(
        f"/dev/a / ext4 rw 0 0\nserver:/home {escaped} nfs4 rw 0 0\n"
        f"none {escaped}/cachet tmpfs rw 0 0\n",
        "utf-8",
    )
    assert file_system(home / "cache", mounts) == "nfs4"
    assert file_system(tmp_path, mounts) == "ext4"
    assert file_system(tmp_path, tmp_path / "no-such-table") == ""


def test_a_check_that_fails_is_a_finding() -> None:
    def inaccurate() -> str:
        raise PropagationError("error 1.0e-03\nagainst the closed form")

    finding = doctor._time_check("orbit", inaccurate)
    assert finding.state == "fail"
    assert finding.detail == "PropagationError: error 1.0e-03 against the closed form"


@pytest.mark.parametrize("error", [2e-11, float("nan")])
def test_the_self_test_can_fail(error: float) -> None:
    with pytest.raises(PropagationError, match="against the closed form"):
        self_test._accurate(error, self_test.TOLERANCE)
