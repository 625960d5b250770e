"""The comparison of renderers finds the biases that it promises to find, and raises no false alarm."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from svbrdfgan.cli.check import command
from svbrdfgan.errors import AssetError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.testing.pairs import show
from svbrdfgan.testing.pairs.compare import FALSE_ALARMS, Cells, Runs, cells_of, compare
from svbrdfgan.testing.pairs.make_reference import Work
from svbrdfgan.testing.pairs.pair_scene import SCENES, TEXTURE, PairScene, SceneUnavailableError, make_scene, same_scene
from svbrdfgan.testing.pairs.quantity import (
    QUANTITIES,
    RenderedScene,
    block_index,
    film_blocks,
    jacobian_of_transport,
    jacobian_of_vjps,
)
from svbrdfgan.testing.pairs.references import RUNS, Reference, Stored, load_reference
from svbrdfgan.testing.pairs.sampling import CI, SLOW, Aim, sample
from svbrdfgan.testing.pairs.table import Row, Table, comparisons, prepared
from svbrdfgan.testing.scenes import lambertian
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, View

FAMILY = comparisons(renderers=3)
PIXELS, TEXELS = 64 * 64, TEXTURE * TEXTURE


def seen_texels() -> torch.Tensor:
    """Two texels for every pixel, so that an image block sees few of the texel blocks."""
    pixel = torch.arange(PIXELS)
    block = torch.from_numpy(block_index(64, 64)).reshape(-1)
    return torch.stack([block * 16 + pixel % 16, (block * 16 + 7 * pixel % 32) % TEXELS], dim=1)


@dataclass(frozen=True)
class Noisy:
    """A renderer whose paths are dice: the truth, times one plus noise for each pixel; and what is wrong with it.

    Attributes:
        picture, gradient: factors of the image (pixels,) and of the gradient (texels,), all 1 in an honest renderer.
        noise: standard deviation of a single sample.
    """

    picture: torch.Tensor | float = 1.0
    gradient: torch.Tensor | float = 1.0
    noise: float = 0.5
    stochastic: bool = True
    dice: int = 0

    @property
    def capabilities(self) -> RendererCapabilities:
        return RendererCapabilities(stochastic=self.stochastic)

    @property
    def device(self) -> torch.device:
        return torch.device("cpu")

    def prepare(self, surface: Surface) -> torch.Tensor:
        return seen_texels()

    def _weights(self, spp: int, seed: int) -> torch.Tensor:
        generator = torch.Generator().manual_seed(seed * 1_000 + self.dice)
        noise = self.noise if self.stochastic else 0.0
        return 1.0 + noise * spp**-0.5 * torch.randn(PIXELS, 3, generator=generator)

    def render(self, prepared: Any, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        factor = torch.as_tensor(self.picture).expand(PIXELS)[:, None]
        image = factor * self._weights(spp, seed) * materials[0].base_color.reshape(-1, 3)[prepared].mean(dim=1)
        return Rendering(image.reshape(64, 64, 3), torch.ones(64, 64))

    def render_vjp(
        self, prepared: Any, materials: Materials, view: View, grad_image: torch.Tensor, **sampling: Any
    ) -> Gradients:
        weighted = grad_image.reshape(-1, 3) * self._weights(sampling["spp"], sampling["seed"])
        factor = torch.as_tensor(self.gradient).expand(TEXELS)[:, None]
        grad = factor * torch.zeros(TEXELS, 3).index_add(0, prepared.T.reshape(-1), 0.5 * weighted.repeat(2, 1))
        return Gradients(({"base_color": grad.reshape(TEXTURE, TEXTURE, 3)},))


def block_factor(size: int, block: int, bias: float) -> torch.Tensor:
    """One, but in one block of a square of size x size."""
    return 1.0 + bias * torch.from_numpy((block_index(size, size) == block).ravel())


def rows(profile: Any, other: Noisy) -> list[Row]:
    """The honest renderer and another, in the convex scene's place."""
    return list(Table(profile, {"honest": lambda _: Noisy(dice=1), "other": lambda _: other}).rows("convex"))


def differing(row: Row) -> set[str]:
    return {found.quantity for found in row.comparisons if found.differs.any()}


@pytest.mark.parametrize("dice", [2, 3, *(pytest.param(dice, marks=pytest.mark.full) for dice in (4, 5))])
def test_honest_renderers_agree_and_biases_would_have_been_found(dice: int) -> None:
    (row,) = rows(SLOW, Noisy(dice=dice))
    assert row.verdict == "agree", list(show.explanations([row]))
    for found in row.comparisons:
        assert found.finds[0] <= 0.01
        assert (found.finds <= found.tolerance).all()
        assert (found.limit >= 4.0).all()


