"""Lets tests say `from stand_ins import ...`, and makes a few stand-ins for photographs once."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

sys.path.append(str(Path(__file__).parent))

if TYPE_CHECKING:
    from stand_ins import StandIn


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[StandIn]]:
    """A folder with four pictures of two vehicles and their `manifest.yaml`, and the truth. Not to be changed."""
    from stand_ins import Photographer, make_stand_ins

    from svbrdfgan.plugins.registry import load_renderer
    from svbrdfgan.procedural.sky import build_sky, sample_sky

    folder = tmp_path_factory.mktemp("photographs")
    skies = tuple(build_sky(sample_sky(seed)) for seed in (91, 92))
    photographer = Photographer(load_renderer("mitsuba", {"device": "cpu", "max_bounces": 3}), skies, (240, 160), 32)
    return folder, make_stand_ins(folder, photographer, vehicles=2, views=2)
