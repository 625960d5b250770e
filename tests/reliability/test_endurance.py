"""Thousands of renders and steps in one process leave nothing behind: memory, descriptors, threads or files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.reliability.endurance import Held, grown

COUNT = int(os.environ.get("SVBRDFGAN_ENDURED", "10000"))
BYTES_EACH = 100.0
"""What a render or a step may leave, at most."""


@pytest.mark.slow
@pytest.mark.timeout(4 * 3600)
@pytest.mark.skipif(sys.platform != "linux", reason="what a process holds is read from /proc")
@pytest.mark.parametrize("work", ["numpy", "warp", "mitsuba", "training"])
def test_nothing_grows(work: str, tmp_path: Path) -> None:
    (tmp_path / "tmp").mkdir()
    path = os.pathsep.join(filter(None, sys.path))
    ended = subprocess.run(
        [sys.executable, "-m", "tests.reliability.endurance", work, "--count", str(COUNT)],
        cwd=tmp_path,
        env=os.environ | {"TMPDIR": str(tmp_path / "tmp"), "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    held = [Held(**json.loads(line)) for line in ended.stdout.splitlines() if line.startswith("{")]
    assert held[-1].count >= COUNT
    print(*held, sep="\n")
    assert grown(held, BYTES_EACH) == []


FLAT = [Held(500 * n, 10**9 + (n % 3 << 20), 10**10, 40, 4, 2) for n in range(1, 21)]


def test_what_goes_up_and_down_has_not_grown() -> None:
    assert grown(FLAT, BYTES_EACH) == []


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda each: {"resident": each.resident + 1000 * each.count}, "resident: "),
        (lambda each: {"device": each.device - 1000 * each.count}, "device: "),
        (lambda each: {"descriptors": 40 + each.count // 1000}, "descriptors: 45 to 50"),
        (lambda each: {"threads": 4 + (each.count > 8000)}, "threads: 4 to 5"),
        (lambda each: {"files": each.count}, "files: 5500 to 10000"),
    ],
)
def test_what_grew_is_named(change, found: str) -> None:
    [only] = grown([replace(each, **change(each)) for each in FLAT], BYTES_EACH)
    assert only.startswith(found)
