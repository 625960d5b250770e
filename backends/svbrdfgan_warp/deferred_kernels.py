"""Warp kernels of deferred shading: light of stored hits drawn and traced, shading under any maps, and its transpose.

A hit has two directions, as in `material_kernels`. One is drawn by the emitter and stored, as a pixel of the
environment or `SHADOWED`; where in that pixel it lies follows from the random numbers that drew it, which follow from
the hit and the visit for which it was drawn. The other is drawn by the BSDF, for the maps of the moment. Both are
combined by the balance heuristic, whose densities gradients treat as constant.

Kernels have a thread for each view of a batch, from `first` on, and each hit of a view, or each of its pixels. `places`
holds the first hit and the first texture of each view, counted over the batch.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import alpha_kernels, bsdf, bvh_kernels, emitter, rng
from svbrdfgan_warp.alpha_kernels import AlphaMaps
from svbrdfgan_warp.frame import Frame, TangentSpace, bent_normal, bent_normal_vjp, corners_of, frame_at
from svbrdfgan_warp.material_kernels import shadow_start
from svbrdfgan_warp.texture_kernels import bilinear_taps
from svbrdfgan_warp.trace_kernels import Geometry

wp.set_module_options({"enable_backward": False})

REDRAWS = wp.constant(4)
"""Visits in which all light samples are drawn again once: each visit draws those of one group of pixels. What a pixel
has is drawn at once, as one sequence: several short ones are spread less evenly, and fakes would be noisier than
exemplars."""
SHADOWED = wp.constant(wp.uint32(0xFFFFFFFF))
_SPREAD = wp.constant(wp.uint32(0x9E3779B1))  # as a literal, compilers would warn of it
# Streams of `rng.hashed`; 0 and 1 belong to `rng.numbers`.
_PASSES = wp.constant(wp.uint32(0x20000))


@wp.struct
class StoredView:
    """The data of a view's picture that do not depend on the learnable materials."""

    geometry: Geometry
    space: TangentSpace
    alpha: AlphaMaps  # empty where all parts are opaque
    environment: emitter.EnvironmentEmitter
    origin: wp.vec3  # of the camera
    texture: wp.array(dtype=wp.int32)  # of each part, counted within the view
    repeat_u: wp.bool
    repeat_v: wp.bool
    start: wp.array(dtype=wp.int32)  # each pixel's first hit, and the number of hits
    weight: wp.array(dtype=wp.float32)  # of each hit of a pixel in the pixel
    pixel: wp.array(dtype=wp.int32)  # of each hit
    face: wp.array(dtype=wp.int32)
    at: wp.array(dtype=wp.vec2)  # barycentrics of the face's first two corners
    light: wp.array(dtype=wp.uint32)
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.struct
class Textures:
    """The maps of all learnable parts of a batch, (textures, rows, cols, channels), base colour first."""

    values: wp.array(dtype=wp.float32)
    rows: wp.int32
    cols: wp.int32
    channels: wp.int32
    roughness: wp.int32  # the first channel of a map; -1 where there is none
    metallic: wp.int32
    normal: wp.int32


@wp.struct
class Lookup:
    """The four texels around a hit, as the index of their first channel, and their bilinear weights."""

    texel: wp.vec4i
    weight: wp.vec4


@wp.struct
class Mapped:
    """A hit's maps, as they were looked up."""

    roughness: wp.float32
    metallic: wp.float32
    normal: wp.vec3


@wp.func
def lookup(view: StoredView, first_texture: int, textures: Textures, frame: Frame):
    """The texels that a hit looks up."""
    first = (first_texture + view.texture[frame.part]) * textures.rows * textures.cols
    texel, weight = bilinear_taps(first, textures.rows, textures.cols, view.repeat_u, view.repeat_v, frame.uv)
    found = Lookup()
    found.texel = texel * textures.channels
    found.weight = weight
    return found


@wp.func
def number_at(textures: Textures, found: Lookup, channel: int):
    total = float(0.0)  # noqa: UP018 - Warp's way to declare a variable
    for k in range(4):
        total += textures.values[found.texel[k] + channel] * found.weight[k]
    return total


