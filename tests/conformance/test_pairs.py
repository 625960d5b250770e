"""Every pair of installed renderers agrees in every scene: in pictures, gradients and whole Jacobians."""

from importlib.util import find_spec

import pytest

from svbrdfgan.testing.pairs import show
from svbrdfgan.testing.pairs.pair_scene import SCENES
from svbrdfgan.testing.pairs.references import load_reference
from svbrdfgan.testing.pairs.sampling import CI, SLOW, Profile
from svbrdfgan.testing.pairs.table import Maker, Table, installed_renderers, maker

FAST = Profile("fast", of_sum=0.03, of_block=0.2, runs=24, limit=2**24)


@pytest.fixture(scope="module")
def makers() -> dict[str, Maker]:
    return installed_renderers()


def check(profile: Profile, makers: dict[str, Maker], scene: str) -> None:
    rows = list(Table(profile, makers, load_reference()).rows(scene))
    reasons = "\n".join(show.explanations(rows))
    assert not any(row.failed for row in rows), reasons
    if not any(row.comparisons for row in rows):
        pytest.skip(reasons)


def test_fast_renderers_agree_to_three_per_cent() -> None:
    """In one scene with shadows, with each other and with the stored reference of `numpy`."""
    for package in ("mitsuba", "warp"):
        if find_spec(package) is None:  # found, not imported: that is the backend's business
            pytest.skip(f"the {package} renderer needs {package}")
    check(FAST, {name: maker(name, {"device": "cpu"}) for name in ("mitsuba", "warp")}, "occluding")


@pytest.mark.full
@pytest.mark.parametrize("scene", SCENES)
def test_renderers_agree(makers: dict[str, Maker], scene: str) -> None:
    check(CI, makers, scene)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("scene", SCENES)
def test_renderers_agree_to_one_per_cent_in_every_block(makers: dict[str, Maker], scene: str) -> None:
    check(SLOW, makers, scene)