@pytest.mark.parametrize(
    ("profile", "other", "quantities"),
    [
        (SLOW, Noisy(gradient=block_factor(TEXTURE, 5, 0.012), dice=2), {"gradient", "jacobian"}),
        pytest.param(SLOW, Noisy(picture=block_factor(64, 9, -0.012), dice=2), {"image"}, marks=pytest.mark.full),
        (CI, Noisy(gradient=block_factor(TEXTURE, 5, 0.06), dice=2), {"gradient", "jacobian"}),
        (CI, Noisy(picture=block_factor(64, 9, 0.06), dice=2), {"image"}),
        (CI, Noisy(picture=1.012, dice=2), {"image"}),
        (CI, Noisy(gradient=0.988, dice=2), {"gradient", "jacobian"}),
    ],
    ids=["slow block", "slow pixels", "ci block", "ci pixels", "ci picture", "ci gradient"],
)
def test_a_planted_bias_is_found_where_it_is(profile: Any, other: Noisy, quantities: set[str]) -> None:
    (row,) = rows(profile, other)
    assert row.verdict == "differ"
    assert differing(row) == quantities
    assert row.failed
    assert any("differs by" in line for line in show.explanations([row]))


def test_too_few_samples_are_a_failure() -> None:
    (row,) = rows(replace(SLOW, limit=64 * PIXELS), Noisy(noise=30.0, dice=2))
    assert row.verdict == "underpowered"
    assert row.failed
    assert any("would not be found" in line for line in show.explanations([row]))


def test_a_deterministic_renderer_is_rendered_once() -> None:
    (row,) = rows(CI, Noisy(stochastic=False))
    assert row.verdict == "agree"
    (row,) = rows(CI, Noisy(stochastic=False, picture=1.012))
    assert differing(row) == {"image"}


def drawn(rng: np.random.Generator, bias: float, error: float, runs: int = 48) -> tuple[Runs, Runs]:
    """Two sides of an image: 48 blocks of equal size, one of them biased; `error` is relative, of the difference."""
    mean = np.ones(48)
    sides = [mean + error * np.sqrt(runs / 2) * rng.standard_normal((runs, 48)) for _ in range(2)]
    sides[1][:, 17] += bias
    return Runs(sides[0], 1), Runs(sides[1], 1)


def test_the_power_is_what_is_printed() -> None:
    """A block's bias of just the size that the test says it finds is found 95 times in 100."""
    rng, scene, found, tries = np.random.default_rng(1), make_scene("convex"), 0, 400
    finds = float(compare(*drawn(rng, 0.0, 0.01), QUANTITIES["image"], scene, (0.01, 0.05), FAMILY).finds[18])
    for _ in range(tries):
        outcome = compare(*drawn(rng, finds, 0.01), QUANTITIES["image"], scene, (0.01, 0.05), FAMILY)
        found += bool(outcome.differs[18])
    assert found / tries == pytest.approx(0.95, abs=5 * np.sqrt(0.05 * 0.95 / tries) + 0.01)


def test_false_alarms_are_as_rare_as_promised() -> None:
    """With a family of no more than these cells, one table in a hundred at most shows a disagreement."""
    rng, scene, tries = np.random.default_rng(2), make_scene("convex"), 1500
    alarms = sum(
        bool(compare(*drawn(rng, 0.0, 0.01), QUANTITIES["image"], scene, (0.01, 0.05), 49).differs.any())
        for _ in range(tries)
    )
    assert alarms <= FALSE_ALARMS * tries + 4 * np.sqrt(FALSE_ALARMS * tries)


def members_once(cells: Cells) -> bool:
    """Whether the sum holds every block, and the other cells each block exactly once."""
    return bool((cells.members[:, 0] == 1.0).all() and (cells.members[:, 1:].sum(axis=1) == 1.0).all())


def test_small_blocks_are_pooled_and_none_is_lost() -> None:
    scene, quantity = make_scene("occluding"), QUANTITIES["jacobian"]
    mean = np.random.default_rng(0).exponential(size=quantity.size(scene)) ** 6
    cells = cells_of(quantity, scene, mean)
    assert members_once(cells)
    single = cells.members.sum(axis=0) == 1
    assert (cells.share[single & (np.arange(len(single)) > 0)] >= 0.01).all()
    assert np.count_nonzero(cells.share[1:] < 0.01) <= 1
    assert cells.labels[0] == "sum"


