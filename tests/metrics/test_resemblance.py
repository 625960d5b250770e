"""The score of draws: 1 for other true draws, and each fault lowers it the more, the stronger it is, to its target."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice, pairwise
from typing import Any

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.geometry.viewpoints import find_viewpoints
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.metrics.draw_statistics import PARTS, ScoredSurface
from svbrdfgan.metrics.resemblance import Resemblance, Resembler
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import bake_subject, make_subject
from svbrdfgan.scene.window import find_window, windowed
from svbrdfgan.types import Camera, Layer
from svbrdfgan.weathering.layer import weather
from svbrdfgan.weathering.recipes import RECIPES
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import find_site

MAPS = ("roughness", "metallic", "normal")
BARE = torch.zeros(1, 9)
DRAWS = 16
NOISE = 0.02
"""The standard deviation of the resemblance of sets of true draws is less; the faults of one set share its luck."""
TARGETS = {"frozen": 0.3, "moved": 0.5, "shuffled": 0.6, "amount": 0.7, "blurred": 0.8}
"""What the resemblance of each fault may be at most: one frozen draw, patches moved by a quarter of the texture, all
further maps of another draw, amounts off by 0.3, and blur by 2 texels."""
NEAR = {"frozen": 0.3, "blurred": 0.8, "scaled": 0.85, "tiled": 0.8}
"""Likewise of windows of fine maps: one frozen draw, blur by 2 texels, patterns larger by half, and a tile repeated."""
BLURRED = {
    "patches": 0.74947, "mean": 0.99068, "deviation": 0.98042, "spectrum": 0.79115, "joint": 0.63306, "amount": 0.99135
}  # fmt: skip
"""The parts of the least blur, as they were before maps that are constant in the truth were scored."""

_NEAR = 1.0
"""Metres from the surface to the camera of a close-up."""

Stacks = list[Tensor]
Paint = Callable[[int, int, float], Tensor]
"""The true layer of a vehicle (its number), a seed and an amount."""


@dataclass(frozen=True)
class World:
    """Vehicles, and a distribution of their true layers: seed and amount are random for each draw."""

    surfaces: list[ScoredSurface]
    paint: Paint

    def draws(self, which: int, off: float = 0.0) -> Stacks:
        """A set of true draws; `off` is added to their amounts, which stay in [0, 1]."""
        stacks = []
        for vehicle in range(len(self.surfaces)):
            rng = np.random.default_rng([which, vehicle])
            seeds = rng.integers(0, 2**31, DRAWS)
            even = (rng.permutation(DRAWS) + rng.random(DRAWS)) / DRAWS  # stratified, so that sets differ less by luck
            amounts = np.clip(even + off, 0.0, 1.0)
            stacks.append(
                torch.stack([self.paint(vehicle, int(s), float(a)) for s, a in zip(seeds, amounts, strict=True)])
            )
        return stacks

    @cached_property
    def resembler(self) -> Resembler:
        again = [torch.cat(pair) for pair in zip(self.draws(1), self.draws(4), strict=True)]
        return resembler_of(self.surfaces, self.draws(0), again)

    def score(self, stacks: Stacks) -> Resemblance:
        return self.resembler.score(layered(stacks))

    @cached_property
    def faultless(self) -> Stacks:
        return self.draws(2)

    def faulty(self, fault: str) -> Iterator[Stacks]:
        """The faultless draws with the fault, weak first."""
        yield self.faultless
        if fault == "amount":
            yield from (self.draws(2, off) for off in (0.1, 0.2, 0.3))
        strengths = {"frozen": (12, 8, 4, 1), "moved": (2, 4, 8, 16, 32), "shuffled": (4, 8, 16), "blurred": (1, 2)}
        strengths |= {"scaled": (112, 125, 150), "tiled": (2, 4)}
        for strength in strengths.get(fault, ()):
            yield [globals()[fault](draws, strength, s) for draws, s in zip(self.faultless, self.surfaces, strict=True)]


def layered(stacks: Stacks) -> list[Layer]:
    return [Layer(draws, MAPS if draws.shape[-1] == 9 else ()) for draws in stacks]


def resembler_of(surfaces: list[ScoredSurface], truth: Stacks, again: Stacks, seed: int = 0) -> Resembler:
    return Resembler.make(surfaces, layered(truth), layered(again), BARE, seed)


def frozen(draws: Tensor, strength: int, surface: ScoredSurface) -> Tensor:
    """Only so many draws are different."""
    return draws[torch.arange(len(draws)) % strength]


def moved(draws: Tensor, strength: int, surface: ScoredSurface) -> Tensor:
    """Right patches in wrong places: by so many 128ths of the texture."""
    return draws.roll(strength * draws.shape[1] // 128, dims=1)


def shuffled(draws: Tensor, strength: int, surface: ScoredSurface) -> Tensor:
    """Roughness, metallic and normal of so many draws are those of others."""
    others = torch.cat([draws[:strength].roll(1, dims=0), draws[strength:]])
    return torch.cat([draws[..., :4], others[..., 4:]], dim=-1)


def blurred(draws: Tensor, strength: int, surface: ScoredSurface) -> Tensor:
    """By a Gaussian of so many texels' deviation, over the scored surface; maps are weighted by alpha."""
    steps = torch.arange(-4 * strength, 4 * strength + 1)
    kernel = torch.exp(-(steps**2) / (2.0 * strength**2))
    kernel, scored, alpha = kernel / kernel.sum(), (surface.weight > 0).float(), draws[..., 3:4]
    laid = torch.cat([alpha, draws * alpha, scored.expand(len(draws), -1, -1)[..., None]], dim=-1)
    images = (laid * scored[..., None]).movedim(-1, 1)
    images = F.conv2d(images.flatten(0, 1)[:, None], kernel.view(1, 1, 1, -1), padding=(0, len(steps) // 2))
    images = F.conv2d(images, kernel.view(1, 1, -1, 1), padding=(len(steps) // 2, 0))[:, 0]
    mean = images.unflatten(0, (len(draws), -1)).movedim(1, -1)
    maps = mean[..., 1:-1] / mean[..., :1].clamp(min=1e-6)
    return torch.cat([maps[..., :3], mean[..., :1] / mean[..., -1:].clamp(min=1e-6), maps[..., 4:]], dim=-1)


def scaled(draws: Tensor, strength: int, surface: ScoredSurface) -> Tensor:
    """Patterns are larger: so many percent of their size."""
    size = draws.shape[1]
    middle = slice((size - size * 100 // strength) // 2, (size + size * 100 // strength) // 2)
    cut = draws[:, middle, middle].movedim(-1, 1)
    return F.interpolate(cut, (size, size), mode="bilinear").movedim(1, -1)


def tiled(draws: Tensor, strength: int, surface: ScoredSurface) -> Tensor:
    """A tile of the middle is repeated, so many times along each side."""
    side = draws.shape[1] // strength
    first = (draws.shape[1] - side) // 2
    return draws[:, first : first + side, first : first + side].repeat(1, strength, strength, 1)


def synthetic(size: int = 64, vehicles: int = 2) -> World:
    """Blotches of noise that settle at places of each vehicle's own, with relief, and bare metal at their rims."""
    rows, cols = torch.meshgrid(torch.linspace(0, 1, size), torch.linspace(0, 1, size), indexing="ij")
    steps = torch.arange(-6, 7)
    kernel = torch.exp(-(steps**2) / 2.0)
    kernel = kernel / kernel.square().sum()  # keeps white noise's deviation

    def noise(seed: int) -> Tensor:
        white = torch.randn(1, 1, size, size, generator=torch.Generator().manual_seed(seed))
        wide = F.conv2d(F.pad(white, (6, 6, 6, 6), mode="circular"), kernel.view(1, 1, 1, -1))
        return F.conv2d(wide, kernel.view(1, 1, -1, 1))[0, 0]

    def paint(vehicle: int, seed: int, amount: float) -> Tensor:
        places = torch.sin((7 + vehicle) * rows) + torch.cos(9 * cols + vehicle)
        potential = 0.3 * noise(seed) + places + 3.0 * (amount - 0.7)
        alpha = torch.sigmoid(8.0 * potential) * min(1.0, 4.0 * amount)
        metal = torch.exp(-((4.0 * potential) ** 2))
        down, right = torch.gradient(0.5 * alpha)
        normal = F.normalize(torch.stack([-right, -down, torch.ones_like(alpha)], dim=-1), dim=-1)
        color = torch.stack([0.4 - 0.2 * alpha, 0.2 - 0.1 * alpha, 0.1 - 0.05 * metal], dim=-1)
        further = torch.stack([0.9 - 0.5 * metal, metal], dim=-1)
        return torch.cat([color, alpha[..., None], further, normal], dim=-1)

    part = (rows > 0.6).int()
    weight = (0.5 + rows) * ((cols - 0.5).abs() < 0.45)
    return World([ScoredSurface(weight, part)] * vehicles, paint)


@pytest.fixture(scope="module")
def world() -> World:
    return synthetic()


def test_other_true_draws_score_one(world: World) -> None:
    found = [world.score(world.draws(n)) for n in range(2, 6)]
    mean = {name: np.mean([each.parts[name] for each in found]) for name in PARTS}
    assert all(abs(value - 1.0) < 0.12 for value in mean.values()), mean
    assert min(each.resemblance for each in found) > 0.9


def test_the_best_constant_scores_nothing(world: World) -> None:
    mean = torch.cat([draws.flatten(0, 2) for draws in world.draws(0)]).mean(dim=0)
    found = world.score([mean.expand(DRAWS, 64, 64, 9)] * 2)
    assert found.resemblance == 0.0
    assert all(value < 0.05 for value in found.parts.values()), found.parts


@pytest.mark.parametrize("fault", TARGETS)
def test_a_fault_lowers_the_score(world: World, fault: str) -> None:
    _require_fall([world.score(draws) for draws in world.faulty(fault)], TARGETS[fault])


def _require_fall(scores: list[Resemblance], target: float) -> None:
    found = [score.resemblance for score in scores]
    print(*(line for score in scores for line in score.lines()), sep="\n")  # for docs/lab/results.md, by -s
    assert all(stronger <= weaker + NOISE for weaker, stronger in pairwise(found)), found
    assert found[0] > 0.9
    assert found[-1] <= target, scores[-1].lines()


@pytest.fixture(scope="module", params=["smooth-rust", "smooth-dirt"])
def weathered(request: pytest.FixtureRequest) -> World:
    """Recipes at full detail on procedural vehicles."""
    vehicles = [build_vehicle(sample_vehicle(kind, 100 + n)) for n, kind in enumerate(("sedan", "van", "pickup"))]
    embedding = load_embedding("hemispherical")
    subjects = [make_subject(mesh, embedding, 128, PartSelection()) for mesh in vehicles]
    sites = [find_site(subject.surface, subject.buffer) for subject in subjects]
    surfaces = [ScoredSurface(s.buffer.area * s.learnable_texels, s.buffer.part) for s in subjects]

    def paint(vehicle: int, seed: int, amount: float) -> Tensor:
        recipe = RECIPES[request.param](seed=seed, amount=amount, detail=1.0)
        subject = subjects[vehicle]
        return weather(subject.surface, subject.buffer, recipe, MAPS, site=sites[vehicle]).values

    return World(surfaces, paint)


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("fault", TARGETS)
def test_a_fault_of_a_recipe_lowers_the_score(weathered: World, fault: str) -> None:
    _require_fall([weathered.score(draws) for draws in weathered.faulty(fault)], TARGETS[fault])


@pytest.mark.full
@pytest.mark.timeout(3600)
def test_other_draws_of_a_recipe_score_one(weathered: World) -> None:
    found = weathered.score(weathered.draws(3))
    assert found.resemblance > 0.93, found.lines()


@pytest.fixture(scope="module")
def near() -> World:
    """Windows of 128 texels of maps of 1,024, where close-ups of procedural vehicles look.

    Rust is too sparse there: three windows of 16 draws are as alike as 0.81.
    """
    surfaces, sites = [], list[tuple[Any, Any, Site]]()
    for number, kind in enumerate(("sedan", "van", "pickup")):
        mesh = build_vehicle(sample_vehicle(kind, 100 + number))
        whole = make_subject(mesh, load_embedding("hemispherical"), 256, PartSelection())
        learnable = np.isin(mesh.face_part, whole.learnable)
        seen = find_viewpoints(mesh, learnable, 1)
        for point, direction in zip(seen.points, seen.directions, strict=True):
            camera = Camera(tuple(point + _NEAR * direction), tuple(point))
            window = find_window(whole.surface, whole.learnable, camera, 1.0, 128, 1024)
            fragments = Fragments.of(windowed(whole.surface, window, 1024), 128, 128)
            subject = bake_subject(mesh, fragments, PartSelection())
            surfaces.append(ScoredSurface(subject.buffer.area * subject.learnable_texels, subject.buffer.part))
            sites.append((subject.surface, subject.buffer, find_site(subject.surface, subject.buffer)))

    def paint(window: int, seed: int, amount: float) -> Tensor:
        surface, buffer, site = sites[window]
        return weather(surface, buffer, RECIPES["road-dirt"](seed=seed, amount=amount), MAPS, site=site).values

    return World(surfaces, paint)


@pytest.mark.full
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("fault", NEAR)
def test_a_fault_seen_from_near_lowers_the_score(near: World, fault: str) -> None:
    _require_fall([near.score(draws) for draws in near.faulty(fault)], NEAR[fault])


def with_metallic(stacks: Stacks, value: float) -> Stacks:
    changed = [draws.clone() for draws in stacks]
    for draws in changed:
        draws[..., 5] = value
    return changed


@pytest.fixture(scope="module")
def dull(world: World) -> World:
    """The same with layers that are nowhere metal, as dust, dirt and rust are."""
    return World(world.surfaces, lambda *of: with_metallic([world.paint(*of)], 0.0)[0])


def test_a_map_that_is_constant_in_the_truth_costs_what_can_be_seen_of_it(dull: World) -> None:
    """Metallic of 0.01 once cost everything: its correlation with alpha is perfect, and the truth has none."""
    found = {value: dull.score(with_metallic(dull.faultless, value)) for value in (0.0, 0.01, 0.05, 0.2, 0.5, 1.0)}
    scores = [score.resemblance for score in found.values()]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > 0.97
    assert found[0.01].resemblance > scores[0] - 0.005
    assert found[0.05].resemblance > scores[0] - 0.03
    assert found[0.5].resemblance < 0.6
    assert {found[0.5].least, found[1.0].least} <= {"mean", "deviation", "joint"}
    assert found[1.0].resemblance == 0.0


def with_relief(world: World, steep: float) -> World:
    """The same with normals that are noise of this deviation, which depends on no other map."""

    def paint(vehicle: int, seed: int, amount: float) -> Tensor:
        layer, rng = world.paint(vehicle, seed, amount), torch.Generator().manual_seed(seed)
        tilted = steep * torch.randn(*layer.shape[:2], 2, generator=rng)
        return torch.cat([layer[..., :6], tilted, torch.ones_like(tilted[..., :1])], dim=-1)

    return World(world.surfaces, paint)


def test_relief_that_nobody_sees_does_not_count(world: World) -> None:
    """Slopes of recipes at 256 texels deviate by 0.003 at most."""
    faint = with_relief(world, 0.003)
    found = [faint.score(with_relief(world, steep).faultless).resemblance for steep in (0.003, 0.0, 0.02, 0.5)]
    assert found[0] > 0.97
    assert found[1:3] == pytest.approx([found[0]] * 2, abs=0.01)
    assert found[3] < 0.7


def test_relief_that_depends_on_nothing_is_scored(world: World) -> None:
    """Its correlations are chance in the truth, too, and errors relative to these would refuse every score."""
    tilted = with_relief(world, 0.03)
    assert tilted.score(tilted.faultless).joint > 0.9
    assert tilted.score(with_relief(world, 0.3).faultless).resemblance < 0.6


@pytest.mark.parametrize("fault", ["frozen", "shuffled"])
def test_a_fault_is_found_beside_a_map_that_is_constant(dull: World, fault: str) -> None:
    _require_fall([dull.score(draws) for draws in dull.faulty(fault)], TARGETS[fault])


def test_maps_that_vary_have_the_scores_that_they_always_had(world: World) -> None:
    found = world.score(next(islice(world.faulty("blurred"), 1, None)))
    assert found.parts == pytest.approx(BLURRED, abs=1e-4)


def test_texels_that_are_not_scored_and_colours_of_nothing_do_not_count(world: World) -> None:
    clear = [torch.where(draws[..., 3:4] < 0.02, 0.0, draws) for draws in world.faultless]
    painted, hidden = [], []
    for draws, surface in zip(clear, world.surfaces, strict=True):
        painted.append(torch.where(draws[..., 3:4] == 0.0, torch.rand(9) * torch.eye(9)[3].logical_not(), draws))
        hidden.append(torch.where(surface.weight[..., None] > 0, draws, torch.rand(9)))
    assert world.score(painted) == world.score(hidden) == world.score(clear)


def test_the_same_seed_gives_the_same_score() -> None:
    world = synthetic(vehicles=1)
    first, again, other = (
        resembler_of(world.surfaces, world.draws(0), world.draws(1), seed).score(layered(world.faultless))
        for seed in (0, 0, 1)
    )
    assert first == again
    assert other.patches != first.patches
    assert other.patches == pytest.approx(first.patches, abs=0.05)


def test_several_sets_of_other_draws_are_averaged(world: World) -> None:
    chances = [resembler_of(world.surfaces, world.draws(0), world.draws(n)).chance for n in (1, 4)]
    for name, found in world.resembler.chance.items():
        assert found == pytest.approx((chances[0][name] + chances[1][name]) / 2, rel=1e-4, abs=1e-7)


def test_the_score_is_the_geometric_mean_of_clipped_parts(tmp_path) -> None:
    record = Resemblance(
        patches=0.5, mean=1.2, deviation=0.25, spectrum=1.0, joint=1.0, amount=1.0, subjects=3, draws=16
    )
    assert record.resemblance == pytest.approx(math.pow(0.125, 1 / 6))
    assert record.least == "deviation"
    assert record.lines()[1].startswith("least part:  deviation 0.25 (")
    assert record.model_copy(update={"joint": -0.1}).resemblance == 0.0
    save_record(tmp_path / "resemblance.json", record)
    assert load_record(Resemblance, tmp_path / "resemblance.json") == record


def test_what_does_not_fit_is_refused(world: World) -> None:
    draws = world.faultless
    with pytest.raises(AssetError, match="one for each of 2"):
        world.score(draws[:1])
    with pytest.raises(AssetError, match="two or more of 64 x 64"):
        world.score([draws[0], draws[1][:1]])
    with pytest.raises(AssetError, match="9 channels"):
        world.score([each[..., :4] for each in draws])
    small = ScoredSurface(torch.ones(8, 8), torch.zeros(8, 8, dtype=torch.int32))
    with pytest.raises(AssetError, match="halved twice"):
        resembler_of([small], [torch.rand(2, 8, 8, 9)], [torch.rand(2, 8, 8, 9)])
    scattered = replace(world.surfaces[0], part=torch.arange(64 * 64).reshape(64, 64))
    with pytest.raises(AssetError, match="no patch"):
        resembler_of([scattered], draws[:1], draws[:1])
    unseen = replace(world.surfaces[0], weight=torch.zeros(64, 64))
    with pytest.raises(AssetError, match="nothing is scored"):
        resembler_of([unseen], draws[:1], draws[:1])
    flat = [torch.full((2, 64, 64, 9), 0.5)]
    with pytest.raises(AssetError, match="no closer to each other"):
        resembler_of(world.surfaces[:1], flat, flat)