@wp.func
def vector_at(textures: Textures, found: Lookup, channel: int):
    return wp.vec3(
        number_at(textures, found, channel),
        number_at(textures, found, channel + 1),
        number_at(textures, found, channel + 2),
    )


@wp.func
def maps_at(textures: Textures, found: Lookup):
    mapped = Mapped()
    if textures.roughness >= 0:
        mapped.roughness = number_at(textures, found, textures.roughness)
    if textures.metallic >= 0:
        mapped.metallic = number_at(textures, found, textures.metallic)
    if textures.normal >= 0:
        mapped.normal = vector_at(textures, found, textures.normal)
    return mapped


@wp.func
def material_of(textures: Textures, mapped: Mapped, frame: Frame):
    """The material at a hit, without its base colour."""
    material = bsdf.SurfaceMaterial()
    material.normal = frame.normal
    if textures.normal >= 0:
        material.normal = bent_normal(frame, mapped.normal)
    if textures.roughness >= 0:
        material.alpha2 = bsdf.alpha2_of(mapped.roughness)
        material.metallic = wp.clamp(mapped.metallic, 0.0, 1.0)
    return material


@wp.func
def frame_of(view: StoredView, hit: int):
    """The shading frame of a stored hit."""
    geometry = view.geometry
    corners = corners_of(geometry, view.face[hit])
    at = view.at[hit]
    p = geometry.points[corners[0]] * at[0] + geometry.points[corners[1]] * at[1]
    p += geometry.points[corners[2]] * (1.0 - at[0] - at[1])
    return frame_at(geometry, view.space, view.face[hit], at, wp.normalize(p - view.origin))


@wp.func
def reaches_light(view: StoredView, hit: int, d: wp.vec3, number: wp.uint32):
    """Whether light along `d` reaches a hit; where the ray meets clear parts, `number` decides."""
    geometry = view.geometry
    start = shadow_start(geometry, corners_of(geometry, view.face[hit]), view.at[hit], d)
    if view.alpha.layout.shape[0] > 0:
        passed = alpha_kernels.transmittance(geometry.nodes, geometry.triangles, view.alpha, start, d)
        return rng.unit(number) < passed
    return not bvh_kernels.blocked(geometry.nodes, geometry.triangles, start, d)


@wp.func
def draw_number(visit: int):
    """The number that is mixed into the seed of a visit's light samples."""
    return wp.uint32(visit) * _SPREAD + wp.uint32(0x7F4A7C15)


@wp.func
def last_drawn(pixel: int, visit: int):
    """The last visit, up to a visit from 0 on, for which a pixel's light samples were drawn."""
    return visit - (visit + REDRAWS - pixel % REDRAWS) % REDRAWS


@wp.func
def light_numbers(view: StoredView, hit: int, drawn: int):
    """The random numbers of a hit's light sample for the visit `drawn`.

    The dimensions, like those of rays, are as in `material_kernels.draw_light`: u[0] and u[1] placed the camera
    samples, and numbers of one dimension differ by a constant only, whatever the seed.
    """
    pixel = view.pixel[hit]
    return rng.numbers(pixel, hit - view.start[pixel], view.seed_low ^ draw_number(drawn), view.seed_high)


@wp.func
def light_position(view: StoredView, hit: int, stored: wp.uint32, drawn: int):
    """The position in the environment of a hit's light sample, which was drawn for the visit `drawn`."""
    u, _ = light_numbers(view, hit, drawn)
    cols = wp.uint32(view.environment.texels.shape[1])
    return emitter.position_in(view.environment, int(stored / cols), int(stored % cols), u[2], u[3])


