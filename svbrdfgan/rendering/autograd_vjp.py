"""`render_vjp` of a renderer that is written in differentiable torch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Environment, Gradients, Material, Materials, View


def autograd_vjp(
    picture: Callable[[Materials, View], Float[Tensor, "height width 3"]],
    materials: Materials,
    view: View,
    grad_image: Float[Tensor, "height width 3"],
    *,
    wrt: frozenset[str],
) -> Gradients:
    """The gradient of sum(image * grad_image), by torch's own differentiation of `picture`.

    Gradients are float32 on the picture's device. Memory holds the graph of the whole picture. Drawn directions must be
    constants of that graph.

    Args:
        picture: the image as a differentiable function of the materials' maps and the environment's radiance.
    """
    radiance = _leaf(view.environment.radiance, "environment" in wrt)
    maps = [{name: _leaf(value, name in wrt) for name, value in part.maps.items()} for part in materials.parts]
    with torch.enable_grad():
        lit = replace(view, environment=Environment(radiance, view.environment.rotation))
        image = picture(Materials(tuple(map(Material, maps))), lit)
    leaves = [value for value in (radiance, *(v for part in maps for v in part.values())) if value.requires_grad]
    if leaves and image.requires_grad:
        image.backward(grad_image.detach().to(image), inputs=leaves)
    parts = tuple({name: _gradient(v, image.device) for name, v in part.items() if name in wrt} for part in maps)
    return Gradients(parts, _gradient(radiance, image.device) if "environment" in wrt else None)


def _leaf(value: Tensor, differentiated: bool) -> Tensor:
    """A copy apart from the caller's tensor, so that neither its graph nor its `.grad` is touched."""
    return value.detach().clone().requires_grad_(differentiated)


def _gradient(leaf: Tensor, device: torch.device) -> Tensor:
    return (torch.zeros_like(leaf) if leaf.grad is None else leaf.grad).to(device, torch.float32)
