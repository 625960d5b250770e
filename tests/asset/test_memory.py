"""The estimate of memory, against what processes hold, and what is said when that is too much."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from svbrdfgan.asset.memory import Plan, peak_bytes, require_plan
from svbrdfgan.asset.weather_document import Textures
from svbrdfgan.errors import ConfigError
from svbrdfgan.utils.memory import free_bytes, limited

PLAN = Plan(50_000, (((4096, 4096),) * 3,) * 4, Textures(4096, 4096))


@pytest.mark.full
@pytest.mark.parametrize(
    ("size", "painted", "old", "divisions"), [(512, 512, 64, 4), (2048, 2048, 1024, 10), (512, 256, 1536, 60)]
)
def test_the_estimate_is_near_what_a_process_holds(
    tmp_path: Path, size: int, painted: int, old: int, divisions: int
) -> None:
    numbers = [str(number) for number in (size, painted, old, divisions)]
    script = Path(__file__).with_name("weather_square.py")
    done = subprocess.run([sys.executable, script, tmp_path, *numbers], capture_output=True, text=True, check=True)
    estimate, measured = map(int, done.stdout.split())
    assert 0.9 <= estimate / measured <= 2.0


def test_a_plan_that_fits_passes() -> None:
    with limited(PLAN.peak_bytes()):
        assert require_plan(PLAN) == PLAN.peak_bytes()


def test_a_plan_that_does_not_fit_says_what_would() -> None:
    limit = PLAN.peak_bytes() * 3 // 4
    with limited(limit), pytest.raises(ConfigError, match=r"needs about .* GiB .* are allowed") as error:
        require_plan(PLAN)
    found = re.search(r"--size (\d+) --resolution (\d+) would fit", str(error.value))
    assert found is not None
    with limited(limit):
        require_plan(replace(PLAN, textures=Textures(*map(int, found.groups()))))


def test_where_nothing_fits_nothing_is_suggested() -> None:
    with limited(1 << 20), pytest.raises(ConfigError, match="no smaller textures fit"):
        require_plan(PLAN)


def test_the_default_limit_is_what_is_free() -> None:
    assert free_bytes() > 0
    require_plan(Plan(10, ((),), Textures(256, 256)))
    with pytest.raises(ConfigError, match="weathering needs about"):
        require_plan(replace(PLAN, triangles=free_bytes() // 1000))


def test_more_of_anything_takes_more() -> None:
    least = peak_bytes(512, 512, (512, 512), maps=3, old=(64,), triangles=10)
    assert peak_bytes(1024, 512, (512, 512), maps=3, old=(64,), triangles=10) > least
    assert peak_bytes(512, 512, (2048, 2048), maps=3, old=(64,), triangles=10) > least
    assert peak_bytes(512, 512, (512, 512), maps=4, old=(64,), triangles=10) > least
    assert peak_bytes(512, 512, (512, 512), maps=3, old=(64, 999), triangles=10) > least
    assert peak_bytes(512, 512, (512, 512), maps=3, old=(64,), triangles=11) > least