def test_the_jacobian_by_transport_is_that_of_the_picture() -> None:
    """White surfaces: what all texels add to an image block is the block itself, from the very same samples."""
    renderer, scene = load_renderer("numpy"), make_scene("occluding")
    rendered = RenderedScene("numpy", renderer, renderer.prepare(scene.surface), scene)
    jacobian = jacobian_of_transport(rendered, 1, 3).sum(axis=(1, 2))
    white = lambertian(*[(1.0, 1.0, 1.0)] * len(scene.groups))
    image = renderer.render(rendered.prepared, white, scene.view, spp=1, seed=3).image.numpy()
    blocks = film_blocks(scene)
    expected = [image[blocks == block][:, block % 3].sum() for block in range(16)]
    np.testing.assert_allclose(jacobian, expected, rtol=1e-5, atol=1e-6)


def test_the_jacobian_by_gradients_is_that_by_transport() -> None:
    renderer, scene = load_renderer("numpy"), make_scene("occluding")
    rendered = RenderedScene("numpy", renderer, renderer.prepare(scene.surface), scene)
    ways = [
        Runs(np.stack([way(rendered, 1, 100 * at + run).ravel() for run in range(6)]), 1)
        for at, way in enumerate((jacobian_of_transport, jacobian_of_vjps))
    ]
    found = compare(*ways, QUANTITIES["jacobian"], scene, (0.01, 0.05), FAMILY)
    assert not found.differs.any(), found.z
    assert abs(found.difference[0]) < 0.03


OF_FILES = ("real car", "glossy", "metallic", "normal-mapped")


def stored(scene: PairScene, dice: int = 0, rounds: range = range(40)) -> Reference:
    """A reference of the noisy renderer."""
    rendered = RenderedScene("old", Noisy(dice=9), seen_texels(), scene)
    keys = {}
    for name in ("image", "gradient", "jacobian"):
        values = [QUANTITIES[name].measure(rendered, 8 * len(rounds), 10_000 + dice + run) for run in range(RUNS)]
        keys[scene.name, name] = Stored(np.stack(values), frozenset(rounds), 8 * PIXELS)
    return Reference("old", "0", {scene.name: scene.fingerprint()}, keys)


def test_a_stored_reference_takes_part_and_is_held_against_its_renderer(tmp_path: Path) -> None:
    scene = make_scene("convex")
    stored(scene).save(tmp_path / "old.safetensors")
    reference = load_reference(tmp_path / "old.safetensors")
    makers: dict[str, Callable[[int], Any]] = {"new": lambda _: Noisy(dice=1), "old": lambda _: Noisy(dice=2)}
    table = list(Table(CI, makers, reference).rows("convex"))
    assert [(row.pair, row.verdict) for row in table] == [(("new", "old*"), "agree"), (("old", "old*"), "agree")]
    changed = makers | {"old": lambda _: Noisy(dice=2, gradient=1.02)}
    table = list(Table(CI, changed, reference).rows("convex"))
    assert [row.verdict for row in table] == ["agree", "differ"]
    assert differing(table[1]) == {"gradient", "jacobian"}


def test_only_the_pairs_of_one_renderer() -> None:
    makers = {name: lambda _, dice=dice: Noisy(dice=dice) for dice, name in enumerate("abc")}
    found = Table(CI, makers, None, frozenset({"b"})).rows("convex")
    assert [row.pair for row in found] == [("a", "b"), ("b", "c")]


def test_a_reference_of_another_scene_is_stale() -> None:
    scene = make_scene("convex")
    reference = replace(stored(scene), fingerprints={"convex": "of another time"})
    table = list(Table(CI, {"new": lambda _: Noisy()}, reference).rows("convex"))
    assert table[0].verdict == "stale"
    assert "python -m svbrdfgan.testing.pairs.make_reference" in table[0].reason
    assert next(Table(CI, {"new": lambda _: Noisy()}, reference).rows("occluding")).verdict == "stale"


def test_references_are_joined_round_by_round() -> None:
    scene = make_scene("convex")
    one, two = stored(scene, rounds=range(10)), stored(scene, dice=50, rounds=range(10, 40))
    both = one.joined(two)
    key = ("convex", "image")
    assert both.stored[key].runs.samples == 40 * RUNS * 8 * PIXELS
    np.testing.assert_allclose(both.stored[key].values, 0.25 * one.stored[key].values + 0.75 * two.stored[key].values)
    with pytest.raises(AssetError, match="share rounds"):
        both.joined(one)


def test_rounds_go_where_most_is_missing() -> None:
    work = Work("numpy", ["occluding"])
    assert [work.begin() for _ in range(5)] == [*((("occluding", name), 0) for name in QUANTITIES), None]
    rng = np.random.default_rng(0)
    for name, noise in zip(QUANTITIES, (1e-9, 0.1, 1e-9, 1e-9), strict=True):
        size = QUANTITIES[name].size(make_scene("occluding"))
        work.add(("occluding", name), 0, 1.0 + noise * rng.standard_normal((RUNS, size)))
    assert work.begin() == (("occluding", "gradient"), 1)
    assert work.shares()["occluding", "gradient"] < 0.5
    assert work.shares()["occluding", "image"] == 1.0


