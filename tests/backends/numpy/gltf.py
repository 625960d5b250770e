"""An independent implementation of glTF 2.0's material (appendix B), and its directional albedo by quadrature."""

from __future__ import annotations

import functools

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import Material

Vectors = Float[ndarray, "_ 3"]


def bsdf(
    view: Vectors, light: Vectors, base_color: float, roughness: float, metallic: float = 0.0
) -> Float[ndarray, " _"]:
    """f for a surface that faces +Z: mix(dielectric_brdf, metal_brdf, metallic) of the specification."""
    return diffuse(view, light, base_color, metallic) + specular(view, light, base_color, roughness, metallic)


def diffuse(view: Vectors, light: Vectors, base_color: float, metallic: float) -> Float[ndarray, " _"]:
    """The diffuse_brdf in fresnel_mix, which metals lack."""
    return (1.0 - metallic) * (1.0 - _fresnel(view, light, 0.04)) * base_color / np.pi


def specular(
    view: Vectors, light: Vectors, base_color: float, roughness: float, metallic: float
) -> Float[ndarray, " _"]:
    """The specular_brdf in fresnel_mix, and in conductor_fresnel."""
    h = _half(view, light)
    g = _masking(view[:, 2], roughness) * _masking(light[:, 2], roughness)
    facets = _distribution(h[:, 2], roughness) * g / (4.0 * np.abs(view[:, 2]) * np.abs(light[:, 2]))
    dielectric, metal = _fresnel(view, light, 0.04), _fresnel(view, light, base_color)
    return ((1.0 - metallic) * dielectric + metallic * metal) * facets


@functools.cache
def albedo(cosine: float, base_color: float, roughness: float, metallic: float = 0.0, nodes: int = 400) -> float:
    """The radiance reflected in uniform light of radiance 1, seen at an angle to the normal.

    The diffuse share by a grid of directions of equal n.l, the gloss by one of half vectors of equal D n.h.
    """
    view, middle = direction(cosine), (np.arange(nodes) + 0.5) / nodes
    below = diffuse(view, _grid(middle), base_color, metallic) * np.pi
    half = _grid(middle * roughness**4 / (1.0 + (roughness**4 - 1.0) * middle))
    v_h = half @ view[0]
    light = 2.0 * v_h[:, None] * half - view
    front = light[:, 2] > 0.0
    view, half, light, v_h = np.broadcast_to(view, light.shape)[front], half[front], light[front], v_h[front]
    jacobian = 4.0 * v_h / (_distribution(half[:, 2], roughness) * half[:, 2])
    gloss = specular(view, light, base_color, roughness, metallic) * light[:, 2] * jacobian
    return float(below.mean() + gloss.sum() / len(front))


def direction(cosine: float) -> Float[ndarray, "1 3"]:
    """The unit direction in the XZ plane, on the side of +X, at an angle to +Z."""
    return np.array([[np.sqrt(1.0 - cosine**2), 0.0, cosine]])


def glossy(base_color: Tensor | tuple[float, ...], roughness: Tensor | float, **maps: Tensor | float) -> Material:
    """A material with gloss; numbers are constants."""
    named = {"base_color": torch.as_tensor(base_color), "roughness": roughness, **maps}
    tensors = {name: torch.as_tensor(value) for name, value in named.items()}
    return Material({name: value.reshape(1) if value.ndim == 0 else value for name, value in tensors.items()})


def _grid(sine2: Float[ndarray, " nodes"]) -> Vectors:
    """Directions about +Z of these squared sines, on as many half-planes of positive y (the view lies in y = 0)."""
    azimuth = np.pi * (np.arange(len(sine2)) + 0.5) / len(sine2)
    sine, azimuth = (a.ravel() for a in np.meshgrid(np.sqrt(sine2), azimuth))
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.sqrt(1.0 - sine**2)], axis=-1)


def _half(view: Vectors, light: Vectors) -> Vectors:
    return (view + light) / np.linalg.norm(view + light, axis=-1, keepdims=True)


def _fresnel(view: Vectors, light: Vectors, at_normal: float) -> Float[ndarray, " _"]:
    return at_normal + (1.0 - at_normal) * (1.0 - np.abs((view * _half(view, light)).sum(axis=-1))) ** 5


def _distribution(n_h: Float[ndarray, " _"], roughness: float) -> Float[ndarray, " _"]:
    alpha2 = roughness**4
    return alpha2 / (np.pi * (n_h**2 * (alpha2 - 1.0) + 1.0) ** 2)


def _masking(cosine: Float[ndarray, " _"], roughness: float) -> Float[ndarray, " _"]:
    alpha2, cosine = roughness**4, np.abs(cosine)
    return 2.0 * cosine / (cosine + np.sqrt(alpha2 + (1.0 - alpha2) * cosine**2))