@wp.kernel(cuda_max_registers=64)  # as in `trace_kernels.illuminate_hits`
def draw_light(views: wp.array(dtype=StoredView), first: int, group: int, visit: int):
    """Draws the light samples of a visit: those of pixels whose number is `group` modulo `REDRAWS`."""
    thread, hit = wp.tid()
    number = first + thread
    view = views[number]
    if hit >= view.face.shape[0]:
        return
    pixel = view.pixel[hit]
    if pixel % REDRAWS != group:
        return
    u, v = light_numbers(view, hit, visit)
    row = emitter.drawn_column(view.environment.row_first, 0, u[2])
    stored = wp.uint32(row * view.environment.texels.shape[1])
    stored += wp.uint32(emitter.drawn_column(view.environment.col_first, row, u[3]))
    d = emitter.direction(view.environment, light_position(view, hit, stored, visit))
    if wp.dot(frame_of(view, hit).normal, d) <= 0.0 or not reaches_light(view, hit, d, v[0]):
        stored = SHADOWED
    view.light[hit] = stored


@wp.kernel
def draw_rays(
    views: wp.array(dtype=StoredView),
    places: wp.array(dtype=wp.vec2i),
    first: int,
    textures: Textures,
    seed_low: wp.uint32,
    seed_high: wp.uint32,
    rays: wp.array(dtype=wp.vec2),
):
    """Draws a ray for each hit by its material: a position in the environment, with x = -1 where no light counts."""
    thread, hit = wp.tid()
    number = first + thread
    view = views[number]
    if hit >= view.face.shape[0]:
        return
    frame = frame_of(view, hit)
    material = material_of(textures, maps_at(textures, lookup(view, places[number][1], textures, frame)), frame)
    pixel = view.pixel[hit]
    _, v = rng.numbers(pixel, hit - view.start[pixel], seed_low, seed_high + wp.uint32(number))
    d = bsdf.sample(material, frame.outgoing, rng.unit(v[0]), rng.unit(v[1]))
    at = wp.vec2(-1.0, 0.0)
    if wp.dot(material.normal, d) > 0.0 and wp.dot(frame.normal, d) > 0.0:
        at = emitter.position(view.environment, d)
    rays[places[number][0] + hit] = at


@wp.kernel(cuda_max_registers=64)
def trace_rays(
    views: wp.array(dtype=StoredView),
    places: wp.array(dtype=wp.vec2i),
    first: int,
    seed_low: wp.uint32,
    seed_high: wp.uint32,
    rays: wp.array(dtype=wp.vec2),
):
    """Removes the rays that do not reach the light."""
    thread, hit = wp.tid()
    number = first + thread
    view = views[number]
    if hit >= view.face.shape[0]:
        return
    at = rays[places[number][0] + hit]
    if at[0] < 0.0:
        return
    passes = rng.hashed(wp.uint32(hit), seed_low, seed_high, _PASSES + wp.uint32(number))
    if not reaches_light(view, hit, emitter.direction(view.environment, at), passes[0]):
        rays[places[number][0] + hit] = wp.vec2(-1.0, 0.0)


@wp.func
def incoming(
    view: StoredView, material: bsdf.SurfaceMaterial, frame: Frame, hit: int, ray: wp.vec2, technique: int, visit: int
):
    """The direction of a hit's light sample (0) or of its ray (1), the radiance from there, and its factor.

    The factor is one over the summed densities of both (balance heuristic), and 0 where no light counts.
    """
    at = ray
    if technique == 0:
        at = wp.vec2(-1.0, 0.0)
        light = view.light[hit]
        if light != SHADOWED:
            at = light_position(view, hit, light, last_drawn(view.pixel[hit], visit))
    d = wp.vec3(0.0)
    radiance = wp.vec3(0.0)
    factor = float(0.0)  # noqa: UP018
    if at[0] >= 0.0:
        d = emitter.direction(view.environment, at)
        if wp.dot(material.normal, d) > 0.0 and wp.dot(frame.normal, d) > 0.0:
            radiance = emitter.radiance(view.environment, at)
            density = emitter.density(view.environment, at, d) + bsdf.density(material, frame.outgoing, d)
            factor = 1.0 / density
    return d, radiance, factor