def test_a_fingerprint_tells_scenes_apart_and_forgives_rounding() -> None:
    scene = make_scene("convex")
    prints = [make_scene(name).fingerprint() for name in SCENES if name not in OF_FILES]
    assert len(set(prints)) == len(prints)
    rounded = replace(scene, surface=replace(scene.surface, positions=scene.surface.positions * (1 + 1e-15)))
    moved = replace(scene, surface=replace(scene.surface, positions=scene.surface.positions + 1e-4))
    assert rounded.fingerprint() == scene.fingerprint() != moved.fingerprint()
    assert same_scene(rounded.fingerprint(), scene.fingerprint())
    assert not any(same_scene(scene.fingerprint(), other.fingerprint()) for other in (moved, make_scene("occluding")))


def test_a_fingerprint_forgives_another_order_and_no_other_texture() -> None:
    scene = make_scene("vehicle")
    faces = scene.surface.faces.copy()
    parts = scene.surface.face_part
    turned = replace(scene, surface=replace(scene.surface, faces=faces[::-1].copy(), face_part=parts[::-1].copy()))
    assert same_scene(turned.fingerprint(), scene.fingerprint())
    painted = replace(scene, materials=make_scene("convex").materials)
    assert not same_scene(painted.fingerprint(), scene.fingerprint())


@pytest.mark.parametrize("name", OF_FILES)
def test_a_scene_without_its_files_is_skipped_and_says_why(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SVBRDFGAN_ASSETS", raising=False)
    with pytest.raises(SceneUnavailableError, match="SVBRDFGAN_ASSETS"):
        SCENES[name]()


def test_a_renderer_is_not_compared_where_it_lacks_a_map(assets: Path) -> None:
    """Nor is the Jacobian taken from transport where pictures are not linear in the base colour alone."""
    scene = make_scene("glossy")
    assert scene.maps == {"base_color", "roughness"}
    assert prepared("noisy", lambda _: Noisy(), scene) is None
    (row,) = Table(CI, {name: lambda _: Noisy() for name in "ab"}).rows("glossy")
    assert row.verdict == "skipped"
    assert "read base_color, roughness" in row.reason
    painted = replace(scene, materials=make_scene("metallic").materials)
    assert not same_scene(painted.fingerprint(), scene.fingerprint())


def test_maps_do_not_change_the_fingerprints_of_scenes_without() -> None:
    """The stored reference is still of these scenes."""
    known = load_reference().fingerprints
    assert all(same_scene(known[name], make_scene(name).fingerprint()) for name in SCENES if name not in OF_FILES)


def test_stopping_obeys_the_error_that_is_allowed() -> None:
    scene = make_scene("convex")
    rendered = prepared("noisy", lambda _: Noisy(), scene)
    assert rendered
    aim = Aim(CI, FAMILY, rivals=True)
    runs = sample(rendered, QUANTITIES["image"], aim)
    assert aim.excess(QUANTITIES["image"], scene, runs) <= 1.0
    assert len(runs.values) >= CI.runs


@pytest.mark.parametrize(
    ("picture", "verdict", "code"), [pytest.param(1.0, "agree", 0, marks=pytest.mark.full), (1.02, "differ", 1)]
)
def test_the_command_says_so_and_fails(
    picture: float, verdict: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    makers = {"honest": lambda _: Noisy(dice=1), "other": lambda _: Noisy(dice=2, picture=picture)}
    monkeypatch.setattr("svbrdfgan.testing.pairs.table.installed_renderers", lambda: makers)
    monkeypatch.setattr("svbrdfgan.testing.pairs.references.load_reference", lambda: None)
    done = CliRunner().invoke(command, ["--pairs", "--scene", "convex", "--json"])
    assert done.exit_code == code, done.output
    (row,) = json.loads(done.stdout)
    assert (row["pair"], row["verdict"]) == (["honest", "other"], verdict)
    assert row["quantities"]["image"][0]["block"] == "sum"
    table = CliRunner().invoke(command, ["--pairs", "--scene", "convex"])
    assert verdict in table.stdout


def test_the_table_is_written_for_people_and_programs() -> None:
    found = rows(CI, Noisy(picture=1.02, dice=2))
    text = show.markdown([*found, Row("real car", (), "skipped", reason="no files")])
    assert "| convex | honest, other |" in text
    assert "| differ |" in text
    assert text.count("\n") == 4
    assert '"verdict": "differ"' in show.as_json(found)
    assert [show.rich_table(found, width).row_count for width in (80, 150)] == [2, 2]
