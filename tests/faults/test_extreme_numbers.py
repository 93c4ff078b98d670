"""Numbers within their bounds with which nothing can be computed: one message, not an exception."""

from __future__ import annotations

from pathlib import Path

import pytest

from hillsphere.cli.endings import run

HOVER = Path(__file__).parent / "missions/hover.toml"


@pytest.mark.parametrize(
    ("setting", "code", "message"),
    [
        # 10¹⁵⁰ km cubed is more than a floating-point number holds.
        ("body.moon.semi_major_axis_km=1e150", 2, "semi_major_axis_km: must be ≤ 1e+12 km, got"),
        # The mean motion, which is divided by, is less than the least floating-point number.
        ("body.moon.primary_gm_km3_s2=1e-320", 2, "primary_gm_km3_s2: must be ≥ 1e-29 km³/s², got"),
        (
            "compensator.direct.period_s=1e-30", 2,
            "a flight of 7980 s has 7.98e+33 periods of 1e-30 s of its law; ",
        ),
    ],
)  # fmt: skip
def test_extreme_numbers_are_refused(
    setting: str,
    code: int,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    out = ["--out", str(tmp_path / "out"), "--workers", "0", "--set", setting]
    assert run(["run", str(HOVER), *out]) == code
    assert message in capsys.readouterr().err.splitlines()[0]
