"""The nose and the roof are found in any axes, at any scale, with and without names; what is unlike a car is unsure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.asset.orientation import AXES, Orientation, axes, find_orientation
from svbrdfgan.asset.round_pieces import find_wheels
from svbrdfgan.asset.words import named_parts
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import KINDS, sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Mesh, Part

ALL = [(front, up) for front in AXES for up in AXES if front[1] != up[1]]
WHOLE = {
    "cesium_milk_truck.glb": "+X",
    "dutch_ship/dutch_ship_medium_1k.gltf": "+X",
    "folio2025_jeep_draco_ktx2.glb": "+X",
    "food_car/scene.gltf": "+X",
    "godot_truck_town.glb": "+Z",
    "kenney_truck_yellow/vehicle-truck-yellow.glb": "+Z",
    "market_van_draco.gltf": "+Z",
    "mazda_rx7.glb": "+Z",
    "racing_game_chassis_draco.glb": "+Z",
    "rc_toy/scene.gltf": "-Z",
    "red_dragon_truck/scene.gltf": "-Z",
    "semi_truck/scene.gltf": "+Z",
    "sketchbook_airplane.glb": "+Z",
    "sketchbook_car.glb": "+Z",
    "town_bus.glb": "+X",
    "toy_car_meshopt.glb": "+Z",
}
"""Where the noses of whole vehicles are, by their pictures. All have the roof at +Y. The market cart's is a guess."""

SLOW = ("dutch_ship", "food_car", "semi_truck", "town_bus", "cesium", "airplane", "kenney")
ONE_WHEELED = "folio2025_jeep_draco_ktx2.glb"
QUICK = [file for file in WHOLE if file != ONE_WHEELED and not any(part in file for part in SLOW)]
"""Those that are read within some seconds. A file with one wheel, which a game copies, has no nose to be found."""

HELD_OUT = ("gazebo_pickup", "jme_modern_hatchback", "quaternius_carpack16_car")
OUTSIDERS = ("kenney_race", "quaternius_tankpack_tank3", "scaranto_race_car")


def moved(mesh: Mesh, front: str, up: str, scale: float = 1.0, shift: float = 0.0) -> Mesh:
    """A mesh of the project's axes in others."""
    matrix = Orientation(front, up, True, True, "").matrix()
    return replace(mesh, positions=scale * mesh.positions @ matrix + shift * scale)


def unnamed(mesh: Mesh) -> Mesh:
    return replace(mesh, parts=tuple(replace(part, name=f"part {k}") for k, part in enumerate(mesh.parts)))


@pytest.fixture(scope="module", params=KINDS)
def vehicle(request: pytest.FixtureRequest) -> Mesh:
    return build_vehicle(sample_vehicle(request.param, 1001))


@pytest.fixture(scope="module")
def sedan() -> Mesh:
    return build_vehicle(sample_vehicle("sedan", 1001))


def box(sides: tuple[float, float, float], center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])
    return Mesh(corners * sides + center, faces, np.zeros(12, dtype=np.int64), (Part("box"),))


@pytest.mark.parametrize(("front", "up"), ALL)
def test_matrix_is_the_rotation_to_the_project_axes(front: str, up: str) -> None:
    matrix = Orientation(front, up, True, True, "").matrix()
    assert np.isclose(np.linalg.det(matrix), 1.0)
    assert np.array_equal(matrix @ AXES[up], (0, 1, 0))
    assert np.array_equal(matrix @ AXES[front], (0, 0, 1))


def test_axes_that_are_given_are_written_in_one_way() -> None:
    assert axes("x", "-z") == ("+X", "-Z")
    assert axes(None, "+Y") == (None, "+Y")


