"""Warp functions: the shading frame of a hit, and normal maps in it, bent so that no mirror direction is below N."""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import rng
from svbrdfgan_warp.trace_kernels import Geometry

wp.set_module_options({"enable_backward": False})


@wp.struct
class TangentSpace:
    tangents: wp.array2d(dtype=wp.vec3)  # at the corners of each face
    handedness: wp.array(dtype=wp.float32)  # of each face


@wp.struct
class Frame:
    """A hit, as shading sees it, without the maps. The vectors are of unit length and perpendicular to one another."""

    part: wp.int32
    uv: wp.vec2
    normal: wp.vec3  # N, turned to the viewer
    tangent: wp.vec3  # what x of a normal map goes along: turned with N
    bitangent: wp.vec3
    outgoing: wp.vec3  # towards the viewer


@wp.func
def corners_of(geometry: Geometry, face: int):
    return wp.vec3i(geometry.corners[face * 3], geometry.corners[face * 3 + 1], geometry.corners[face * 3 + 2])


@wp.func
def texture_uv(geometry: Geometry, corners: wp.vec3i, at: wp.vec2):
    uv = geometry.uv[corners[0]] * at[0] + geometry.uv[corners[1]] * at[1]
    return uv + geometry.uv[corners[2]] * (1.0 - at[0] - at[1])


@wp.func
def frame_at(geometry: Geometry, space: TangentSpace, face: int, at: wp.vec2, d: wp.vec3):
    """The frame at two barycentrics of a face, hit by a camera ray along `d`."""
    corners = corners_of(geometry, face)
    c = 1.0 - at[0] - at[1]
    n = geometry.normals[corners[0]] * at[0] + geometry.normals[corners[1]] * at[1] + geometry.normals[corners[2]] * c
    n = wp.normalize(n)
    if wp.dot(n, n) < 0.5:  # the corners' normals cancel
        origin = geometry.points[corners[0]]
        n = wp.normalize(wp.cross(geometry.points[corners[1]] - origin, geometry.points[corners[2]] - origin))
    side = wp.where(wp.dot(n, d) > 0.0, -1.0, 1.0)
    frame = Frame()
    frame.part = geometry.face_part[face]
    frame.uv = texture_uv(geometry, corners, at)
    frame.normal = n * side
    frame.outgoing = -d
    if space.handedness.shape[0] > 0:  # otherwise no part has a normal map
        t = space.tangents[face, 0] * at[0] + space.tangents[face, 1] * at[1] + space.tangents[face, 2] * c
        t = wp.normalize(t - n * wp.dot(n, t))
        if wp.dot(t, t) < 0.5:  # the corners' tangents cancel
            t, _ = rng.tangents(n)
        frame.tangent = t * side
        frame.bitangent = wp.cross(frame.normal, t) * space.handedness[face]
    return frame


@wp.func
def unbent(frame: Frame, mapped: wp.vec3):
    """The tilted normal, from a normal map's numbers; N where they are zero."""
    local = wp.normalize(mapped)
    if wp.dot(local, local) < 0.5:
        return frame.normal
    return wp.normalize(frame.tangent * local[0] + frame.bitangent * local[1] + frame.normal * local[2])


@wp.func
def bend(frame: Frame, n: wp.vec3):
    """The length k of the bend towards the viewer, in n + k w_o; and its derivatives by a = n . N and c = n . w_o."""
    a = wp.dot(n, frame.normal)
    b = wp.dot(frame.outgoing, frame.normal)
    c = wp.dot(n, frame.outgoing)
    excess = b - 2.0 * a * c
    if excess <= 0.0:
        return 0.0, 0.0, 0.0
    s = wp.max(wp.sqrt(a * a + b * excess), 1.0e-12)  # not 0: the slopes are divided by it
    s_a = (a - b * c) / s
    s_c = -a * b / s
    if a < 0.0:  # the same, as a + s would cancel
        b = wp.max(b, 1.0e-12)  # finite for a viewer on the horizon
        return (s - a) / b, (s_a - 1.0) / b, s_c / b
    below = 1.0 / (a + s)
    k = excess * below
    return k, (-2.0 * c - k * (1.0 + s_a)) * below, (-2.0 * a - k * s_c) * below


@wp.func
def bent_normal(frame: Frame, mapped: wp.vec3):
    """The normal that shades, from a normal map's numbers."""
    n = unbent(frame, mapped)
    k, _, _ = bend(frame, n)
    return wp.normalize(n + frame.outgoing * k)


@wp.func
def bent_normal_vjp(frame: Frame, mapped: wp.vec3, grad: wp.vec3):
    """The gradient for the normal map's numbers, from that for the normal that shades."""
    length = wp.length(mapped)
    if length == 0.0:
        return wp.vec3(0.0)
    n = unbent(frame, mapped)
    k, k_a, k_c = bend(frame, n)
    bent = n + frame.outgoing * k
    scale = 1.0 / wp.length(bent)
    bent *= scale
    g = (grad - bent * wp.dot(bent, grad)) * scale
    g += (frame.normal * k_a + frame.outgoing * k_c) * wp.dot(g, frame.outgoing)
    local = wp.vec3(wp.dot(g, frame.tangent), wp.dot(g, frame.bitangent), wp.dot(g, frame.normal))
    towards = mapped / length
    return (local - towards * wp.dot(towards, local)) / length
