"""Station memory: the angle biases and the time offset of stations, stored between passes.

A tracker that estimates the biases of its station begins a pass with the estimate of the pass
before. Between passes the biases are modelled as random walks: the covariance grows in proportion
to time. The memory is a small JSON file that a person can read and correct::

    {
      "format": "hillsphere station memory",
      "version": 1,
      "stations": {
        "Alcântara": {
          "utc": "2027-06-01T12:45:00.000000",
          "passes": 3,
          "azimuth_bias_deg": {"value": 0.05, "sigma": 0.01},
          "elevation_bias_deg": {"value": -0.02, "sigma": 0.01},
          "time_offset_s": {"value": 0.1, "sigma": 0.02},
          "correlation": {"azimuth_elevation": 0.0, "azimuth_time": 0.1, "elevation_time": 0.0}
        }
      }
    }
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import numpy as np

from hillsphere.base.atomic import write_text
from hillsphere.base.constants import DAY_S
from hillsphere.base.json_files import parse_json
from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch

__all__ = [
    "Calibration", "RandomWalk", "age_calibration", "combine_calibrations", "read_memory",
    "remember", "write_memory",
]  # fmt: skip

_FORMAT = "hillsphere station memory"
_VERSION = 1
"""Version of the file's format; a change that older programs would misread must raise it."""
_LARGEST_FILE = 16 << 20
"""Bytes of a memory at most: some ten thousand stations."""
_DEGREE = np.pi / 180.0
_TO_SI = np.array([_DEGREE, _DEGREE, 1.0])
_NAMES = ("azimuth_bias_deg", "elevation_bias_deg", "time_offset_s")
_PAIRS = {"azimuth_elevation": (0, 1), "azimuth_time": (0, 2), "elevation_time": (1, 2)}


@dataclass(frozen=True, eq=False)
class Calibration:
    """Estimate of a station's systematic errors, with its covariance.

    Parameters
    ----------
    epoch : Epoch
        Time of the estimate.
    mean : ndarray, shape (3,)
        Azimuth bias, rad, elevation bias, rad, and time offset, s: measured minus true.
    covariance : ndarray, shape (3, 3)
        Covariance of the estimate, in the same units.
    passes : int
        Number of passes that entered the estimate.

    Raises
    ------
    InputError
        If a value is not finite, or the covariance is not symmetric and positive semidefinite.
    """

    epoch: Epoch
    mean: Array
    covariance: Array
    passes: int

    def __post_init__(self) -> None:
        mean, covariance = np.asarray(self.mean), np.asarray(self.covariance)
        if mean.shape != (3,) or covariance.shape != (3, 3):
            raise InputError(
                "a calibration needs a mean (3,) and a covariance (3, 3), got"
                f" {mean.shape} and {covariance.shape}"
            )
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise InputError("a calibration must be finite, got nan or inf")
        if self.passes < 0:
            raise InputError(f"a calibration cannot come from {self.passes} passes")
        # judged as a correlation: angles and seconds differ by orders of magnitude
        size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        scale = np.where(size > 0.0, size, 1.0)
        correlation = covariance / np.outer(scale, scale)
        if (
            np.any(np.diag(covariance) < 0.0)
            or not np.allclose(correlation, correlation.T, rtol=0.0, atol=1e-9)
            or np.linalg.eigvalsh(correlation)[0] < -1e-9
        ):
            raise InputError(
                "a calibration's covariance must be symmetric and positive, got"
                f" {covariance.tolist()}"
            )


@dataclass(frozen=True)
class RandomWalk:
    """Random walks of a station's systematic errors between passes.

    Parameters
    ----------
    bias_rad_per_sqrt_day : float
        Standard deviation of the change of each angle bias in one day.
    time_s_per_sqrt_day : float
        Standard deviation of the change of the time offset in one day.

    Raises
    ------
    InputError
        If a standard deviation is negative or not finite.
    """

    bias_rad_per_sqrt_day: float
    time_s_per_sqrt_day: float

    def __post_init__(self) -> None:
        for number in (self.bias_rad_per_sqrt_day, self.time_s_per_sqrt_day):
            if not (isfinite(number) and number >= 0.0):
                raise InputError(f"a random walk needs a size ≥ 0 and finite, got {number}")


def age_calibration(calibration: Calibration, epoch: Epoch, walk: RandomWalk) -> Calibration:
    """Propagate a calibration to another time: the covariance grows by the random walk.

    Parameters
    ----------
    calibration : Calibration
        Estimate at its own epoch.
    epoch : Epoch
        Time of the result. The covariance grows with the interval in both directions of time.
    walk : RandomWalk
        Growth of the covariance.

    Returns
    -------
    Calibration
        The same mean at `epoch`, with a larger covariance.
    """
    days = abs(epoch.seconds_since(calibration.epoch)) / DAY_S
    # variances of a random walk grow linearly with time
    sigma = np.array([walk.bias_rad_per_sqrt_day] * 2 + [walk.time_s_per_sqrt_day])
    return replace(
        calibration, epoch=epoch, covariance=calibration.covariance + np.diag(sigma**2 * days)
    )


