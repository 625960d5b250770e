"""Warp functions: the whole material of `docs/conventions.md` at a point, its derivatives, and directions drawn by it.

Value means the BSDF times n . w_i: `q * base_color + c`, with c the same for all colours:
q = (1 - m) (1 - F_d) (n . w_i) / pi + m (1 - p) L, c = ((1 - m) F_d + m p) L,
L = D g(n . w_i) g(n . w_o) (n . w_i) / 4, g(x) = 2 / (x + sqrt(a2 + (1 - a2) x^2)), where a2 is alpha^2.
Where the visible normals of GGX are drawn, the density of w_i is D g(n . w_o) / 4, so neither divides by n . w_o.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS
from svbrdfgan_warp import rng

wp.set_module_options({"enable_backward": False})

F0 = wp.constant(DIELECTRIC_REFLECTANCE)
LEAST = wp.constant(LEAST_ROUGHNESS)


@wp.struct
class SurfaceMaterial:
    normal: wp.vec3  # tilted and bent
    base_color: wp.vec3
    metallic: wp.float32
    alpha2: wp.float32  # the square of GGX's alpha; 0 for a Lambertian part


@wp.struct
class MaterialGradient:
    normal: wp.vec3
    base_color: wp.vec3
    metallic: wp.float32
    alpha2: wp.float32


@wp.struct
class Microfacets:
    """The terms of a pair of directions that depend on the vector halfway between them."""

    cosine: wp.float32  # n . h
    sine2: wp.float32  # 1 - (n . h)^2
    spread: wp.float32  # a2 (n . h)^2 + 1 - (n . h)^2
    distribution: wp.float32  # D
    fresnel: wp.float32  # p = (1 - w_o . h)^5


@wp.func
def alpha2_of(roughness: float):
    """The square of alpha, for roughness in [0, 1] after bounding."""
    bounded = wp.clamp(roughness, LEAST, 1.0)
    return bounded * bounded * bounded * bounded


@wp.func
def alpha2_slope(roughness: float):
    """The derivative of `alpha2_of`, zero beyond the bounds."""
    if roughness < LEAST or roughness > 1.0:
        return 0.0
    return 4.0 * roughness * roughness * roughness


@wp.func
def microfacets(n: wp.vec3, alpha2: float, outgoing: wp.vec3, incoming: wp.vec3):
    total = outgoing + incoming
    length2 = wp.max(wp.dot(total, total), 1.0e-12)  # opposite directions add up to nothing
    across = wp.cross(n, total)  # 1 - (n . h)^2 as a difference would lose the peak of a smooth surface in float32
    along = wp.dot(n, total)
    half = Microfacets()
    half.cosine = along / wp.sqrt(length2)
    half.sine2 = wp.dot(across, across) / length2
    half.spread = alpha2 * along * along / length2 + half.sine2
    half.distribution = alpha2 / (wp.pi * half.spread * half.spread)
    x = wp.max(1.0 - 0.5 * wp.sqrt(length2), 0.0)  # w_o . h is half the length of w_o + w_i
    half.fresnel = x * x * x * x * x
    return half


@wp.func
def smith_root(alpha2: float, cosine: float):
    return wp.sqrt(alpha2 + (1.0 - alpha2) * cosine * cosine)


@wp.func
def smith(alpha2: float, cosine: float):
    """Smith's masking over the cosine, g."""
    return 2.0 / (cosine + smith_root(alpha2, cosine))


@wp.func
def gloss_share(material: SurfaceMaterial, outgoing: wp.vec3):
    """The probability of drawing a direction from the gloss instead of the cosine.

    The share is large, since the emitter's samples serve the diffuse part well: on spheres under a small sun, 0.7 had
    0.7 to 1 of the noise of 0.5. Some directions always come from the cosine, for the gradient of light where it is
    black.
    """
    if material.alpha2 == 0.0 or wp.dot(material.normal, outgoing) < 0.0:
        return 0.0
    return 0.7 + 0.2 * material.metallic


@wp.func
def density(material: SurfaceMaterial, outgoing: wp.vec3, incoming: wp.vec3):
    """The density per steradian with which `sample` draws an incoming direction in front of the surface."""
    diffuse = wp.dot(material.normal, incoming) / wp.pi
    share = gloss_share(material, outgoing)
    if share == 0.0:
        return diffuse
    half = microfacets(material.normal, material.alpha2, outgoing, incoming)
    masking = smith(material.alpha2, wp.max(wp.dot(material.normal, outgoing), 0.0))
    return (1.0 - share) * diffuse + share * half.distribution * masking / 4.0