@pytest.mark.parametrize(
    ("front", "up", "told"), [("W", None, "front is 'W'"), ("+X", "-X", "one axis"), ("", "Y", "front")]
)
def test_axes_that_are_none_are_refused(front: str, up: str | None, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        axes(front, up)


@pytest.mark.parametrize("given", ALL[7:8])
def test_nose_and_roof_are_found_in_any_axes(vehicle: Mesh, given: tuple[str, str]) -> None:
    found = find_orientation(moved(vehicle, *given, scale=340.0, shift=7.0))
    assert (found.front, found.up, found.front_sure, found.up_sure) == (*given, True, True)


@pytest.mark.parametrize("given", ALL[13:14])
def test_without_names_the_roof_is_found_and_a_wrong_nose_is_unsure(vehicle: Mesh, given: tuple[str, str]) -> None:
    found = find_orientation(moved(unnamed(vehicle), *given))
    assert (found.up, found.up_sure) == (given[1], True)
    assert found.front == given[0] or not found.front_sure


@pytest.mark.parametrize("given", ALL[::8])
def test_the_shape_of_a_car_tells_its_nose(sedan: Mesh, given: tuple[str, str]) -> None:
    found = find_orientation(moved(unnamed(sedan), *given))
    assert (found.front, found.up) == given


def test_scale_and_place_change_nothing(sedan: Mesh) -> None:
    found = {
        find_orientation(moved(sedan, "+X", "+Z", scale, shift))
        for scale, shift in ((1.0, 0.0), (0.001, 3.0), (5e4, 3.0))
    }
    assert len(found) == 1


@pytest.mark.parametrize(("front", "up"), ALL[::11])
def test_what_is_given_is_kept_and_the_other_found_under_it(sedan: Mesh, front: str, up: str) -> None:
    mesh = moved(sedan, front, up)
    under_front, under_up = find_orientation(mesh, front=front), find_orientation(mesh, up=up)
    assert (under_front.front, under_front.up, under_front.front_sure) == (front, up, True)
    assert (under_up.front, under_up.up, under_up.up_sure) == (front, up, True)


def test_a_given_nose_is_kept_even_if_it_is_wrong(sedan: Mesh) -> None:
    found = find_orientation(sedan, front="-Z")
    assert (found.front, found.up, found.front_sure) == ("-Z", "+Y", True)
    assert find_orientation(sedan, front="X", up="z").front_sure


@pytest.mark.parametrize("sides", [(1.0, 1.0, 1.0), (1.0, 5.0, 2.0), (4.0, 0.1, 4.0)])
def test_what_is_no_vehicle_has_the_convention_of_gltf_and_is_unsure(sides: tuple[float, float, float]) -> None:
    found = find_orientation(box(sides))
    assert (found.front, found.up, found.front_sure, found.up_sure) == ("+Z", "+Y", False, False)
    assert "only a guess" in found.reason


@pytest.mark.parametrize("front", ["+Z", "-Z"])
def test_names_of_nodes_tell_the_nose(front: str) -> None:
    """A body with two equal ends on four wheels, which only names tell apart."""
    body, lamps = box((0.4, 0.25, 1.0), (0, 0.2, 0)), box((0.3, 0.05, 0.01), (0, 0.2, 0.5))
    car = build_vehicle(sample_vehicle("sedan", 1001))
    tyres = np.isin(car.face_part, [part for part, each in enumerate(car.parts) if each.name == "tyre"])
    wheels = replace(car, faces=car.faces[tyres], face_part=car.face_part[tyres])
    middle = 0.5 * (wheels.bounds[0, 2] + wheels.bounds[1, 2])
    pieces = [body, replace(wheels, positions=wheels.positions - (0, 0, middle)), lamps]
    starts = np.cumsum([0, *(len(piece.positions) for piece in pieces)])
    mesh = Mesh(
        np.concatenate([piece.positions for piece in pieces]),
        np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)]),
        np.repeat(np.arange(3), [len(piece.faces) for piece in pieces]),
        (Part("a"), Part("b"), Part("c")),
    )
    said = find_orientation(moved(mesh, front, "+Y"), names=("", "", "HeadLights_L"))
    assert (said.front, said.up, said.front_sure, said.up_sure) == (front, "+Y", True, True)
    assert not find_orientation(moved(mesh, front, "+Y")).front_sure
    with pytest.raises(ValueError, match="shorter"):
        find_orientation(mesh, names=("one",))


def test_wheels_are_found_with_their_axle_and_size(sedan: Mesh) -> None:
    def centered(mesh: Mesh) -> Float[ndarray, "vertices 3"]:
        return np.asarray(mesh.positions - mesh.bounds.mean(axis=0))

    turned = moved(sedan, "+X", "+Z")
    for mesh, axle in ((sedan, 0), (turned, 1)):
        wheels = find_wheels(centered(mesh), mesh.faces, mesh.face_part)
        assert wheels.axles.tolist() == [axle] * 4
        assert np.allclose(wheels.radii, sample_vehicle("sedan", 1001).wheel_radius, rtol=0.1)


def test_words_are_read_in_any_spelling() -> None:
    names = [
        "HeadLights",
        "RRRX7VS__BrakeLight2",
        "wheel-front-left",
        "Steering wheel",
        "taillight_L",
        "body",
        "lightBack.001",
    ]
    found = {what: np.flatnonzero(parts).tolist() for what, parts in named_parts(names).items()}
    assert found == {"glass": [], "wheel": [2], "front": [0, 2], "rear": [1, 4, 6]}


@pytest.mark.assets
@pytest.mark.parametrize("file", QUICK)
def test_whole_vehicles_are_right_as_their_authors_left_them(assets: Path, file: str) -> None:
    found = find_orientation(load_mesh(assets / "full" / file))
    assert (found.front, found.up) == (WHOLE[file], "+Y")


@pytest.mark.assets
@pytest.mark.parametrize(("name", "given"), list(zip(HELD_OUT, ALL[1::8], strict=True)))
def test_held_out_vehicles_are_right_without_names(assets: Path, name: str, given: tuple[str, str]) -> None:
    found = find_orientation(moved(unnamed(load_mesh(assets / "cars" / f"{name}.glb")), *given, scale=100.0))
    assert (found.front, found.up) == given


@pytest.mark.assets
@pytest.mark.parametrize("name", OUTSIDERS)
def test_a_miss_is_unsure(assets: Path, name: str) -> None:
    found = find_orientation(load_mesh(assets / "cars" / f"{name}.glb"))
    assert found.up == "+Y"
    assert found.front == "+Z" or not found.front_sure


@pytest.mark.assets
@pytest.mark.parametrize("file", ["cake_unlit.glb", "fox_skin_anim.glb", ONE_WHEELED])
def test_what_does_not_stand_on_wheels_is_unsure(assets: Path, file: str) -> None:
    found = find_orientation(load_mesh(assets / "full" / file))
    assert (found.front, found.up, found.front_sure, found.up_sure) == ("+Z", "+Y", False, False)
