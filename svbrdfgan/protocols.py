"""The two interfaces that plugins implement. `docs/conventions.md` fixes the meanings, and `svbrdfgan.testing` judges.

A renderer is a class whose constructor takes typed keyword options, all with defaults, and checks them. It is
registered under the entry-point group `svbrdfgan.renderers`; an embedding under `svbrdfgan.uv_embeddings`.
Rendering is a pure function of its arguments: no global state is read or left changed, and chance enters as `seed`.
What a capability record declares works; anything else raises `UnsupportedError`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Mesh, Rendering, Surface, TransportSamples, View

Prepared = TypeVar("Prepared")


@dataclass(frozen=True)
class RendererCapabilities:
    """What a renderer, as constructed, can do.

    Attributes:
        maps: material maps it reads; others in a material raise.
        differentiable: names accepted in `wrt`: maps, and "environment".
        max_bounces: scattering events on a path. 1 is direct light alone.
        transport: whether it is a `TransportRenderer`.
        pullback: whether it is a `PullbackRenderer`.
        stochastic: whether `seed` matters. A deterministic renderer ignores it.
    """

    maps: frozenset[str] = frozenset({"base_color"})
    differentiable: frozenset[str] = frozenset({"base_color"})
    max_bounces: int = 1
    transport: bool = False
    pullback: bool = False
    stochastic: bool = True


@runtime_checkable
class Renderer(Protocol[Prepared]):
    """Turns a surface, its materials and a view into a picture, and a picture's gradient into theirs."""

    @property
    def capabilities(self) -> RendererCapabilities: ...

    @property
    def device(self) -> torch.device:
        """Where its results live; "cuda" stands for any of its devices. Inputs may live anywhere."""
        ...

    def prepare(self, surface: Surface) -> Prepared:
        """Everything that depends on geometry alone, such as a BVH. Costly; made once for many views."""
        ...

    def render(self, prepared: Prepared, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture, from `spp` camera samples in each pixel. Unbiased for any `spp` and `seed`.

        Raises:
            UnsupportedError: a material has a map that `capabilities.maps` does not name.
            SvbrdfganError: not one material for each part, `spp` below 1, or radiance that is no light;
                `svbrdfgan.rendering.validation` raises all that a renderer is to raise.
        """
        ...

    def render_vjp(
        self,
        prepared: Prepared,
        materials: Materials,
        view: View,
        grad_image: Float[Tensor, "height width 3"],
        *,
        wrt: frozenset[str],
        spp: int,
        seed: int,
    ) -> Gradients:
        """The gradient of sum(image * grad_image): unbiased for any `spp` and `seed`.

        For base_color, given the `spp` and `seed` of a `render`, it is exactly that picture's. Other inputs may decide
        where samples are drawn, as the environment does; there it takes the drawn samples as given.

        Raises:
            UnsupportedError: `wrt` names something that `capabilities.differentiable` does not.
            SvbrdfganError: as `render`, or `grad_image` is not of the view's film.
        """
        ...


@runtime_checkable
class TransportRenderer(Renderer[Prepared], Protocol[Prepared]):
    """A renderer that can also say how the picture depends on the textures: an optional power, for direct light."""

    def transport(self, prepared: Prepared, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples of the picture that `render` makes with the same view, `spp` and `seed`, in chunks.

        What is refused is refused by the call, not by the first chunk.
        """
        ...


Pullback = Callable[[Float[Tensor, "height width 3"]], Gradients]
"""From the gradient of a picture to that of what it was made of; may be called any number of times."""


@runtime_checkable
class PullbackRenderer(Renderer[Prepared], Protocol[Prepared]):
    """A renderer that can keep what it traced, so that picture and gradient take one tracing: an optional power."""

    def render_pullback(
        self, prepared: Prepared, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """What `render` gives, and `render_vjp` with the same arguments, as a function of `grad_image` alone.

        The function does not depend on what is written into materials and light afterwards.
        """
        ...


@dataclass(frozen=True)
class UVCapabilities:
    """What an embedding promises of the surfaces it makes.

    Attributes:
        injective: no two points share a UV coordinate; otherwise inner layers will be found and hidden.
        subdivides: faces may be cut, so that the surface has more of them than the mesh.
    """

    injective: bool
    subdivides: bool


@runtime_checkable
class UVEmbedding(Protocol):
    """Spreads a mesh over the unit UV square."""

    @property
    def capabilities(self) -> UVCapabilities: ...

    def embed(self, mesh: Mesh) -> Surface:
        """The mesh's surface with UVs; a pure function of the mesh.

        Raises:
            EmbeddingError: the mesh cannot be given this embedding, and why.
        """
        ...
