"""What a station has learned about itself: angle biases and time offset, kept between passes.

A tracker that estimates its station's biases begins the next pass with what it knew after the last
one. In between the estimate ages as a random walk: its covariance grows in proportion to time. The
memory is a small file that a person can read and mend::

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
"""Bytes: ten thousand stations."""
_DEGREE = np.pi / 180.0
_TO_SI = np.array([_DEGREE, _DEGREE, 1.0])
_NAMES = ("azimuth_bias_deg", "elevation_bias_deg", "time_offset_s")
_PAIRS = {"azimuth_elevation": (0, 1), "azimuth_time": (0, 2), "elevation_time": (1, 2)}
_DAY = 86400.0


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is known of a station's systematic errors.

    Parameters
    ----------
    epoch : Epoch
        When it was known.
    mean : ndarray, shape (3,)
        Azimuth bias, rad, elevation bias, rad, and time offset, s: measured less true.
    covariance : ndarray, shape (3, 3)
        Of their errors, in the same units.
    passes : int
        From how many passes.

    Raises
    ------
    InputError
        If something is not finite, or the covariance is not symmetric and positive.
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
    """How a station's systematic errors wander: random walks.

    Parameters
    ----------
    bias_rad_per_sqrt_day : float
        Standard deviation that each angle bias gains in a day.
    time_s_per_sqrt_day : float
        That of the time offset.

    Raises
    ------
    InputError
        If one is negative or not finite.
    """

    bias_rad_per_sqrt_day: float
    time_s_per_sqrt_day: float

    def __post_init__(self) -> None:
        for number in (self.bias_rad_per_sqrt_day, self.time_s_per_sqrt_day):
            if not (isfinite(number) and number >= 0.0):
                raise InputError(f"a random walk needs a size ≥ 0 and finite, got {number}")


def age_calibration(calibration: Calibration, epoch: Epoch, forgetting: RandomWalk) -> Calibration:
    """Return what is left of a calibration at another time.

    Parameters
    ----------
    calibration : Calibration
        As it was known.
    epoch : Epoch
        When it is asked for; an earlier one counts as so much later.
    forgetting : Forgetting
        How fast it ages.

    Returns
    -------
    Calibration
        The same mean with a covariance that has grown.
    """
    days = abs(epoch.seconds_since(calibration.epoch)) / _DAY
    walk = np.array([forgetting.bias_rad_per_sqrt_day] * 2 + [forgetting.time_s_per_sqrt_day])
    return replace(
        calibration, epoch=epoch, covariance=calibration.covariance + np.diag(walk**2 * days)
    )


def combine_calibrations(prior: Calibration, estimate: Calibration) -> Calibration:
    """Return what follows from two independent estimates.

    Not for an estimate that a tracker made with `prior` to begin with: that one already contains
    it, and is to be remembered as it is.

    Parameters
    ----------
    prior : Calibration
        Aged to the other's epoch (`age_calibration`).
    estimate : Calibration
        Newer one.

    Returns
    -------
    Calibration
        At the estimate's epoch, from all passes. Quantities that both know exactly keep the
        prior's value.
    """
    # scaled to deviations: angles and seconds differ by orders of magnitude
    size = np.sqrt(np.diag(prior.covariance) + np.diag(estimate.covariance))
    scale = np.where(size > 0.0, size, 1.0)
    outer = np.outer(scale, scale)
    p, r = prior.covariance / outer, estimate.covariance / outer
    gain = p @ np.linalg.pinv(p + r, hermitian=True)
    mean = prior.mean + scale * (gain @ ((estimate.mean - prior.mean) / scale))
    # Joseph's form stays symmetric and positive
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
        The file; one that does not exist yet is an empty memory.

    Returns
    -------
    mapping of str to Calibration
        By station name.

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
            f"the station memory {path} is of version {data.get('version')!r}; this program reads"
            f" version {_VERSION}: use the program that wrote it, or another file"
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
    """Write a station memory; what stood there stays if that fails.

    Parameters
    ----------
    path : Path
        The file; its directory exists.
    memory : mapping of str to Calibration
        By station name.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    data = {
        "format": _FORMAT,
        "version": _VERSION,
        "stations": {name: _entry(memory[name]) for name in sorted(memory)},
    }
    text = json.dumps(data, indent=2, ensure_ascii=False) + "\n"
    write_text(path, text, follow_links=True)


def remember(path: Path, station: str, calibration: Calibration) -> None:
    """Put one station's calibration into a memory, the others left as they are.

    Parameters
    ----------
    path : Path
        The file; made if there is none.
    station : str
        Its name.
    calibration : Calibration
        To be kept from now on.

    Raises
    ------
    InputError
        If the file is damaged: it is not overwritten.
    OSError
        If it cannot be written.
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
        f"the station memory {path} is damaged: {reason}; mend it, or move it away to begin anew"
    )
