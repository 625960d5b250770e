"""The two interfaces that plugins implement: renderers and UV embeddings.

`docs/conventions.md` defines axes, units and materials; the kits in `svbrdfgan.testing` check an implementation.

A plugin is a class whose constructor takes typed keyword options, all with defaults, and checks them. Renderers are
registered under the entry-point group `svbrdfgan.renderers`, embeddings under `svbrdfgan.uv_embeddings`.
Rendering is a pure function of its arguments. It neither reads nor changes global state, and `seed` alone determines
its random numbers. What a capability record declares must work. The core checks every argument before it calls a
renderer (`svbrdfgan.rendering.checked_renderer`) and calls nothing that is not declared, so a plugin checks nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Mesh, Rendering, Surface, TransportSamples, View

Prepared = TypeVar("Prepared")


@dataclass(frozen=True)
class RendererCapabilities:
    """The abilities of a renderer, with the options that it was constructed with.

    Attributes:
        maps: names of the material maps that it reads; a material with others raises.
        differentiable: names that `wrt` accepts: maps, and "environment".
        max_bounces: most scattering events on a path. 1 is direct light only.
        transport: whether it is a `TransportRenderer`.
        pullback: whether it is a `PullbackRenderer`.
        deferred: whether it is a `DeferredRenderer`.
        stochastic: whether results depend on `seed`.
        alpha: whether rays pass through parts by their `alpha`; without it every part is opaque.
    """

    maps: frozenset[str] = frozenset({"base_color"})
    differentiable: frozenset[str] = frozenset({"base_color"})
    max_bounces: int = 1
    transport: bool = False
    pullback: bool = False
    deferred: bool = False
    stochastic: bool = True
    alpha: bool = False


@runtime_checkable
class Renderer(Protocol[Prepared]):
    """Renders pictures of a surface, and gradients of pictures with respect to materials and light."""

    @property
    def capabilities(self) -> RendererCapabilities:
        """The abilities of the renderer, with its options."""

    @property
    def device(self) -> torch.device:
        """The device of its results; "cuda" stands for any CUDA device. Inputs may be on any device."""

    def prepare(self, surface: Surface) -> Prepared:
        """The data that depends only on geometry, such as a BVH. Costly; callers prepare once for many views."""

    def render(self, prepared: Prepared, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture, from `spp` camera samples per pixel. Unbiased for any `spp` and `seed`.

        `materials` has one material for each part, with maps of `capabilities.maps` alone; `spp` is at least 1, and
        radiance is finite and not negative.
        """

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
        """The gradient of sum(image * grad_image), unbiased for any `spp` and `seed`.

        For base_color it is the exact derivative of the picture that `render` gives for the same `spp` and `seed`.
        Inputs that may determine where samples are drawn, such as the environment and the other maps, are different:
        their gradient treats the drawn samples and their densities as constants.

        `wrt` is a subset of `capabilities.differentiable`. A renderer written in differentiable torch gets this method
        from `svbrdfgan.rendering.autograd_vjp`.
        """


class TransportRenderer(Renderer[Prepared], Protocol[Prepared]):
    """A renderer that can also return how a picture depends on the textures. Optional, and for direct light only."""

    def transport(self, prepared: Prepared, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples of `render`'s picture for the same view, `spp` and `seed`, in chunks."""


Pullback = Callable[[Float[Tensor, "height width 3"]], Gradients]
"""Maps the gradient of a picture to those of its inputs; may be called any number of times."""


class PullbackRenderer(Renderer[Prepared], Protocol[Prepared]):
    """A renderer that can keep its samples, so that picture and gradient need only one trace. Optional."""

    def render_pullback(
        self, prepared: Prepared, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """The result of `render`, and `render_vjp` with the same arguments as a function of `grad_image`.

        Later writes into the tensors of materials and light do not affect the function.
        """


class StoredLight(Protocol):
    """All of a view's picture that does not depend on the materials of its learnable parts; a renderer's own type."""

    @property
    def nbytes(self) -> int:
        """Bytes of memory that keeping it takes."""


class DeferredRenderer(Renderer[Prepared], Protocol[Prepared]):
    """A renderer that stores what camera samples hit and the light there, to shade it again for other materials.

    Optional, and for direct light only. Unlike light transport it serves materials in which pictures are not linear.
    """

    def store_light(
        self, prepared: Prepared, view: View, *, learnable: Sequence[int], hits: int, spp: int, seed: int
    ) -> StoredLight:
        """Traces `spp` camera samples of each pixel, and keeps at most `hits` that hit learnable parts, fairly chosen.

        Later writes into the environment do not affect it.

        Args:
            learnable: numbers of parts of the surface, each at most once, whose materials `shade` will be given.
            hits: at least 1.
        """

    def shade(
        self,
        lights: Sequence[StoredLight],
        textures: Float[Tensor, "textures rows cols channels"],
        *,
        maps: Sequence[str],
        visit: int,
        seed: int,
    ) -> tuple[Float[Tensor, "views height width 3"], Callable[[Tensor], Tensor]]:
        """Pictures of the learnable parts alone, premultiplied; unbiased for any visit and seed.

        Args:
            lights: of views of one film size, from `store_light`.
            textures: of the learnable parts of each view, in the order of `learnable`, view after view.
            maps: what the channels are: base_color first, in the order of `CHANNELS`.
            visit: 0 or more. Stored light is renewed little by little as visits grow, so that its noise cannot be
                learned: eight visits later nothing of it is left. What it is depends on the visit alone, not on those
                before; visits that grow one by one are the fastest.
            seed: of what is drawn anew for each picture, of each view by itself.

        Returns:
            The pictures, and a function from their gradient to that of the textures, on the same samples. As with
            `render_vjp`, drawn directions and densities are constants. Later calls of `shade`, and later writes into
            the textures, do not affect the function.
        """


@dataclass(frozen=True)
class UVCapabilities:
    """The properties that an embedding guarantees of its surfaces.

    Attributes:
        injective: no two points share a UV coordinate. If false, the caller finds and hides inner layers.
        subdivides: whether faces may be cut, so that the surface has more of them than the mesh.
    """

    injective: bool
    subdivides: bool


@runtime_checkable
class UVEmbedding(Protocol):
    """Maps a mesh onto the unit UV square."""

    @property
    def capabilities(self) -> UVCapabilities:
        """The properties of every surface that the embedding makes."""

    def embed(self, mesh: Mesh) -> Surface:
        """The mesh's surface with UVs; a pure function of the mesh.

        Raises:
            EmbeddingError: this mesh has no such embedding; the message says why.
        """
