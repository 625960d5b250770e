"""The kernels compute what the reference does; the reference is seeded, continuous, and has the slopes that it says."""

import itertools
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor

from svbrdfgan.weathering import noise, noise_reference
from svbrdfgan.weathering.procedural_noise import MOST_WIDTH, fbm, scratches, spots, streaks

DEVICES = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]


@dataclass
class Places:
    points: Tensor
    normal: Tensor
    share: Tensor


def places(count: int, *, reach: float = 20.0, share: float | None = None, device: str = "cpu") -> Places:
    """Random ones, with shares from below 0 to above 1 if no share is given."""
    drawn = torch.rand(count, 7, generator=torch.Generator().manual_seed(0)).to(device)
    shares = 1.4 * drawn[:, 6] - 0.2 if share is None else torch.full((count,), share, device=device)
    normal = torch.nn.functional.normalize(drawn[:, 3:6] - 0.5, dim=1)
    return Places((2.0 * drawn[:, :3] - 1.0) * reach, normal, shares)


Primitive = Callable[[Places, int], tuple[Tensor, ...]]
FBM: dict[str, Primitive] = {
    "fbm": lambda at, seed: (fbm(at.points, seed),),
    "fbm of many octaves": lambda at, seed: (fbm(at.points, seed, octaves=7.3, gain=0.6),),
}
SHAPES: dict[str, Primitive] = {
    "spots": lambda at, seed: tuple(vars(spots(at.points, at.share, seed)).values()),
    "streaks": lambda at, seed: tuple(vars(streaks(at.points[:, :2], at.share, seed)).values()),
    "scratches": lambda at, seed: tuple(vars(scratches(at.points, at.normal, at.share, seed)).values()),
}
PRESENT = {"spots": 0, "streaks": 0, "scratches": 2}
"""Which result of each is 0 where there is nothing."""
KNOWN_SUMS = {
    "fbm": [8.21029],
    "fbm of many octaves": [7.02248],
    "spots": [105.588984, 927.876633],
    "streaks": [94.905588, 185.094625, -154.944826, 787.125305],
    "scratches": [149.373062, -16.656154, 21.879392, 104.791061],
}
each_primitive = pytest.mark.parametrize("primitive", [*FBM.values(), *SHAPES.values()], ids=[*FBM, *SHAPES])
each_shape = pytest.mark.parametrize("name", SHAPES)
each_device = pytest.mark.parametrize("device", DEVICES)


@contextmanager
def without_warp() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "warp", None)
        yield


@pytest.fixture(params=[False, True], ids=["warp", "numpy"])
def with_and_without_warp(request: pytest.FixtureRequest) -> Iterator[None]:
    if request.param:
        with without_warp():
            yield
    else:
        yield


