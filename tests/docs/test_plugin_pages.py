"""The examples of the two plugin pages, installed as the pages say, are good plugins."""

import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from svbrdfgan.config.choices import PartSelection
from svbrdfgan.errors import ConfigError, EmbeddingError, UnsupportedError
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.protocols import Renderer
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.testing import RendererTests, UVEmbeddingTests, run_kit
from svbrdfgan.types import Camera, Environment, Material, Materials, Mesh, Part, Surface, View

Install = Callable[[str], None]


@pytest.fixture
def install(
    code_blocks: Callable[[str, str], list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Install]:
    """Puts a page's module on the path, with the entry points of the page's pyproject.toml."""
    monkeypatch.syspath_prepend(str(tmp_path))
    modules: list[str] = []

    def put(page: str) -> None:
        (source,), (declared,) = code_blocks(page, "python"), code_blocks(page, "toml")
        project = tomllib.loads(declared)["project"]
        ((group, entries),) = project["entry-points"].items()
        ((name, target),) = entries.items()
        modules.append(target.split(":")[0])
        (tmp_path / f"{modules[-1]}.py").write_text(source, encoding="utf-8")
        info = tmp_path / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
        info.mkdir()
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {target}\n", encoding="utf-8")

    yield put
    for module in modules:
        sys.modules.pop(module, None)


@pytest.fixture
def renderer(install: Install) -> Renderer:
    install("docs/write-a-renderer.md")
    return load_renderer("brute-force", {"epsilon": 1e-3})


def corner() -> Surface:
    """A floor (part 0) and a wall at its back (part 1), two metres wide: each shades the other."""
    floor = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], dtype=float)
    wall = np.array([[-1, 0, -1], [1, 0, -1], [1, 2, -1], [-1, 2, -1]], dtype=float)
    return Surface(
        positions=np.concatenate([floor, wall]),
        normals=np.repeat([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 4, axis=0),
        uv=np.tile([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], (2, 1)),
        faces=np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]),
        face_part=np.array([0, 0, 1, 1]),
        parts=(Part("floor"), Part("wall")),
        elevation=np.zeros(8),
        source_face=np.arange(4),
        source_barycentric=np.broadcast_to(np.eye(3), (4, 3, 3)),
    )


def view_of(radiance: torch.Tensor, rotation: float = 0.7) -> View:
    return View(Camera((1.5, 2.0, 4.0), (0.0, 0.6, 0.0), vertical_fov=0.7), Environment(radiance, rotation), 10, 8)


def textured() -> Materials:
    texture = torch.rand(3, 4, 3, generator=torch.Generator().manual_seed(1))
    return Materials((Material.lambertian(texture), Material.lambertian((0.2, 0.5, 0.9))))


def test_the_example_renderer_agrees_with_the_reference(renderer: Renderer) -> None:
    light = torch.rand(6, 12, 3, generator=torch.Generator().manual_seed(2))
    pictures = [
        maker.render(maker.prepare(corner()), textured(), view_of(light), spp=1024, seed=seed)
        for seed, maker in enumerate((renderer, load_renderer("numpy")))
    ]
    assert torch.allclose(pictures[0].coverage, pictures[1].coverage, atol=0.08)  # 5 standard deviations
    assert torch.allclose(pictures[0].image, pictures[1].image, atol=0.05)
    assert torch.allclose(pictures[0].image.mean((0, 1)), pictures[1].image.mean((0, 1)), rtol=0.02)


def test_the_gradient_of_the_example_is_that_of_its_picture(renderer: Renderer) -> None:
    """A picture that is linear in its colours is their product with its gradient."""
    prepared, view, materials = renderer.prepare(corner()), view_of(torch.ones(4, 8, 3)), textured()
    weights = torch.rand(view.height, view.width, 3)
    image = renderer.render(prepared, materials, view, spp=8, seed=3).image
    wrt = frozenset({"base_color"})
    gradients = renderer.render_vjp(prepared, materials, view, weights, wrt=wrt, spp=8, seed=3).materials
    product = sum((g["base_color"] * m.base_color).sum() for g, m in zip(gradients, materials.parts, strict=True))
    assert torch.allclose((image * weights).sum(), torch.as_tensor(product), rtol=1e-4)
    assert all(g["base_color"].shape == m.base_color.shape for g, m in zip(gradients, materials.parts, strict=True))


