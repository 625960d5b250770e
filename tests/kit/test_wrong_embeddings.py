"""The kit of UV embeddings catches each of these wrong ones, by the test meant for it and by no other."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from svbrdfgan_hemispherical import HemisphericalEmbedding

from svbrdfgan.errors import EmbeddingError
from svbrdfgan.geometry.normals import corner_normals, face_areas, face_normals
from svbrdfgan.geometry.split import surface_from_corners
from svbrdfgan.geometry.subdivide import Pieces
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.testing.embedding import UVEmbeddingTests
from svbrdfgan.testing.embedding.meshes import own_uv
from svbrdfgan.testing.kit import Outcome, run_kit
from svbrdfgan.types import Mesh, Part, Surface

WRONG: dict[str, list[type]] = {}
"""The wrong embeddings, by the test that is to catch them."""


@dataclass(frozen=True)
class Projected:
    """A right one that cuts faces, and has layers."""

    capabilities: ClassVar[UVCapabilities] = HemisphericalEmbedding.capabilities

    def embed(self, mesh: Mesh) -> Surface:
        return self.change(HemisphericalEmbedding(resolution=8).embed(mesh), mesh)

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return surface


@dataclass(frozen=True)
class Atlas:
    """A right one that is one-to-one: a triangle of the square for each face, whatever its shape."""

    capabilities: ClassVar[UVCapabilities] = UVCapabilities(injective=True, subdivides=False)

    def embed(self, mesh: Mesh) -> Surface:
        surface = surface_from_corners(
            Pieces.whole(mesh.positions, mesh.faces),
            normals=corner_normals(mesh.positions, mesh.faces),
            uv=self.uv(len(mesh.faces)),
            elevation=np.zeros((len(mesh.faces), 3)),
            face_part=mesh.face_part,
            parts=mesh.parts,
        )
        return self.change(surface, mesh)

    def uv(self, faces: int) -> np.ndarray:
        return own_uv(faces)

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return surface


@dataclass(frozen=True)
class Tiled(Atlas):
    """A right one whose left border meets its right one."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, repeat=(True, False))


RIGHT = (Projected, Atlas, Tiled)


def caught_by(test: str) -> Callable[[type], type]:
    def note(wrong: type) -> type:
        WRONG.setdefault(test, []).append(wrong)
        return wrong

    return note


def outcomes(embedding: type, only: str = "") -> Iterator[Outcome]:
    class Kit(UVEmbeddingTests):
        def make_embedding(self) -> Any:
            return embedding()

    return run_kit(Kit, only)


@pytest.mark.full
def test_right_ones_pass_and_each_test_judges_one_of_them() -> None:
    found = [outcome for embedding in RIGHT for outcome in outcomes(embedding)]
    assert [f"{o.name}: {o.message}" for o in found if o.status == "failed"] == []
    unjudged = {o.name for o in found} - {o.name for o in found if o.status == "passed"}
    assert unjudged == {"test_its_entry_point_finds_it"}


# Contract


@caught_by("test_is_an_embedding")
class LookAlike(Projected):
    capabilities = namedtuple("Capabilities", "injective subdivides")(False, True)  # type: ignore[assignment]


@caught_by("test_options_have_types_and_defaults")
class UntypedOption(Projected):
    def __init__(self, margin=0.0):  # type: ignore[no-untyped-def]
        pass


@caught_by("test_embed_takes_a_mesh")
class AnotherParameter(Projected):
    def embed(self, model: Mesh) -> Surface:  # type: ignore[override]
        return super().embed(model)


@caught_by("test_capabilities_are_constant")
@dataclass(frozen=True)
class FindsOutLater(Projected):
    used: list[bool] = field(default_factory=list)

    @property
    def capabilities(self) -> UVCapabilities:  # type: ignore[override]
        return UVCapabilities(injective=False, subdivides=not self.used)

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        self.used.append(True)
        return surface