@pytest.fixture(params=[1, 2, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@each_device
@pytest.mark.parametrize("reach", [3.0, 10_000.0])
@each_primitive
def test_the_kernel_computes_what_the_reference_does(primitive: Primitive, reach: float, device: str) -> None:
    """But where two shapes are equally strong, or a share is within rounding of the one from which a shape is there."""
    at = places(40_000, reach=reach, device=device)
    found = primitive(at, 2**40 + 7)
    with without_warp():
        wanted = primitive(at, 2**40 + 7)
    apart = torch.zeros(len(at.points), dtype=torch.bool, device=device)
    for one, other in zip(found, wanted, strict=True):
        assert (one.device, one.dtype, one.shape) == (at.points.device, torch.float32, other.shape)
        apart |= ((one - other).abs() > 1e-5).view(len(apart), -1).any(dim=1)
    assert apart.sum() <= 2


@pytest.mark.usefixtures("with_and_without_warp")
@pytest.mark.parametrize("seed", [0, 5, 2**62])
def test_fbm_is_that_of_the_older_recipes(seed: int) -> None:
    points = places(5_000).points
    wanted = torch.from_numpy(noise.fbm(points.double().numpy(), seed, octaves=5)).float()
    torch.testing.assert_close(fbm(points, seed, octaves=5), wanted, atol=2e-6, rtol=0)


@pytest.mark.usefixtures("with_and_without_warp")
def test_octaves_fade_in() -> None:
    points = places(5_000).points
    values = [fbm(points, 3, octaves=octaves, gain=0.7) for octaves in (2.0, 2.001, 2.5, 2.999, 3.0)]
    steps = [(after - before).abs().max() for before, after in itertools.pairwise(values)]
    assert 0 < max(steps[0], steps[3]) < 0.001 < 0.05 < min(steps[1], steps[2])
    assert max(value.abs().max() for value in values) <= 1.0


@pytest.mark.parametrize("octaves", [0, -1.0, 32.5, float("nan")])
def test_octaves_out_of_range_are_refused(octaves: float) -> None:
    with pytest.raises(ValueError, match="octaves is"):
        fbm(torch.zeros(1, 3), 0, octaves=octaves)


@each_device
@pytest.mark.usefixtures("with_and_without_warp")
def test_gradients_are_finite_differences_of_the_reference(device: str) -> None:
    at = places(5_000, share=0.8, device=device)
    points = at.points.requires_grad_()
    share, exact = at.share.cpu().double().numpy(), at.points.detach().cpu().double().numpy()
    for value, reference in (
        (fbm(points, 5, octaves=3.5, gain=0.6), lambda p: noise_reference.fbm(p, 5, 3.5, 0.6, False)[0]),
        (spots(points, at.share, 5).inside, lambda p: noise_reference.spots(p, share, 5, False)[0]),
    ):
        (found,) = torch.autograd.grad((torch.arange(5_000, device=device) * value).sum(), points)
        steps = 1e-6 * np.eye(3)
        slopes = np.stack([(reference(exact + step) - reference(exact - step)) / 2e-6 for step in steps], axis=1)
        error = np.abs(found.cpu().numpy() - np.arange(5_000)[:, None] * slopes).max(axis=1)
        tolerance = 1e-4 * np.arange(5_000) * (1.0 + np.abs(slopes).max(axis=1))
        assert (error > tolerance).sum() <= 2, "more than two points are within a step of a spot's border"


def test_a_gradient_is_computed_only_when_wanted() -> None:
    at = places(10, share=0.5)
    assert not fbm(at.points, 1).requires_grad
    at.points.requires_grad_()
    assert fbm(at.points, 1).requires_grad
    assert spots(at.points, at.share, 1).inside.requires_grad
    with torch.no_grad():
        assert not fbm(at.points, 1).requires_grad


@each_shape
def test_shapes_become_more_as_the_share_grows(name: str) -> None:
    covered = []
    for share in (-0.5, 0.0, 0.25, 0.5, 1.0):
        found = SHAPES[name](places(30_000, share=share), 9)
        there = found[PRESENT[name]] > 0
        covered.append(float(there.float().mean()))
        assert not found[-1][~there].any()
    assert covered[:2] == [0.0, 0.0]
    assert covered[4] > 0.03
    np.testing.assert_allclose(np.array(covered[2:4]) / covered[4], [0.25, 0.5], atol=0.12)


@each_shape
def test_random_numbers_are_even(name: str) -> None:
    found = SHAPES[name](places(400_000, reach=1000.0, share=1.1), 9)
    random = found[-1][found[PRESENT[name]] > 0]
    assert random.min() >= 0.0
    assert random.max() < 1.0
    deviation = 5.0 / len(random) ** 0.5  # five standard errors, or less
    assert (random.mean(dim=0) - 0.5).abs().max() < deviation
    assert (torch.corrcoef(random.T) - torch.eye(4)).abs().max() < deviation


@pytest.mark.usefixtures("with_and_without_warp")
@pytest.mark.parametrize(("name", "steepest"), [("spots", 8.0), ("streaks", 110.0)])
def test_shapes_are_continuous_across_cells(name: str, steepest: float) -> None:
    """Steepest are the smallest spot, and the head of the shortest and thinnest streak."""
    line, share = torch.linspace(-8.0, 8.0, 160_001), torch.full((160_001,), 1.1)
    for axis in range(2):
        points = torch.tensor([0.3, -0.6, 0.1]).repeat(len(line), 1)
        points[:, axis] = line
        value = SHAPES[name](Places(points, points, share), 2)[0]
        assert value.max() > 0.3
        assert value.diff().abs().max() < steepest * 1.1e-4


@each_shape
def test_no_shape_is_cut_off_by_the_search(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    at = places(60_000, share=1.1)
    with without_warp():
        found = SHAPES[name](at, 4)
        monkeypatch.setattr(noise_reference, "_CORNERS", tuple(itertools.product(range(-1, 3), repeat=3)))
        monkeypatch.setattr(noise_reference, "_COLUMNS", range(-3, 4))
        monkeypatch.setattr(noise_reference, "_ROWS", range(-4, 3))
        wider = SHAPES[name](at, 4)
    assert all(torch.equal(one, other) for one, other in zip(found, wider, strict=True))


def test_a_scratch_s_profile_is_continuous_where_scratches_cross() -> None:
    """A step along a plane changes the distance by a step at most, and the weight of no scratch."""
    at, step = places(1_000_000, share=1.1), 0.002
    beside = at.points + step * torch.nn.functional.normalize(torch.linalg.cross(at.normal, at.points), dim=1)
    here, there = (scratches(points, at.normal, at.share, 6) for points in (at.points, beside))
    profiles, weights = [], []
    for found in (here, there):
        profiles.append((1.0 - found.across / found.weight / MOST_WIDTH).nan_to_num().clamp(min=0.0))
        weights.append(found.weight.where(profiles[-1] > 0.0, 1.0))
    assert (profiles[0] > 0.5).sum() > 1000
    assert ((profiles[1] - profiles[0]).abs() <= 1.1 * step / MOST_WIDTH / torch.minimum(*weights)).all()


@pytest.mark.usefixtures("with_and_without_warp")
@each_primitive
def test_threads_do_not_show(primitive: Primitive, threads: int) -> None:
    at = places(70_001, share=0.5)
    found = primitive(at, 8)
    half = primitive(Places(at.points[::2], at.normal[::2], at.share[::2]), 8)
    assert all(torch.equal(one[::2], other) for one, other in zip(found, half, strict=True))


@pytest.mark.usefixtures("with_and_without_warp")
@each_primitive
def test_a_seed_gives_the_same_bytes_and_another_others(primitive: Primitive) -> None:
    at = places(5_000, share=0.7)
    first, again, other = (primitive(at, seed)[0] for seed in (3, 3, 4))
    assert torch.equal(first, again)
    assert abs(np.corrcoef(first.numpy(), other.numpy())[0, 1]) < 0.1


@pytest.mark.usefixtures("with_and_without_warp")
@each_primitive
def test_no_points_give_no_values(primitive: Primitive) -> None:
    shapes = [tuple(each.shape) for each in primitive(places(1), 1)]
    assert [tuple(each.shape) for each in primitive(places(0), 1)] == [(0, *shape[1:]) for shape in shapes]


def test_importing_the_module_does_not_import_warp() -> None:
    code = "import sys, svbrdfgan.weathering.procedural_noise; sys.exit('warp' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.usefixtures("with_and_without_warp")
def test_known_sums_on_every_machine() -> None:
    steps = torch.arange(9_000, dtype=torch.float64) * 0.6180339887498949
    points = (20.0 * (steps % 1.0) - 10.0).float().view(-1, 3)
    at = Places(points, torch.tensor([[0.6, 0.0, 0.8]]).expand_as(points), torch.full((3_000,), 0.9))
    for name, primitive in (FBM | SHAPES).items():
        sums = [float(each.double().sum()) for each in primitive(at, 11)]
        assert sums == pytest.approx(KNOWN_SUMS[name], rel=1e-5, abs=1e-4), name
