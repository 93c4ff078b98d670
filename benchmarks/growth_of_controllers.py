"""How the cost of analysis and synthesis grows with order and plants; prints tables, draws figures.

    python benchmarks/growth_of_controllers.py                       # prints; about four minutes
    python benchmarks/growth_of_controllers.py order                 # one of the two
    python benchmarks/growth_of_controllers.py --images docs/images

CPU times, each the median of several random problems of the same size. The exponent is the slope of
a straight line through the logarithms over the upper half of the sizes. ``growth-order.svg`` is of
the H∞ norm, H∞ synthesis and the certified peak of µ, ``growth-plants.svg`` of one search of a
structured controller for several plants and of the check of a controller with all of them.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.mu.blocks import BlockStructure, full, repeated_real
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.structure import free_state_space
from hillsphere_controllers.structured.synthesis import synthesise
from hillsphere_controllers.structured.verification import verify_controller

ORDERS = (5, 10, 15, 20, 30, 40, 60)
PLANTS = (1, 2, 5, 10, 20, 50)
REPEATS, SEARCHES = 7, 3
"""Random problems of each size, of which the median counts; fewer of searches, which are longer."""
TOLERANCE = 1e-3
"""Of γ, relative, in H∞ synthesis: its default."""
UPPER_ORDER, UPPER_PLANTS = 20, 5
"""Sizes from which on the exponents are fitted: the upper half."""


@dataclass(frozen=True)
class Curve:
    """CPU times over sizes: ``label``, ``sizes``, ``cpu`` (s), all of them and their medians."""

    label: str
    sizes: np.ndarray
    all_cpu: np.ndarray
    fitted_from: int

    @property
    def cpu(self) -> np.ndarray:
        """Medians, s, one for each size."""
        return np.asarray(np.median(self.all_cpu, axis=1))

    def fit(self) -> tuple[float, float]:
        """Return exponent and factor of the straight line through the upper sizes."""
        late = self.sizes >= self.fitted_from
        slope, offset = np.polyfit(np.log(self.sizes[late]), np.log(self.cpu[late]), 1)
        return float(slope), float(np.exp(offset))

    def print(self, unit: str) -> None:
        """Print times and exponent."""
        print(self.label)
        for size, cpu, row in zip(self.sizes, self.cpu, self.all_cpu, strict=True):
            print(f"  {unit} {size:>3}  {cpu:9.4f} s CPU ({row.min():.4f} to {row.max():.4f})")
        print(f"  exponent from {self.fitted_from} on: {self.fit()[0]:.2f}", flush=True)


def measure(
    label: str, sizes: Sequence[int], fitted_from: int,
    problem: Callable[[int, int], Callable[[], object]], repeats: int = REPEATS,
) -> Curve:  # fmt: skip
    """Return the CPU times of ``problem(size, seed)()``; the first call loads what all need."""
    problem(sizes[0], 0)()
    found = np.empty((len(sizes), repeats))
    for i, size in enumerate(sizes):
        for seed in range(repeats):
            run = problem(size, seed)
            begin = process_time()
            run()
            found[i, seed] = process_time() - begin
    return Curve(label, np.array(sizes), found, fitted_from)


def norm_problem(order: int, seed: int) -> Callable[[], object]:
    """Three outputs, two inputs, poles within a decade."""
    random = np.random.default_rng([1, order, seed])
    a = random.normal(size=(order, order)) / np.sqrt(order)
    a -= (np.linalg.eigvals(a).real.max() + 0.1) * np.eye(order)
    system = LtiSystem(
        a, random.normal(size=(order, 2)), random.normal(size=(3, order)), np.zeros((3, 2))
    )
    return lambda: hinf_norm(system)


def synthesis_problem(order: int, seed: int) -> Callable[[], object]:
    """Two controls and two measurements, weighted and noisy; poles about −1, some unstable."""
    random = np.random.default_rng([2, order, seed])
    a = random.normal(size=(order, order)) / np.sqrt(order) - np.eye(order)
    d = np.zeros((6, 6))
    d[2:4, 4:], d[4:, 2:4] = np.eye(2), np.eye(2)
    plant = LtiSystem(a, random.normal(size=(order, 6)), random.normal(size=(6, order)), d)
    return lambda: hinf_synthesis(plant, 2, 2, tolerance=TOLERANCE)


def mu_problem(order: int, seed: int) -> Callable[[], object]:
    """Three real and three complex uncertainties on oscillators and lags over two decades."""
    random = np.random.default_rng([3, order, seed])
    blocks = [repeated_real(), full(1)] * 3
    a, root = -np.eye(order), np.ones(order)
    for k in range(0, order - 1, 2):
        omega, zeta = 10.0 ** random.uniform(-1.0, 1.0), 10.0 ** random.uniform(-1.3, -0.3)
        a[k : k + 2, k : k + 2] = omega * np.array([[-zeta, 1.0], [-1.0, -zeta]])
        root[k : k + 2] = np.sqrt(omega * zeta)
    b = root[:, None] * random.normal(size=(order, len(blocks)))
    c = random.normal(size=(len(blocks), order)) * root
    system = LtiSystem(a, b, c, 0.3 * random.normal(size=(len(blocks), len(blocks))))
    return lambda: certified_peak(system, BlockStructure(blocks))


def two_masses(random: np.random.Generator) -> DesignPlant:
    """Return two masses and a spring whose numbers are drawn within 20 %.

    A force on the first mass, its noisy place measured, disturbances on both; z holds the places of
    both and the force.
    """
    stiffness, *mass = random.uniform(0.8, 1.2, 3)
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = stiffness * np.array([[-1.0, 1.0], [1.0, -1.0]]) / np.array(mass)[:, None]
    a[2:, 2:] = -0.05 * np.eye(2)
    b = np.zeros((4, 4))  # both disturbances, noise, force
    b[2, 0], b[3, 1], b[2, 3] = 1.0 / mass[0], 1.0 / mass[1], 1.0 / mass[0]
    c = np.zeros((4, 4))  # both places, force, measurement
    c[0, 0] = c[1, 1] = c[3, 0] = 1.0
    d = np.zeros((4, 4))
    d[2, 3], d[3, 2] = 0.5, 0.1
    return DesignPlant(LtiSystem(a, b, c, d))


def search_problem(plants: int, seed: int) -> Callable[[], object]:
    """One start, no searches by other routes, controller of order two for all plants."""
    random = np.random.default_rng([4, seed])  # a larger problem holds the plants of the smaller
    many = [two_masses(random) for _ in range(plants)]
    structure = free_state_space(2, 1, 1)
    return lambda: synthesise(many, structure, starts=1, effort="quick", shaken=False)


def check_problem(plants: int, seed: int) -> Callable[[], object]:
    """Norms and poles of the closed loops of all plants with a controller of one of them."""
    random = np.random.default_rng([4, seed])
    many = [two_masses(random) for _ in range(plants)]
    controller = hinf_synthesis(many[0].system, 1, 1).controller
    return lambda: verify_controller(many, controller)


def order_curves() -> list[Curve]:
    """Return the times of the H∞ norm, H∞ synthesis and the peak of µ over the order."""
    rows = (
        ("H∞ norm", norm_problem), ("H∞ synthesis", synthesis_problem),
        ("certified peak of µ, six blocks", mu_problem),
    )  # fmt: skip
    return [measure(label, ORDERS, UPPER_ORDER, problem) for label, problem in rows]


def plant_curves() -> list[Curve]:
    """Return the times of a structured search and of the check of a controller over the plants."""
    rows = (
        ("structured synthesis, one start", search_problem, SEARCHES),
        ("check of one controller", check_problem, REPEATS),
    )
    return [measure(label, PLANTS, UPPER_PLANTS, make, count) for label, make, count in rows]


def draw(path: Path, curves: Sequence[Curve], unit: str) -> None:
    """Draw times and fitted lines on logarithmic axes."""
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = path.stem
    figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    for curve, colour, marker in zip(
        curves, ("#0072b2", "#d55e00", "#009e73"), "os^", strict=False
    ):
        exponent, factor = curve.fit()
        label = f"{curve.label}: {unit} to the power {exponent:.2f}"
        axes.loglog(curve.sizes, curve.cpu, marker, color=colour, label=label)
        late = curve.sizes[curve.sizes >= curve.fitted_from]
        axes.loglog(late, factor * late**exponent, "-", color=colour)
    axes.set_xlabel(unit)
    axes.set_ylabel("CPU time (s)")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Measure, print, and draw if a directory is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("what", nargs="?", choices=("order", "plants"), help="by default both")
    parser.add_argument("--images", type=Path, help="directory of the figures")
    options = parser.parse_args()
    for unit, curves_of in (("order", order_curves), ("plants", plant_curves)):
        if options.what in (None, unit):
            curves = curves_of()
            for curve in curves:
                curve.print(unit)
            if options.images:
                draw(options.images / f"growth-{unit}.svg", curves, unit)


if __name__ == "__main__":
    main()