@caught_by("test_surfaces_are_float64_and_int64")
class SinglePrecision(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=surface.uv.astype(np.float32))


@caught_by("test_surfaces_are_float64_and_int64")
class ShortIndices(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, faces=surface.faces.astype(np.int32))


@caught_by("test_is_a_pure_function_of_the_mesh")
@dataclass(frozen=True)
class Remembers(Projected):
    past: list[float] = field(default_factory=list)

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        self.past.append(1e-9)
        return replace(surface, elevation=surface.elevation + sum(self.past))


@caught_by("test_random_seeds_of_the_caller_do_not_matter")
class Jitters(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        chance = np.random.RandomState(np.random.get_state()[1][0])  # type: ignore[index]
        return replace(surface, uv=np.clip(surface.uv + 1e-9 * chance.rand(*surface.uv.shape), 0, 1))


@caught_by("test_random_generators_are_left_alone")
class Seeds(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        np.random.seed(7)
        return surface


@caught_by("test_leaves_the_mesh_as_it_was")
class RecentresTheMesh(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        mesh.positions[:] -= mesh.bounds.mean(axis=0)
        return surface


@caught_by("test_settings_of_torch_and_numpy_are_left_alone")
class SilencesNumPy(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        np.seterr(invalid="ignore")
        return surface


@caught_by("test_it_pickles")
class HoldsAFunction(Projected):
    def __init__(self) -> None:
        object.__setattr__(self, "rule", lambda mesh: mesh)


@caught_by("test_its_repr_is_one_line")
class Nameless(Projected):
    __repr__ = object.__repr__


# The surface


@caught_by("test_uv_lies_in_the_unit_square")
class LeavesTheSquare(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=1.2 * surface.uv)


@caught_by("test_pieces_lie_in_their_source_faces")
class ReachesOutside(Projected):
    """Only where it moves nothing: in faces whose corners coincide."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        barycentric = surface.source_barycentric.copy()
        barycentric[~np.ptp(surface.positions[surface.faces], axis=1).any(axis=1)] = [2.0, -1.0, 0.0]
        return replace(surface, source_barycentric=barycentric)


@caught_by("test_positions_are_the_meshs")
class Normalises(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, positions=surface.positions / np.ptp(mesh.bounds, axis=0).max())


@caught_by("test_pieces_keep_the_winding")
class TurnsOver(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        flipped = surface.source_barycentric[:, ::-1]
        return replace(surface, faces=surface.faces[:, ::-1], source_barycentric=flipped)


@caught_by("test_pieces_cover_every_face_once")
class LosesAPiece(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return only(surface, np.arange(len(surface.faces)) != 3)


@caught_by("test_pieces_cover_every_face_once")
class DoublesAPiece(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return only(surface, np.append(np.arange(len(surface.faces)), 3))


@caught_by("test_faces_are_cut_only_if_declared")
class CutsInSecret(Projected):
    capabilities = UVCapabilities(injective=False, subdivides=False)


@caught_by("test_parts_are_the_meshs")
class Renames(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        last = len(surface.parts) - 1
        return replace(surface, parts=surface.parts[::-1], face_part=last - surface.face_part)


@caught_by("test_parts_are_the_meshs")
class AddsAPart(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, parts=(*surface.parts, Part("seam")))


@caught_by("test_each_piece_has_its_faces_part")
class MovesAFace(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        if len(mesh.parts) == 1:
            return surface
        split = separate(surface)
        face_part = split.face_part.copy()
        face_part[0] = (face_part[0] + 1) % len(mesh.parts)
        return replace(split, face_part=face_part)


@caught_by("test_no_vertex_serves_two_parts")
class SharesVertices(Projected):
    def embed(self, mesh: Mesh) -> Surface:
        plain = replace(mesh, face_part=np.zeros_like(mesh.face_part), parts=(Part("all"),))
        surface = super().embed(plain)
        return replace(surface, face_part=mesh.face_part[surface.source_face], parts=mesh.parts)


@caught_by("test_normals_have_length_one")
class LongNormals(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, normals=1.01 * surface.normals)


@caught_by("test_normals_are_those_of_the_core")
class Faceted(Projected):
    """Geometric normals, in place of smooth ones."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        split = separate(surface)
        flat = np.repeat(face_normals(split.positions, split.faces), 3, axis=0)
        return replace(split, normals=np.where(flat.any(axis=1)[:, None], flat, split.normals))


@caught_by("test_normals_are_those_of_the_core")
class NormalsAfterCutting(Projected):
    """The rule of the core, applied to the pieces in place of the mesh."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        positions, weld = np.unique(surface.positions, axis=0, return_inverse=True)
        faces = weld.reshape(-1)[surface.faces]
        return replace(separate(surface), normals=corner_normals(positions, faces).reshape(-1, 3))


@caught_by("test_elevation_is_zero_where_one_to_one")
class NeedlessElevation(Atlas):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, elevation=surface.positions[:, 1])


# The map


@caught_by("test_the_square_is_used")
class Shrinks(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=0.3 * surface.uv)


@caught_by("test_one_to_one_means_no_overlap")
class Stacks(Atlas):
    """Every fourth face under another."""

    def uv(self, faces: int) -> np.ndarray:
        corners = own_uv(faces)
        corners[3::4] = corners[1::4][: len(corners[3::4])]
        return corners


@caught_by("test_one_to_one_means_no_face_collapses")
class Collapses(Atlas):
    def uv(self, faces: int) -> np.ndarray:
        corners = own_uv(faces)
        corners[::10, 1:] = corners[::10, :1]
        return corners


@caught_by("test_small_faces_keep_an_area")
class DropsSmallFaces(Projected):
    """Faces of less than a hundred-millionth of the surface are left out."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        area = face_areas(mesh.positions, mesh.faces)[surface.source_face]
        return only(surface, (area == 0.0) | (area > 1e-8 * area.sum()))


@caught_by("test_small_faces_keep_an_area")
class RoundsUVs(Projected):
    """UVs are those of the corners of 65,536 x 65,536 texels."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=np.round(surface.uv * 65536.0) / 65536.0)


@caught_by("test_outer_faces_are_not_mirrored")
class Mirrors(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=surface.uv * (-1, 1) + (1, 0))


@caught_by("test_no_face_is_smeared_across_the_square")
class JoinsTheSeam(Projected):
    """The lowest face, under all others, reaches from one border to the other."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        split = separate(surface)
        lowest = np.argmin(split.positions[split.faces, 1].sum(axis=1))
        uv, elevation = split.uv.copy(), split.elevation.copy()
        uv[split.faces[lowest]] = [[0.01, 0.4], [0.99, 0.4], [0.99, 0.42]]
        elevation[split.faces[lowest]] = -1.0
        return replace(split, uv=uv, elevation=elevation)


@caught_by("test_outer_sides_lie_on_top")
class UpsideDown(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, elevation=-surface.elevation)


@caught_by("test_what_encloses_lies_on_top")
class PartByPart(Projected):
    """Elevation starts anew in each part."""

    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        part = mesh.face_part[surface.source_face]
        split = separate(surface)
        return replace(split, elevation=split.elevation - 10 * np.repeat(part, 3))


@caught_by("test_place_and_size_do_not_matter")
class ThinksInMetres(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=surface.uv * (0.9 if np.ptp(mesh.bounds) > 10 else 1.0))


@caught_by("test_place_and_size_do_not_matter")
class ThinksOfTheOrigin(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=surface.uv * (0.9 if np.abs(mesh.bounds.mean(axis=0)[0]) > 5 else 1.0))


@caught_by("test_unused_vertices_do_not_count")
class CountsAllVertices(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        unused = np.abs(mesh.positions).max() > 2 * np.abs(mesh.bounds).max()
        return replace(surface, uv=surface.uv * (0.9 if unused else 1.0))


@caught_by("test_textures_repeat_only_where_the_map_does")
class Repeats(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        return replace(surface, uv=0.1 + 0.8 * surface.uv, repeat=(True, False))


# Robustness, and use


class Refuses(Projected):
    """Raises `error` for some meshes."""

    error: ClassVar[Exception] = ValueError("that is no vehicle")

    def embed(self, mesh: Mesh) -> Surface:
        if self.refuses(mesh):
            raise self.error
        return super().embed(mesh)

    def refuses(self, mesh: Mesh) -> bool:
        raise NotImplementedError


@caught_by("test_a_single_point")
class SaysNothing(Refuses):
    error = EmbeddingError("")

    def refuses(self, mesh: Mesh) -> bool:
        return not np.ptp(mesh.positions)


@caught_by("test_many_parts")
class FewParts(Refuses):
    def refuses(self, mesh: Mesh) -> bool:
        return len(mesh.parts) > 30


@caught_by("test_planes")
class ForgetsPlanes(Refuses):
    error = ZeroDivisionError("float division by zero")

    def refuses(self, mesh: Mesh) -> bool:
        return len(mesh.faces) == 2


@caught_by("test_a_single_triangle")
class AtLeastTwoFaces(Refuses):
    error = IndexError("index 1 is out of bounds")

    def refuses(self, mesh: Mesh) -> bool:
        return len(mesh.faces) == 1 and bool(face_normals(mesh.positions, mesh.faces).any())


@caught_by("test_a_mesh_without_uv")
class NeedsUV(Refuses):
    error = TypeError("'NoneType' object is not subscriptable")

    def refuses(self, mesh: Mesh) -> bool:
        return mesh.uv is None


@caught_by("test_tiny_and_huge_units")
class NotANumber(Projected):
    def change(self, surface: Surface, mesh: Mesh) -> Surface:
        uv = surface.uv.copy()
        uv[0] = 0.5 if np.ptp(mesh.bounds) > 1e-4 else np.nan
        return replace(surface, uv=uv) if np.isnan(uv).any() else surface


@caught_by("test_a_vehicle_can_be_weathered")
class SmallMeshesOnly(Refuses):
    error = EmbeddingError("the mesh has more than 2000 faces; simplify it.")

    def refuses(self, mesh: Mesh) -> bool:
        return len(mesh.faces) > 2000


def only(surface: Surface, faces: np.ndarray) -> Surface:
    """These faces alone."""
    chosen = np.arange(len(surface.faces))[faces]
    names = ("faces", "face_part", "source_face", "source_barycentric")
    return replace(surface, **{name: getattr(surface, name)[chosen] for name in names})


def separate(surface: Surface) -> Surface:
    """Every face with vertices of its own."""
    vertex = surface.faces.ravel()
    names = ("positions", "normals", "uv", "elevation")
    own = {name: getattr(surface, name)[vertex] for name in names}
    return replace(surface, faces=np.arange(len(vertex)).reshape(-1, 3), **own)


each_wrong_one = pytest.mark.parametrize(
    ("test", "wrong"), [(test, wrong) for test, wrongs in WRONG.items() for wrong in wrongs]
)


def failures(wrong: type, only: str = "") -> dict[str, str]:
    with np.errstate():  # which some of them change
        return {o.name: o.message for o in outcomes(wrong, only) if o.status == "failed"}


@each_wrong_one
def test_each_wrong_one_is_caught_by_its_test(test: str, wrong: type) -> None:
    assert test in failures(wrong, f".{test}")


@pytest.mark.full
@each_wrong_one
def test_each_wrong_one_is_caught_by_its_test_alone(test: str, wrong: type) -> None:
    failed = failures(wrong)
    assert list(failed) == [test], failed