@wp.kernel
def shade(
    views: wp.array(dtype=StoredView),
    places: wp.array(dtype=wp.vec2i),
    first: int,
    textures: Textures,
    visit: int,
    rays: wp.array(dtype=wp.vec2),
    radiance: wp.array(dtype=wp.vec3),
):
    """The radiance of each hit."""
    thread, hit = wp.tid()
    number = first + thread
    view = views[number]
    if hit >= view.face.shape[0]:
        return
    frame = frame_of(view, hit)
    found = lookup(view, places[number][1], textures, frame)
    material = material_of(textures, maps_at(textures, found), frame)
    material.base_color = vector_at(textures, found, 0)
    total = wp.vec3(0.0)
    for technique in range(2):
        d, light, factor = incoming(view, material, frame, hit, rays[places[number][0] + hit], technique, visit)
        if factor > 0.0:
            total += wp.cw_mul(bsdf.value(material, frame.outgoing, d), light) * factor
    radiance[places[number][0] + hit] = total


@wp.kernel
def average(
    views: wp.array(dtype=StoredView),
    places: wp.array(dtype=wp.vec2i),
    first: int,
    radiance: wp.array(dtype=wp.vec3),
    images: wp.array2d(dtype=wp.vec3),
):
    """The pixels: the weighted sums over their hits."""
    thread, pixel = wp.tid()
    number = first + thread
    view = views[number]
    total = wp.vec3(0.0)
    for hit in range(view.start[pixel], view.start[pixel + 1]):
        total += radiance[places[number][0] + hit]
    images[number, pixel] = total * view.weight[pixel]


@wp.kernel
def shade_vjp(
    views: wp.array(dtype=StoredView),
    places: wp.array(dtype=wp.vec2i),
    first: int,
    textures: Textures,
    visit: int,
    rays: wp.array(dtype=wp.vec2),
    grad_images: wp.array2d(dtype=wp.vec3),
    grad_values: wp.array(dtype=wp.float32),
):
    """Adds the gradient of sum(images * grad_images) to that of the textures' values."""
    thread, hit = wp.tid()
    number = first + thread
    view = views[number]
    if hit >= view.face.shape[0]:
        return
    pixel = view.pixel[hit]
    grad = grad_images[number, pixel] * view.weight[pixel]
    frame = frame_of(view, hit)
    found = lookup(view, places[number][1], textures, frame)
    mapped = maps_at(textures, found)
    material = material_of(textures, mapped, frame)
    material.base_color = vector_at(textures, found, 0)
    total = bsdf.MaterialGradient()
    for technique in range(2):
        d, light, factor = incoming(view, material, frame, hit, rays[places[number][0] + hit], technique, visit)
        if factor > 0.0:
            one = bsdf.value_vjp(material, frame.outgoing, d, wp.cw_mul(grad, light) * factor)
            total.normal += one.normal
            total.base_color += one.base_color
            total.metallic += one.metallic
            total.alpha2 += one.alpha2
    roughness = total.alpha2 * bsdf.alpha2_slope(mapped.roughness)
    metallic = wp.where(mapped.metallic >= 0.0 and mapped.metallic <= 1.0, total.metallic, 0.0)
    normal = wp.vec3(0.0)
    if textures.normal >= 0:
        normal = bent_normal_vjp(frame, mapped.normal, total.normal)
    for k in range(4):
        texel = found.texel[k]
        w = found.weight[k]
        add_vector(grad_values, texel, total.base_color * w)
        if textures.roughness >= 0:
            wp.atomic_add(grad_values, texel + textures.roughness, roughness * w)
        if textures.metallic >= 0:
            wp.atomic_add(grad_values, texel + textures.metallic, metallic * w)
        if textures.normal >= 0:
            add_vector(grad_values, texel + textures.normal, normal * w)


@wp.func
def add_vector(values: wp.array(dtype=wp.float32), index: int, v: wp.vec3):
    wp.atomic_add(values, index, v[0])
    wp.atomic_add(values, index + 1, v[1])
    wp.atomic_add(values, index + 2, v[2])
