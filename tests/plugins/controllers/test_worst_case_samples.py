from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.stability import spectral_abscissa
from hillsphere_controllers.analysis.worst_case_samples import hinf_value, worst_sample
from hillsphere_controllers.systems.conversion import transfer_function


def resonances(*damping: float) -> Iterator[LtiSystem]:
    """1/(s² + 2ζ s + 1), whose peak is 1/(2ζ √(1 − ζ²))."""
    return (transfer_function([1.0], [1.0, 2.0 * zeta, 1.0]) for zeta in damping)


def test_the_worst_of_resonances() -> None:
    zeta = np.array([0.3, 0.05, 0.1])
    found = worst_sample(resonances(*zeta))
    np.testing.assert_allclose(found.values, 1 / (2 * zeta * np.sqrt(1 - zeta**2)), rtol=1e-8)
    assert (found.index, found.value) == (1, found.values[1])
    assert hinf_value(found.system) == found.value


def test_other_measures_and_equal_values() -> None:
    found = worst_sample(resonances(0.2, 0.1, 0.4, 0.1), h2_norm)
    np.testing.assert_allclose(found.values, np.sqrt(0.25 / np.array([0.2, 0.1, 0.4, 0.1])))
    assert found.index == 1
    slowest = worst_sample(resonances(0.2, 0.1), spectral_abscissa)
    np.testing.assert_allclose(slowest.value, -0.1)


def test_one_that_is_not_stable_is_the_worst() -> None:
    found = worst_sample(resonances(0.3, -0.1, 0.01))
    assert (found.value, found.index) == (np.inf, 1)
    assert_array_equal(np.isinf(found.values), [False, True, False])


def test_no_samples_and_no_numbers() -> None:
    with pytest.raises(InputError, match="no samples"):
        worst_sample([])
    with pytest.raises(InputError, match="sample 1 is not a number"):
        worst_sample(resonances(0.2, 0.1), lambda s: np.nan if -s.a.trace() < 0.3 else 1.0)