def test_the_example_renderer_refuses_what_it_cannot_do(renderer: Renderer) -> None:
    prepared, view = renderer.prepare(corner()), view_of(torch.ones(4, 8, 3))
    rough = Material({"base_color": torch.ones(3), "roughness": torch.ones(1)})
    with pytest.raises(UnsupportedError, match="roughness"):
        renderer.render(prepared, Materials((rough, rough)), view, spp=1, seed=0)
    wrt = frozenset({"environment"})
    with pytest.raises(UnsupportedError, match="environment"):
        renderer.render_vjp(prepared, textured(), view, torch.ones(8, 10, 3), wrt=wrt, spp=1, seed=0)
    with pytest.raises(ConfigError, match="epsilon"):
        load_renderer("brute-force", {"epsilon": -1.0})


FULL_GROUPS = [pytest.param(g, marks=pytest.mark.full) for g in ("side_effects", "shapes", "radiometry", "orientation")]


@pytest.mark.parametrize("group", ["contract", *FULL_GROUPS])
def test_the_example_renderer_passes_the_kit(install: Install, group: str) -> None:
    """Without the groups that need many samples or faces, which would take too long."""
    install("docs/write-a-renderer.md")
    kit = type("Kit", (RendererTests,), {"name": "brute-force"})
    outcomes = list(run_kit(kit, f"{group}."))
    assert [f"{o.name}: {o.message}" for o in outcomes if o.status == "failed"] == []
    assert len([o for o in outcomes if o.status == "passed"]) > len(outcomes) / 2


def test_the_example_embedding_passes_the_kit(install: Install) -> None:
    install("docs/write-a-uv-embedding.md")
    outcomes = list(run_kit(type("Kit", (UVEmbeddingTests,), {"name": "top-down"})))
    assert [f"{o.name}: {o.message}" for o in outcomes if o.status == "failed"] == []
    assert len([o for o in outcomes if o.status == "passed"]) > 40


def test_the_test_files_of_the_pages_name_their_plugins(code_blocks: Callable[[str, str], list[str]]) -> None:
    for page in ("docs/write-a-renderer.md", "docs/write-a-uv-embedding.md"):
        (test,), (declared,) = code_blocks(page, "py"), code_blocks(page, "toml")
        names: dict[str, object] = {}
        exec(compile(test, page, "exec"), names)  # a known failure that is no test of the kit raises
        kit = next(v for k, v in names.items() if k.startswith("Test"))
        (entries,) = tomllib.loads(declared)["project"]["entry-points"].values()
        assert [kit.name] == list(entries)  # type: ignore[attr-defined]


def test_the_example_embedding_unwraps_a_vehicle(install: Install) -> None:
    install("docs/write-a-uv-embedding.md")
    embedding = load_embedding("top-down", {"margin": 0.1})
    mesh = build_vehicle(sample_vehicle("sedan", seed=5))
    surface = embedding.embed(mesh)
    assert surface.uv.min() == pytest.approx(0.1)
    assert surface.uv.max() == pytest.approx(0.9)
    buffer = make_subject(mesh, embedding, 64, PartSelection()).buffer
    (low, high), side = mesh.bounds, 1.25 * np.ptp(mesh.bounds[:, [0, 2]], axis=0).max() / 64  # metres in a texel
    row, col = torch.nonzero(buffer.mask).T
    position, normal = buffer.position[buffer.mask], buffer.normal[buffer.mask]
    assert torch.allclose(position[:, 0], low[0] + (col + 0.5 - 6.4) * side, atol=1e-4)
    assert torch.allclose(position[:, 2], high[2] - (row + 0.5 - 6.4) * side, atol=1e-4)
    assert float(normal[:, 1].mean()) > 0.5  # what is seen from above faces up


def test_the_example_embedding_refuses_a_line(install: Install) -> None:
    install("docs/write-a-uv-embedding.md")
    line = Mesh(np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0.0]]), np.array([[0, 1, 2]]), np.array([0]), (Part("line"),))
    with pytest.raises(EmbeddingError, match="line"):
        load_embedding("top-down").embed(line)
