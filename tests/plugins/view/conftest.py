"""Two runs of waves, which the tests of the page show."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from tests.core.wave_missions import WAVES
from tests.plugins.view.serving import PORT, application, client_of, make_runs

from hillsphere.plugins import default_registry
from hillsphere_view.guard import Session


@pytest.fixture(scope="module", autouse=True)
def _waves(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the plugin in this process and in those that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HILLSPHERE_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.syspath_prepend(str(WAVES))
        default_registry.cache_clear()
        yield
    default_registry.cache_clear()


@pytest.fixture(scope="module")
def place(_waves: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory with a mission and ``runs`` with the runs ``one`` and ``two``."""
    made = tmp_path_factory.mktemp("place")
    make_runs(made)
    return made


@pytest.fixture
def client(place: Path) -> TestClient:
    """Client with the session's cookie."""
    session = Session(PORT)
    return client_of(application(place, session), session)
