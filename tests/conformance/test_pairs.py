"""Every pair of installed renderers agrees in every scene: in pictures, gradients and whole Jacobians."""

import pytest

from svbrdfgan.testing.pairs import show
from svbrdfgan.testing.pairs.references import load_reference
from svbrdfgan.testing.pairs.sampling import CI, SLOW, Profile
from svbrdfgan.testing.pairs.scenes import SCENES
from svbrdfgan.testing.pairs.table import Maker, Table, installed_renderers


@pytest.fixture(scope="module")
def makers() -> dict[str, Maker]:
    return installed_renderers()


def check(profile: Profile, makers: dict[str, Maker], scene: str) -> None:
    rows = list(Table(profile, makers, load_reference()).rows(scene))
    reasons = "\n".join(show.explanations(rows))
    assert not any(row.failed for row in rows), reasons
    if not any(row.comparisons for row in rows):
        pytest.skip(reasons)


@pytest.mark.parametrize("scene", SCENES)
def test_renderers_agree(makers: dict[str, Maker], scene: str) -> None:
    check(CI, makers, scene)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("scene", SCENES)
def test_renderers_agree_to_one_per_cent_in_every_block(makers: dict[str, Maker], scene: str) -> None:
    check(SLOW, makers, scene)