@wp.func
def visible_normal(n: wp.vec3, alpha: float, outgoing: wp.vec3, a: float, b: float):
    """A facet's normal, drawn as facets are seen from `outgoing`.

    Dupuy and Benyoub, "Sampling Visible GGX Normals with Spherical Caps", Computer Graphics Forum 42, 2023.
    """
    s, t = rng.tangents(n)
    seen = wp.vec3(alpha * wp.dot(s, outgoing), alpha * wp.dot(t, outgoing), wp.max(wp.dot(n, outgoing), 0.0))
    seen = wp.normalize(seen)
    below = a * (1.0 + seen[2])  # 1 - z of a point of the cap; z itself would lose the points near the pole
    sine = wp.sqrt(wp.max(below * (2.0 - below), 0.0))
    angle = b * wp.tau
    x = sine * wp.cos(angle) + seen[0]
    y = sine * wp.sin(angle) + seen[1]
    z = wp.max(1.0 - below + seen[2], 0.0)
    return wp.normalize(s * (alpha * x) + t * (alpha * y) + n * wp.max(z, 1.0e-12))  # not zero, which has no direction


@wp.func
def sample(material: SurfaceMaterial, outgoing: wp.vec3, a: float, b: float):
    """A direction, possibly below the surface: by the cosine about the normal, or mirrored at a visible normal."""
    share = gloss_share(material, outgoing)
    if a < share:
        half = visible_normal(material.normal, wp.sqrt(material.alpha2), outgoing, a / share, b)
        return wp.normalize(2.0 * wp.dot(outgoing, half) * half - outgoing)
    return rng.cosine_direction(material.normal, (a - share) / (1.0 - share), b)


@wp.func
def value(material: SurfaceMaterial, outgoing: wp.vec3, incoming: wp.vec3):
    """The BSDF times the cosine, for an incoming direction in front of the surface."""
    cosine = wp.dot(material.normal, incoming)
    diffuse = cosine / wp.pi
    if material.alpha2 == 0.0:
        return material.base_color * diffuse
    half = microfacets(material.normal, material.alpha2, outgoing, incoming)
    masking = smith(material.alpha2, wp.max(wp.dot(material.normal, outgoing), 0.0))
    gloss = half.distribution * masking * smith(material.alpha2, cosine) * cosine / 4.0
    m = material.metallic
    fresnel = F0 + (1.0 - F0) * half.fresnel
    tinted = (1.0 - m) * (1.0 - fresnel) * diffuse + m * (1.0 - half.fresnel) * gloss
    plain = ((1.0 - m) * fresnel + m * half.fresnel) * gloss
    return material.base_color * tinted + wp.vec3(plain)


@wp.func
def value_vjp(material: SurfaceMaterial, outgoing: wp.vec3, incoming: wp.vec3, grad: wp.vec3):
    """The gradient of dot(grad, value) for the material at the point, as if all its numbers were free."""
    gradient = MaterialGradient()
    n = material.normal
    cosine = wp.dot(n, incoming)
    diffuse = cosine / wp.pi
    grad_tinted = wp.dot(grad, material.base_color)
    if material.alpha2 == 0.0:
        gradient.base_color = grad * diffuse
        gradient.normal = incoming * (grad_tinted / wp.pi)
        return gradient
    a2 = material.alpha2
    m = material.metallic
    half = microfacets(n, a2, outgoing, incoming)
    facing = wp.dot(n, outgoing)
    seen = wp.max(facing, 0.0)
    root_i = smith_root(a2, cosine)
    root_o = smith_root(a2, seen)
    per_cosine = half.distribution / ((cosine + root_i) * (seen + root_o))
    gloss = per_cosine * cosine
    p = half.fresnel
    fresnel = F0 + (1.0 - F0) * p
    grad_plain = grad[0] + grad[1] + grad[2]
    gradient.base_color = grad * ((1.0 - m) * (1.0 - fresnel) * diffuse + m * (1.0 - p) * gloss)
    gradient.metallic = grad_tinted * ((1.0 - p) * gloss - (1.0 - fresnel) * diffuse)
    gradient.metallic += grad_plain * (p - fresnel) * gloss
    grad_diffuse = grad_tinted * (1.0 - m) * (1.0 - fresnel)
    grad_gloss = grad_tinted * m * (1.0 - p) + grad_plain * ((1.0 - m) * fresnel + m * p)

    # Slopes of the gloss's logarithm: of D, and of g at both cosines.
    slope = (half.sine2 - a2 * half.cosine * half.cosine) / (a2 * half.spread)
    slope -= (1.0 - cosine * cosine) / (2.0 * root_i * (cosine + root_i))
    slope -= (1.0 - seen * seen) / (2.0 * root_o * (seen + root_o))
    gradient.alpha2 = grad_gloss * gloss * slope

    h = wp.normalize(outgoing + incoming)
    across = wp.cross(n, wp.cross(h, n))  # the part of h perpendicular to n; the other one cannot turn n
    turn = across * (4.0 * (1.0 - a2) * half.cosine / half.spread)
    turn -= incoming * ((1.0 + (1.0 - a2) * cosine / root_i) / (cosine + root_i))
    if facing > 0.0:
        turn -= outgoing * ((1.0 + (1.0 - a2) * seen / root_o) / (seen + root_o))
    gradient.normal = turn * (grad_gloss * gloss)
    gradient.normal += incoming * (grad_gloss * per_cosine + grad_diffuse / wp.pi)
    return gradient