def combine_calibrations(prior: Calibration, estimate: Calibration) -> Calibration:
    """Combine two independent estimates, as a Kalman update with identity measurement matrix.

    An estimate of a tracker that began with `prior` is not independent of it: it already contains
    the prior and must be stored without being combined.

    Parameters
    ----------
    prior : Calibration
        Earlier estimate, propagated to the epoch of the other (`age_calibration`).
    estimate : Calibration
        Newer estimate.

    Returns
    -------
    Calibration
        Combined estimate at the epoch of `estimate`, with the passes of both. A quantity with zero
        variance in both estimates keeps the prior's value.
    """
    # scaled to deviations: angles and seconds differ by orders of magnitude
    size = np.sqrt(np.diag(prior.covariance) + np.diag(estimate.covariance))
    scale = np.where(size > 0.0, size, 1.0)
    outer = np.outer(scale, scale)
    p, r = prior.covariance / outer, estimate.covariance / outer
    # K = P (P + R)⁻¹; the pseudoinverse serves quantities that both estimates know exactly
    gain = p @ np.linalg.pinv(p + r, hermitian=True)
    mean = prior.mean + scale * (gain @ ((estimate.mean - prior.mean) / scale))
    # Joseph's form of the covariance stays symmetric and positive semidefinite.
    rest = np.eye(3) - gain
    covariance = (rest @ p @ rest.T + gain @ r @ gain.T) * outer
    return Calibration(
        estimate.epoch, mean, 0.5 * (covariance + covariance.T), prior.passes + estimate.passes
    )


def read_memory(path: Path) -> Mapping[str, Calibration]:
    """Read a station memory.

    Parameters
    ----------
    path : Path
        The file; a file that does not exist is an empty memory.

    Returns
    -------
    mapping of str to Calibration
        Calibrations by the names of the stations.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, or was written by a newer version.
    """
    try:
        text = read_text(path, max_bytes=_LARGEST_FILE)
    except FileNotFoundError:
        return MappingProxyType({})
    except (OSError, UnicodeDecodeError) as error:
        _refuse_damaged(path, str(error))
    try:
        data = parse_json(text)
    except ValueError as error:
        _refuse_damaged(path, str(error))
    if not isinstance(data, dict) or data.get("format") != _FORMAT:
        _refuse_damaged(path, f'it does not say "format": "{_FORMAT}"')
    if data.get("version") != _VERSION:
        raise InputError(
            f"the station memory {path} has the version {data.get('version')!r}; this program"
            f" reads version {_VERSION}: use the program that wrote it, or another file"
        )
    stations = data.get("stations")
    if not isinstance(stations, dict):
        _refuse_damaged(path, "it has no stations")
    memory = {}
    for name, entry in stations.items():
        try:
            memory[name] = _parse_entry(entry)
        except (InputError, TypeError, KeyError, OverflowError) as error:
            what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            _refuse_damaged(path, f"station {name!r}: {what}")
    return MappingProxyType(memory)


def write_memory(path: Path, memory: Mapping[str, Calibration]) -> None:
    """Write a station memory; if writing fails the old file remains unchanged.

    Parameters
    ----------
    path : Path
        The file, in an existing directory.
    memory : mapping of str to Calibration
        Calibrations by the names of the stations.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    data = {
        "format": _FORMAT,
        "version": _VERSION,
        "stations": {name: _entry(memory[name]) for name in sorted(memory)},
    }
    text = json.dumps(data, indent=2, ensure_ascii=False) + "\n"
    write_text(path, text, follow_links=True)


def remember(path: Path, station: str, calibration: Calibration) -> None:
    """Store the calibration of one station in a memory; other stations remain unchanged.

    Parameters
    ----------
    path : Path
        The file; it is created if it does not exist.
    station : str
        Name of the station.
    calibration : Calibration
        Calibration to be stored.

    Raises
    ------
    InputError
        If the file is damaged; it is not overwritten then.
    OSError
        If the file cannot be written.
    """
    write_memory(path, {**read_memory(path), station: calibration})


def _entry(calibration: Calibration) -> dict[str, Any]:
    size = np.sqrt(np.diag(calibration.covariance))
    scale = np.where(size > 0.0, size, 1.0)
    correlation = calibration.covariance / np.outer(scale, scale)
    value, sigma = calibration.mean / _TO_SI, size / _TO_SI
    return {
        "utc": calibration.epoch.to("UTC").isot(np.zeros(1), 6)[0],
        "passes": calibration.passes,
        **{
            name: {"value": float(value[i]), "sigma": float(sigma[i])}
            for i, name in enumerate(_NAMES)
        },
        "correlation": {pair: float(correlation[i, j]) for pair, (i, j) in _PAIRS.items()},
    }


def _parse_entry(entry: Any) -> Calibration:
    mean = np.array([_number(entry[name]["value"], name) for name in _NAMES])
    sigma = np.array([_number(entry[name]["sigma"], f"{name}'s sigma") for name in _NAMES])
    if np.any(sigma < 0.0):
        raise InputError(f"a sigma must be ≥ 0, got {sigma.tolist()}")
    correlation = np.eye(3)
    for pair, (i, j) in _PAIRS.items():
        correlation[i, j] = correlation[j, i] = _number(entry["correlation"][pair], pair)
    passes = entry["passes"]
    if not isinstance(passes, int) or isinstance(passes, bool):
        raise InputError(f"passes must be a whole number, got {passes!r}")
    if not isinstance(entry["utc"], str):
        raise InputError(f"utc must be a time, got {entry['utc']!r}")
    sigma_si = sigma * _TO_SI
    return Calibration(
        Epoch.parse(entry["utc"], "UTC"),
        mean * _TO_SI,
        correlation * np.outer(sigma_si, sigma_si),
        passes,
    )


def _number(value: Any, name: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not isfinite(value):
        raise InputError(f"{name} must be a finite number, got {value!r}")
    return float(value)


def _refuse_damaged(path: Path, reason: str) -> NoReturn:
    raise InputError(
        f"the station memory {path} is damaged: {reason}; correct it, or move it away to begin anew"
    )
