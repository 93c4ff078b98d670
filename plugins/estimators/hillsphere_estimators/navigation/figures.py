"""Figures of the stage ``navigation``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.products import NavigationFlight

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "draw_control", "draw_errors", "draw_nees", "hours_or_days"]

COLOURS = ("blue", "vermillion", "green", "purple", "orange", "sky", "black")
_LONG_S = 3.0 * DAY_S
"""Flights longer than this are drawn over days: an axis in hours would have labels of three
digits."""


def hours_or_days(time_s: Array) -> tuple[Array, str]:
    """Return times in hours, or in days for a long flight, and the label of their axis."""
    if time_s[-1] > _LONG_S:
        return time_s / DAY_S, "time [d]"
    return time_s / 3600.0, "time [h]"


def draw_errors(figure: Figure, product: NavigationFlight) -> None:
    """Draw the errors of the estimated positions, spacecraft by spacecraft."""
    time, label = hours_or_days(product.time_s)
    every = np.atleast_1d(figure.subplots(len(product.spacecraft), 1, sharex=True))
    for i, (axes, name) in enumerate(zip(every, product.spacecraft, strict=True)):
        error = product.position_error_m[i]
        low, high = np.nanquantile(error, [0.05, 0.95], axis=1)
        axes.fill_between(time, low, high, color=PALETTE["sky"], alpha=0.35, linewidth=0,
                          label="5 to 95 %")  # fmt: skip
        axes.plot(time, error[:, 0], color=PALETTE["blue"], linewidth=1.8, label="first flight")
        axes.plot(time, np.sqrt(np.nanmean(error**2, axis=1)), color=PALETTE["green"],
                  linewidth=0.9, label="rms")  # fmt: skip
        axes.plot(time, 3.0 * product.position_sigma_m[i, :, 0], "--", color=PALETTE["vermillion"],
                  label="3σ believed")  # fmt: skip
        axes.plot(time, product.bound_m[i], ":", color=PALETTE["black"], label="bound")
        axes.set_yscale("log")
        axes.set_ylabel(f"{name}\nposition error [m]")
    every[0].legend(loc="upper right", ncols=2)
    every[-1].set_xlabel(label)


def draw_control(figure: Figure, product: NavigationFlight) -> None:
    """Draw the distance from the reference, true and believed."""
    time, label = hours_or_days(product.time_s)
    axes = figure.subplots()
    for i, name in enumerate(product.spacecraft):
        rows = slice(6 * i, 6 * i + 3)
        colour = PALETTE[COLOURS[i % len(COLOURS)]]
        believed = np.linalg.norm(product.estimate[rows] - product.goal[rows], axis=0)
        axes.plot(time, product.control_error_m[i, :, 0], color=colour, label=f"{name}, true")
        axes.plot(time, believed, "--", color=colour, alpha=0.7, label=f"{name}, estimated")
    axes.set_yscale("log")
    axes.set_ylabel("distance from the reference [m]")
    axes.set_xlabel(label)
    axes.legend(loc="upper right")


def draw_nees(figure: Figure, product: NavigationFlight) -> None:
    """Draw the mean normalised errors squared with their band."""
    time, label = hours_or_days(product.time_s)
    axes = figure.subplots()
    n, count = len(product.states), product.nees.shape[1]
    low, high = chi_square_band(n, max(count - product.lost, 1))
    axes.axhspan(low, high, color="#999999", alpha=0.4, linewidth=0, label="99.9 % band")
    mean = np.nanmean(product.nees, axis=1)
    axes.plot(time, mean, color=PALETTE["blue"], label=f"mean of {count - product.lost} flights")
    axes.plot(time, np.nanmedian(product.nees, axis=1), ":", color=PALETTE["vermillion"],
              label="median")  # fmt: skip
    if np.nanmax(mean) > 5.0 * high:
        axes.set_yscale("log")
    axes.set_ylabel(f"NEES of {n} states [-]")
    axes.set_xlabel(label)
    axes.legend(loc="upper right")
