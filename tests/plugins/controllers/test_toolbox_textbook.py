"""The page of textbook problems agrees with the published numbers, and one worst case besides."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hillsphere_controllers as hc

PAGE = (Path(__file__).parents[3] / "docs" / "textbook.md").read_text("utf-8")
CELLS = re.findall(r"```\{code-cell\} ipython3\n(.*?)```", PAGE, re.DOTALL)


def test_every_problem_of_the_page_agrees_with_its_published_numbers() -> None:
    """The cells run in order; `agree` and `exact` of the first one fail where a number differs."""
    assert len(CELLS) == 21
    session: dict[str, Any] = {}
    for cell in CELLS:
        assert "agree(" in cell or "exact(" in cell or "assert" in cell
        exec(compile(cell, "docs/textbook.md", "exec"), session)
    with pytest.raises(AssertionError, match="γ"):
        session["agree"]("γ", 1.376, "1.37")
    with pytest.raises(AssertionError, match="gap"):
        session["exact"]("gap", 0.1, 0.100001)


def distillation() -> tuple[hc.LtiSystem, hc.LtiSystem]:
    """Return plant and inverse-based controller of the distillation process, section 8.11.3."""
    matrix = np.array([[87.8, -86.4], [108.2, -109.6]])
    plant = matrix @ hc.append(*2 * [hc.transfer_function([1.0], [75.0, 1.0])])
    action = hc.append(*2 * [hc.transfer_function([0.7 * 75.0, 0.7], [1.0, 0.0])])
    return plant, np.linalg.inv(matrix) @ action


@pytest.mark.slow
def test_skogestad_postlethwaite_8_11_3_worst_performance() -> None:
    """The worst gain over all uncertainties of size one is 44.93."""
    plant, controller = distillation()
    w_input = hc.transfer_function([1.0, 0.2], [0.5, 1.0])
    # the integral of the weight (s/2 + 0.05)/s leaks, or the closed loop were not stable
    w_error = hc.append(*2 * [hc.transfer_function([0.5, 0.05], [1.0, 1e-5])])
    delta = hc.append(*(w_input @ hc.ultidyn(name) for name in ("d1", "d2")))
    weighted = w_error @ hc.feedback(np.eye(2), plant @ (np.eye(2) + delta) @ controller)
    worst = hc.wcgain(weighted)
    assert worst.lower_bound == pytest.approx(44.93, rel=0.02)
    assert worst.upper_bound >= 44.93
    margin = hc.robgain(weighted, 44.93)
    assert margin.lower_bound == pytest.approx(1.0, abs=0.03)
