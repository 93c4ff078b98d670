"""A mixed-sensitivity design verified by µ, in names of the flat namespace; mypy checks it.

`assert_type` fails in mypy where a function returned Any.
"""

from __future__ import annotations

from typing import assert_type

import numpy as np

import hillsphere_controllers as hc


def main() -> None:
    """Design a controller of a lag, and bound the effect of errors of its model."""
    plant = hc.transfer_function([2.0], [1.0, 1.0])
    design = hc.mixsyn(plant, hc.performance_weight(2.0, steady_error=0.01), 0.1)
    assert_type(design, hc.MixedSensitivity[hc.LtiSystem])
    assert_type(design.K, hc.LtiSystem)
    assert_type(design.gamma, float)
    assert design.gamma < 1.0

    error = hc.shelving_weight(0.1, 2.0, 20.0) @ hc.ultidyn("error")
    assert_type(error, hc.Lft)
    plants = plant * hc.ureal("gain", 1.0, percentage=10) * (np.eye(1) + error)
    loops = hc.feedback(np.eye(1), plants * design.K)
    assert_type(loops, hc.Lft)
    margin = hc.robstab(loops)
    assert_type(margin.worst, dict[str, float])
    assert 1.0 < margin.lower_bound <= margin.upper_bound * (1.0 + 1e-6)

    nominal = hc.feedback(plant * design.K)
    assert_type(nominal, hc.LtiSystem)
    low, high = hc.diskmargin(plant @ design.K).gain_margin
    assert low < 1.0 < high
    assert_type(hc.gapmetric(plant, 1.1 * plant).nugap, float)
    shaped = hc.ncfsyn(plant)
    assert_type(shaped.Ks, hc.LtiSystem)
    assert hc.ncfmargin(plant, shaped.K, sign=1) > 0.5
    assert_type(hc.lft(hc.gain(np.eye(2)), shaped.K), hc.LtiSystem)


if __name__ == "__main__":
    main()
