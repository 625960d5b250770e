"""Mesh maps are right on plain shapes, and lie in the range that networks expect."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from svbrdfgan.weathering.mesh_maps import EDGE_REACH, MeshMaps, bake_mesh_maps, length_of


def buffer_of(texels: Any) -> Any:
    tensors = (torch.from_numpy(values).float() for values in (texels.position, texels.normal))
    return SimpleNamespace(**dict(zip(("position", "normal"), tensors, strict=True)))


def test_edges_of_a_box_are_convex_and_its_sides_flat_and_open(shapes: SimpleNamespace) -> None:
    box = shapes.quads(*shapes.box_sides((-1, 0, -2), (1, 1, 2)))
    top = 3 * 64  # texels of each side lie one above the other
    maps = bake_mesh_maps(box, buffer_of(shapes.texels_of(box, 64)))
    visibility, curvature = (values[top : top + 64] for values in (maps.visibility, maps.curvature))
    assert curvature[20:44, 20:44].abs().max() < 1e-4
    assert curvature[:, 0].min() > 0.3
    assert visibility.min() > 0.95


def test_the_inside_of_a_box_is_dark_and_its_edges_are_creases(shapes: SimpleNamespace) -> None:
    room = shapes.quads(*shapes.box_sides((-1, 0, -2), (1, 1, 2), inward=True))
    maps = bake_mesh_maps(room, buffer_of(shapes.texels_of(room, 32)))
    assert maps.visibility[64:96].max() < 0.25
    assert maps.curvature[68:92, 0].max() < -0.3


def test_the_model_s_size_makes_no_difference(shapes: SimpleNamespace) -> None:
    made = []
    for scale in (1.0, 4.0):
        surface = shapes.make_vehicle(scale)
        made.append(bake_mesh_maps(surface, buffer_of(shapes.texels_of(surface, 8))))
    torch.testing.assert_close(made[0].visibility, made[1].visibility, atol=0.02, rtol=0)
    torch.testing.assert_close(made[0].curvature, made[1].curvature, atol=0.02, rtol=0)
    assert length_of(shapes.make_vehicle(3.0)) == 12.0


def test_networks_see_values_from_minus_one_to_one() -> None:
    rows = [[0.0, 0.5, 1.0], [-9.0, 1.0, 9.0], [0.0, EDGE_REACH, EDGE_REACH], [0.0] * 3, [EDGE_REACH] * 3]
    maps = MeshMaps(*(torch.tensor([row], dtype=torch.float64) for row in rows))
    seen, far = maps.network_input(), 2.0 * np.exp(-3.0) - 1.0
    assert seen.dtype == torch.float32
    wanted = [[-1.0, 0.0, 1.0], [-1.0, 0.5, 1.0], [1.0, far, far], [1.0] * 3, [far] * 3]
    assert np.allclose(seen[:, 0], wanted)


def test_edges_are_where_the_box_has_them(shapes: SimpleNamespace) -> None:
    box = shapes.quads(*shapes.box_sides((-1, 0, -2), (1, 1, 2)))
    maps = bake_mesh_maps(box, buffer_of(shapes.texels_of(box, 64)))
    near = maps.convex < 0.5 * EDGE_REACH
    assert 0.0 < near.double().mean() < 0.3
    torch.testing.assert_close(maps.crease, torch.full_like(maps.crease, EDGE_REACH))
