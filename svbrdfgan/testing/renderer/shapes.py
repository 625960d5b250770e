"""Sizes, shapes, dtypes, devices and ranges of inputs and results."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.testing.renderer.statistical_assertions import exactly
from svbrdfgan.testing.statistics import numbers
from svbrdfgan.types import CHANNELS, Environment, Gradients, Material, Materials, TransportSamples, View

WHITE = scenes.lambertian((1.0, 1.0, 1.0))


class ShapeTests(RendererKit):
    """Films, textures, environments and transports of any size; inputs of any dtype, layout and device."""

    def test_pictures_are_shaped_as_the_film(self) -> None:
        """Image and coverage are float32, shaped as the film, on its device."""
        prepared = self.renderer.prepare(scenes.sphere())
        for width, height in ((16, 9), (9, 16), (1, 1), (7, 1), (1, 5)):
            view = scenes.front_view(scenes.random_light(), width=width, height=height)
            rendering = self.renderer.render(prepared, WHITE, view, spp=2, seed=0)
            _check_tensor(self, "image", rendering.image, (height, width, 3))
            _check_tensor(self, "coverage", rendering.coverage, (height, width))

    def test_pixels_are_in_their_rows(self) -> None:
        """On wide and on tall films a square in the middle is in one piece."""
        for width, height in ((16, 8), (8, 16)):
            view = scenes.front_view(scenes.constant_light(), 1.0, width, height, 2.0 * math.atan(0.5))
            image = numbers(self.render(scenes.plane(4 / height), WHITE, view, spp=64).image).sum(axis=-1)
            shown, wanted = image > 0.4 * image.max(), np.zeros((height, width), dtype=bool)
            wanted[height // 2 - 2 : height // 2 + 2, width // 2 - 2 : width // 2 + 2] = True
            message = (
                f"On {width} x {height} pixels a square of 4 x 4 in the middle is torn, as if rows had another length"
            )
            check(bool((shown == wanted).all()), f"{message}: what is seen is\n{shown.astype(int)}")

    def test_values_are_in_range(self) -> None:
        """Radiance is finite, coverage in [0, 1], the image zero where that is."""
        view = scenes.front_view(scenes.random_light(), width=20, height=20)
        for surface in (scenes.sphere(), scenes.bowl()):
            rendering = self.render(surface, WHITE, view, spp=3)
            image, coverage = numbers(rendering.image), numbers(rendering.coverage)
            check(bool(np.isfinite(image).all()), f"{(~np.isfinite(image)).sum()} radiances are not finite.")
            check(image.min() >= 0.0, f"radiance goes down to {image.min():.3g}.")
            check(
                coverage.min() >= 0.0 and coverage.max() <= 1.0, f"coverage is in [{coverage.min()}, {coverage.max()}]."
            )
            check(
                not image[coverage == 0.0].any(), "the image is not zero where coverage is: is the environment in it?"
            )

    def test_a_surface_out_of_sight_is_nothing(self) -> None:
        """What lies behind the camera has no picture and no gradient."""
        behind = scenes.quad((0.0, 0.0, 9.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        view, prepared = scenes.front_view(scenes.random_light(), width=6, height=4), self.renderer.prepare(behind)
        rendering = self.renderer.render(prepared, WHITE, view, spp=2, seed=0)
        check(
            not rendering.image.any() and not rendering.coverage.any(), "what is behind the camera is in the picture."
        )
        gradients = _gradients(self, behind, WHITE, view)
        tensors = [value for part in gradients.materials for value in part.values()]
        check(not any(value.any() for value in tensors), "what is behind the camera has a gradient.")

    def test_any_number_of_samples_will_do(self) -> None:
        """1, 3, 7 and 100 samples per pixel cover what fills the film."""
        prepared, view = (
            self.renderer.prepare(scenes.plane(2.0)),
            scenes.front_view(scenes.random_light(), 1.0, 7, 5, 0.4),
        )
        for spp in (1, 3, 7, 100):
            coverage = self.renderer.render(prepared, WHITE, view, spp=spp, seed=0).coverage
            off = float((coverage - 1.0).abs().max())
            check(off < 1e-5, f"With {spp} samples per pixel, coverage of a filled film is off by {off:.2g}.")

    def test_many_parts(self) -> None:
        """A surface of forty parts has forty materials and forty gradients, each in its place."""
        strips = [scenes.quad((0.05 * i - 1.0, -1.0, 0.0), (0.05, 0.0, 0.0), (0.0, 2.0, 0.0)) for i in range(40)]
        colors = scenes.random_texture(1, 40)[0]
        maps = [color.expand(1 + i % 7, 1 + i % 5, 3) if i % 3 else color for i, color in enumerate(colors)]
        view = scenes.front_view(scenes.random_light(), 1.0, 40, 4, 2.0 * math.atan(0.1))
        surface, materials = scenes.joined(*strips), scenes.lambertian(*maps)
        rendering, white = (self.render(surface, m, view, spp=2) for m in (materials, Materials(WHITE.parts * 40)))
        check(float(rendering.coverage.min()) > 0.999, "a surface of forty strips has gaps.")
        each = numbers(white.image).sum(axis=0)
        shown = numbers(rendering.image).sum(axis=0)
        exactly("the picture of forty strips, by columns,", shown, each * numbers(colors))
        gradients = _gradients(self, surface, materials, view)
        _check_gradients(self, gradients, materials, view)
        if "base_color" in self.capabilities.differentiable:
            found = [numbers(part["base_color"]).reshape(-1, 3).sum(axis=0) for part in gradients.materials]
            exactly("the gradient of forty strips, by parts,", np.stack(found), each)

    def test_gradients_are_shaped_as_the_maps(self) -> None:
        """Gradients are float32 and shaped as their maps, on its device."""
        surface = scenes.joined(
            *(scenes.quad((x, -1.0, 0.0), (0.5, 0.0, 0.0), (0.0, 2.0, 0.0)) for x in (-1.0, -0.5, 0.0, 0.5))
        )
        shapes: tuple[tuple[int, ...], ...] = ((), (3, 8), (1, 1), (5, 2))
        materials = Materials(tuple(_material(self, shape) for shape in shapes))
        for rows, cols in ((8, 16), (1, 1), (3, 5)):
            view = scenes.front_view(scenes.random_light(rows, cols), width=7, height=5)
            _check_gradients(self, _gradients(self, surface, materials, view), materials, view)

    def test_inputs_may_have_any_dtype_and_layout(self) -> None:
        """Textures, light and grad_image may be float64, transposed or strided."""
        texture, light = scenes.random_texture(6, 4), scenes.random_light()
        view = scenes.front_view(light, 1.0, 6, 4, 0.5)
        plain = _results(self, texture, view, torch.ones(4, 6, 3))
        for what, form in _FORMS.items():
            odd = dataclasses.replace(view, environment=Environment(form(light.radiance)))
            found = _results(self, form(texture), odd, form(torch.ones(4, 6, 3)))
            for name, a, b in zip(("image", "gradient"), plain, found, strict=True):
                off = float((a - b).abs().max() / a.abs().max())
                check(off < 1e-4, f"Where inputs are {what}, the {name} is off by {off:.2g} of its maximum.")

    def test_inputs_may_live_anywhere(self) -> None:
        """Tensors on CPU and GPU are taken alike; results are on its device."""
        declared(torch.cuda.is_available(), "a GPU on this machine")
        for device in ("cpu", "cuda"):
            view = scenes.front_view(Environment(scenes.random_light().radiance.to(device)), 1.0, 6, 4, 0.5)
            for result in _results(
                self, scenes.random_texture(6, 4).to(device), view, torch.ones(4, 6, 3, device=device)
            ):
                check(_there(self, result), f"of inputs on {device}, a result is on {result.device}.")

    def test_surfaces_may_have_any_layout(self) -> None:
        """A surface's arrays may be strided, read-only or in Fortran's order."""
        surface, view = scenes.sphere(), scenes.front_view(scenes.random_light(), width=6, height=4)
        names = ("positions", "normals", "uv", "faces", "face_part")
        plain = self.render(surface, WHITE, view, spp=2).image
        for what, form in (("strided", _strided), ("in Fortran's order", np.asfortranarray), ("read-only", _read_only)):
            arrays: dict[str, Any] = {name: form(getattr(surface, name)) for name in names}
            image = self.render(dataclasses.replace(surface, **arrays), WHITE, view, spp=2).image
            check(torch.equal(plain, image), f"Where the surface's arrays are {what}, the picture differs.")

    def test_transport_is_typed_and_in_range(self) -> None:
        """Transport samples name pixels and parts that exist, uv in [0, 1]."""
        for view, samples in _transport(self, scenes.random_light()):
            count = len(samples.pixel)
            for name, value in (("pixel", samples.pixel), ("part", samples.part)):
                integer = not value.is_floating_point() and value.shape == (count,) and _there(self, value)
                check(
                    integer,
                    f"{name} is {value.dtype} {tuple(value.shape)} on {value.device}; wanted ({count},) integers.",
                )
            _check_tensor(self, "uv", samples.uv, (count, 2))
            _check_tensor(self, "weight", samples.weight, (count, 3))
            check(
                bool(((samples.pixel >= 0) & (samples.pixel < view.width * view.height)).all()),
                "there are samples off the film.",
            )
            check(
                bool(((samples.part >= 0) & (samples.part < 2)).all()), "there are samples of parts that do not exist."
            )
            check(bool(((samples.uv > -1e-5) & (samples.uv < 1.0 + 1e-5)).all()), "there are uv outside [0, 1].")
            check(bool((samples.weight >= 0.0).all()), "there are weights that are negative or not a number.")

    def test_transport_has_a_record_for_each_sample_that_met_the_surface(self) -> None:
        """Transport records per sample are the coverage, in the dark as well."""
        for light in (scenes.random_light(), scenes.constant_light(0.0)):
            chunks = list(_transport(self, light))
            view = chunks[0][0]
            counts = sum(torch.bincount(s.pixel.cpu(), minlength=view.width * view.height) for _, s in chunks)
            coverage = self.render(scenes.two_parts(), Materials(WHITE.parts * 2), view, spp=3, seed=2).coverage.cpu()
            off = float((torch.as_tensor(counts).reshape(coverage.shape) / 3 - coverage).abs().max())
            check(off < 1e-5, f"records per sample are off from the coverage by up to {off:.3g} in a pixel.")


def _transport(kit: RendererKit, light: Environment) -> Iterator[tuple[View, TransportSamples]]:
    declared(kit.capabilities.transport, "transport")
    renderer, view = kit.renderer, scenes.front_view(light, width=9, height=5)
    transport = getattr(renderer, "transport")  # noqa: B009 - a declared power, not in every Renderer's type
    for samples in transport(renderer.prepare(scenes.two_parts()), view, spp=3, seed=2):
        yield view, samples


def _material(kit: RendererKit, shape: tuple[int, ...]) -> Material:
    """A material with every map that the renderer reads, each of these rows and columns, or constant."""
    return Material({name: torch.full((*shape, CHANNELS[name]), 0.5) for name in sorted(kit.capabilities.maps)})


def _gradients(kit: RendererKit, surface: scenes.Surface, materials: Materials, view: View) -> Gradients:
    ones, wrt = torch.ones(view.height, view.width, 3), kit.capabilities.differentiable
    return kit.renderer.render_vjp(kit.renderer.prepare(surface), materials, view, ones, wrt=wrt, spp=2, seed=0)


def _check_gradients(kit: RendererKit, gradients: Gradients, materials: Materials, view: View) -> None:
    check(
        len(gradients.materials) == len(materials),
        f"gradients for {len(gradients.materials)} of {len(materials)} parts.",
    )
    for part, (found, material) in enumerate(zip(gradients.materials, materials.parts, strict=True)):
        for name in found:
            _check_tensor(kit, f"gradient of part {part}'s {name}", found[name], tuple(material.maps[name].shape))
    if gradients.environment is not None:
        _check_tensor(kit, "gradient of the environment", gradients.environment, tuple(view.environment.radiance.shape))


def _check_tensor(kit: RendererKit, what: str, value: Tensor, shape: tuple[int, ...]) -> None:
    check(tuple(value.shape) == shape, f"{what} has shape {tuple(value.shape)}; wanted {shape}.")
    check(value.dtype == torch.float32, f"{what} is {value.dtype}; wanted torch.float32.")
    check(_there(kit, value), f"{what} is on {value.device}; wanted {kit.renderer.device}.")


def _there(kit: RendererKit, value: Tensor) -> bool:
    """Whether a result is on the renderer's device, which may be named without an index."""
    found, wanted = value.device, kit.renderer.device
    return found.type == wanted.type and (found.index == wanted.index or None in (found.index, wanted.index))


def _results(kit: RendererKit, texture: Tensor, view: View, grad_image: Tensor) -> list[Tensor]:
    """Picture and base colour's gradient of a textured plane."""
    prepared, materials = kit.renderer.prepare(scenes.plane(2.0)), Materials((Material({"base_color": texture}),))
    results = [kit.renderer.render(prepared, materials, view, spp=2, seed=1).image]
    wrt = frozenset({"base_color"}) & kit.capabilities.differentiable
    gradients = kit.renderer.render_vjp(prepared, materials, view, grad_image, wrt=wrt, spp=2, seed=1)
    return [*results, gradients.materials[0].get("base_color", results[0])]


_FORMS = {
    "float64": lambda t: t.double(),
    "transposed": lambda t: t.transpose(0, 1).contiguous().transpose(0, 1),
    "strided": lambda t: t.repeat_interleave(2, dim=1)[:, ::2],
    "channels first in memory": lambda t: t.permute(2, 0, 1).contiguous().permute(1, 2, 0),
}


def _strided(array: ndarray) -> ndarray:
    return np.repeat(array, 2, axis=0)[::2]


def _read_only(array: ndarray) -> ndarray:
    copy = array.copy()
    copy.flags.writeable = False
    return copy
