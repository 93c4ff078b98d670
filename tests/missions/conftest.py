"""An independent solution of the planar QSO problem, and the packaged mission run once.

Nothing here uses Hillsphere's numerics: the equations of motion are written out again in NumPy,
gravity is Carlson's integral from SciPy with the confocal coordinate from a monotone Newton
iteration, and the integrator is SciPy's adaptive DOP853.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.special import elliprd, elliprf

Array = NDArray[np.float64]

TIDE = np.diag([3.0, 0.0, -1.0])
CORIOLIS = np.array([[0.0, 2.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
MIRROR = np.diag([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])

# Retrograde satellite orbits of the point-mass Hill problem (family f of Hénon 1969), computed with
# this file: only first guesses, good to four digits. x0, vy0 + 2 x0, period, normalised.
FAMILY_F = np.array(
    [
        [0.5, -1.02352, 1.79049],
        [0.65, -0.77650, 2.48092],
        [0.8, -0.59908, 3.15444],
        [0.95, -0.46826, 3.77103],
        [1.1, -0.37089, 4.30069],
        [1.3, -0.27799, 4.85414],
        [1.5, -0.21395, 5.25010],
        [1.8, -0.15126, 5.63051],
        [2.1, -0.11205, 5.85282],
        [2.5, -0.07947, 6.01977],
        [3, -0.05535, 6.12771],
        [3.5, -0.04072, 6.18429],
        [4.2, -0.02831, 6.22554],
        [5, -0.01998, 6.24888],
        [6, -0.01388, 6.26328],
        [7, -0.01020, 6.27064],
    ]
)


@dataclass(frozen=True)
class Orbits:
    """Planar QSOs, one per lane, normalised except where a name carries a unit."""

    x0_km: Array
    vy0: Array
    period: Array
    jacobi: Array
    y_max_km: Array
    vx_at_y_max: Array
    monodromy: Array

    @property
    def b_planar(self) -> Array:
        """Stability index b = λ + 1/λ in the plane: its trace less the trivial pair 1, 1."""
        m = self.monodromy
        planar: Array = m[0, 0] + m[1, 1] + m[3, 3] + m[4, 4] - 2.0
        return planar

    @property
    def b_vertical(self) -> Array:
        """Stability index of the vertical block."""
        vertical: Array = self.monodromy[2, 2] + self.monodromy[5, 5]
        return vertical


class HillReference:
    """Circular Hill problem about a homogeneous ellipsoid, or a point mass (``axes_km=None``)."""

    def __init__(
        self,
        axes_km: Sequence[float] | None,
        gm_km3_s2: float,
        primary_gm_km3_s2: float = 42828.37,
        semi_major_axis_km: float = 9377.0,
    ) -> None:
        self.mean_motion = float(np.sqrt(primary_gm_km3_s2 / semi_major_axis_km**3))
        self.length_km = float(np.cbrt(gm_km3_s2 / self.mean_motion**2))
        self.speed_m_s = 1e3 * self.length_km * self.mean_motion
        self.squares = (
            np.zeros((3, 1))
            if axes_km is None
            else (np.asarray(axes_km, dtype=float)[:, None] / self.length_km) ** 2
        )

    def confocal(self, r: Array) -> Array:
        """Semi-axes squared of the confocal ellipsoid through r (the body's own inside), (3, N)."""
        square = r * r
        # Left of the root the secular function is positive, falling and convex: Newton from here
        # climbs to the root without ever passing it.
        root = np.maximum(0.0, square.sum(axis=0) - self.squares.max())
        for _ in range(80):
            axes = self.squares + root
            value = (square / axes).sum(axis=0) - 1.0
            step = value / (square / axes**2).sum(axis=0)
            root = np.maximum(0.0, root + step)
            if np.all(np.abs(step) <= 1e-16 * (1.0 + root)):
                break
        confocal: Array = self.squares + root
        return confocal

    def _carlson(self, axes: Array) -> Array:
        u, v, w = axes
        return np.stack([elliprd(v, w, u), elliprd(w, u, v), elliprd(u, v, w)])

    def jacobi(self, x: Array) -> Array:
        """C = ½(3x² − z²) + U − ½v² of states (6, N)."""
        r, v = x[:3], x[3:]
        axes = self.confocal(r)
        potential = 1.5 * elliprf(*axes) - 0.5 * (r * r * self._carlson(axes)).sum(axis=0)
        value: Array = 0.5 * (3 * r[0] ** 2 - r[2] ** 2) + potential - 0.5 * (v * v).sum(axis=0)
        return value

    def derivative(self, x: Array) -> Array:
        """Time derivative of states (6, N)."""
        r, v = x[:3], x[3:]
        gravity = -r * self._carlson(self.confocal(r))
        return np.concatenate([v, gravity + TIDE @ r + CORIOLIS @ v])

    def _variational(self, x: Array) -> tuple[Array, Array]:
        r, v = x[:3], x[3:]
        axes = self.confocal(r)
        carlson = self._carlson(axes)
        q = r / axes
        outside = (r * r / np.maximum(self.squares, 1e-300)).sum(axis=0) > 1.0
        slope = 3.0 * outside / (np.sqrt(axes.prod(axis=0)) * (q * q).sum(axis=0))
        jacobian = np.zeros((6, 6, x.shape[1]))
        jacobian[:3, 3:] = np.eye(3)[:, :, None]
        jacobian[3:, :3] = TIDE[:, :, None] + slope * q[:, None] * q[None, :]
        jacobian[[3, 4, 5], [0, 1, 2]] -= carlson
        jacobian[3:, 3:] = CORIOLIS[:, :, None]
        return np.concatenate([v, -r * carlson + TIDE @ r + CORIOLIS @ v]), jacobian

    def flow(self, x: Array, duration: ArrayLike, rtol: float = 2.3e-14) -> Array:
        """States (6, N) after each lane's own duration."""
        n = x.shape[1]
        time = np.broadcast_to(np.asarray(duration, dtype=float), (n,))

        def slope(_: float, y: Array) -> Array:
            return (time * self.derivative(y.reshape(6, n))).ravel()

        done = solve_ivp(slope, (0.0, 1.0), x.ravel(), "DOP853", rtol=rtol, atol=rtol / 10)
        assert done.success, done.message
        final: Array = done.y[:, -1].reshape(6, n)
        return final

    def variational_flow(
        self, x: Array, duration: ArrayLike, rtol: float = 2.3e-14
    ) -> tuple[Array, Array]:
        """States (6, N) and transition matrices (6, 6, N) after each lane's own duration."""
        n = x.shape[1]
        time = np.broadcast_to(np.asarray(duration, dtype=float), (n,))

        def slope(_: float, y: Array) -> Array:
            dx, jacobian = self._variational(y[: 6 * n].reshape(6, n))
            dphi = np.einsum("ijn,jkn->ikn", jacobian, y[6 * n :].reshape(6, 6, n))
            return np.concatenate([(time * dx).ravel(), (time * dphi).ravel()])

        start = np.concatenate([x.ravel(), np.repeat(np.eye(6).ravel(), n)])
        done = solve_ivp(slope, (0.0, 1.0), start, "DOP853", rtol=rtol, atol=rtol / 10)
        assert done.success, done.message
        end = done.y[:, -1]
        return end[: 6 * n].reshape(6, n), end[6 * n :].reshape(6, 6, n)

    def start(self, x0_km: Array, vy0: Array) -> Array:
        """States on the x axis, moving along y, (6, N)."""
        x = np.zeros((6, len(x0_km)))
        x[0] = x0_km / self.length_km
        x[4] = vy0
        return x

    def orbits(self, x0_km: ArrayLike, *, rtol: float = 2.3e-14, accuracy: float = 1e-13) -> Orbits:
        """Planar QSOs of these amplitudes, by Newton on the crossing at half a period."""
        amplitudes = np.atleast_1d(np.asarray(x0_km, dtype=float))
        guess = CubicSpline(FAMILY_F[:, 0], FAMILY_F[:, 1:])(amplitudes / self.length_km)
        vy0, period = guess[:, 0] - 2.0 * amplitudes / self.length_km, guess[:, 1]
        for _ in range(15):
            end, phi = self.variational_flow(self.start(amplitudes, vy0), period / 2, rtol)
            slope = self.derivative(end)
            matrix = np.array([[phi[1, 4], slope[1]], [phi[3, 4], slope[3]]]).transpose(2, 0, 1)
            step = np.linalg.solve(matrix, -end[[1, 3]].T[:, :, None])[:, :, 0]
            vy0, period = vy0 + step[:, 0], period + 2.0 * step[:, 1]
            if np.abs(step).max() < accuracy:
                break
        else:
            raise AssertionError(f"the reference did not converge: last step {step}")
        half = phi.transpose(2, 0, 1)
        monodromy = (MIRROR @ np.linalg.inv(half) @ MIRROR @ half).transpose(1, 2, 0)
        x0 = self.start(amplitudes, vy0)
        quarter = period / 4
        for _ in range(2):
            top = self.flow(x0, quarter, rtol)
            quarter = quarter - top[4] / self.derivative(top)[4]
        top = self.flow(x0, quarter, rtol)
        return Orbits(
            x0_km=amplitudes,
            vy0=vy0,
            period=period,
            jacobi=self.jacobi(x0),
            y_max_km=np.abs(top[1]) * self.length_km,
            vx_at_y_max=np.abs(top[3]),
            monodromy=monodromy,
        )


@pytest.fixture(scope="session")
def hill_reference() -> type[HillReference]:
    """Return the independent Hill problem, to be made with axes and gravitational parameter."""
    return HillReference


@dataclass(frozen=True)
class Run:
    """A finished run directory."""

    directory: Path

    @property
    def summary(self) -> dict[str, Any]:
        """The whole of summary.json."""
        loaded: dict[str, Any] = json.loads((self.directory / "summary.json").read_text("utf-8"))
        return loaded

    def rows(self, table: str) -> list[dict[str, Any]]:
        """Rows of one of its tables."""
        rows: list[dict[str, Any]] = self.summary["tables"][table]["rows"]
        return rows


def run_command(directory: Path, *arguments: str) -> Run:
    """Run ``hillsphere run`` as a user does; fail with what it printed if a stage fails."""
    done = subprocess.run(
        [sys.executable, "-m", "hillsphere", "run", *arguments, "--out", str(directory)],
        capture_output=True,
        text=True,
        timeout=1200,  # s; five times the longest mission alone, for a machine that is busy
        check=False,
    )
    assert done.returncode in (0, 4), f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return Run(directory)


@pytest.fixture(scope="session")
def mission_run() -> Callable[..., Run]:
    """Return what runs a mission from the command line: (directory, arguments…) → run."""
    return run_command


@pytest.fixture(scope="session")
def phobos_qso(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Run the packaged mission once, from the command line, without cached stages."""
    out = tmp_path_factory.mktemp("missions") / "phobos-qso"
    return run_command(out, "phobos-qso", "--no-cache")


@pytest.fixture(scope="session")
def other_orbits(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Run the packaged mission again for an orbit and for resonances that it does not ask for."""
    out = tmp_path_factory.mktemp("missions") / "other-orbits"
    vertical = json.dumps([f"1:{n}" for n in (*range(8, 14), 15, 16, 20, 21, *range(23, 27))])
    return run_command(
        out,
        "phobos-qso",
        "--no-cache",
        "--set",
        "stage.family.x_amplitudes_km=[40.0]",
        "--set",
        f"stage.bifurcations.vertical={vertical}",
        "--set",
        'stage.bifurcations.planar=["3:10"]',
    )
