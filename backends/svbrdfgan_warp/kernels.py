"""Warp kernels: trace camera samples to records, look textures up through them, and the transpose of that.

A record is a camera sample's part (-1 where it met nothing), uv and weight. Record `i` of a chunk of neighbouring
pixels is sample `i % spp` of pixel `first + i / spp`.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import chance

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(1.0e30)


@wp.struct
class Geometry:
    mesh: wp.uint64
    points: wp.array(dtype=wp.vec3)
    corners: wp.array(dtype=wp.int32)
    normals: wp.array(dtype=wp.vec3)
    uv: wp.array(dtype=wp.vec2)
    face_part: wp.array(dtype=wp.int32)


@wp.struct
class Lens:
    origin: wp.vec3
    right: wp.vec3
    top: wp.vec3
    forward: wp.vec3
    width: wp.int32
    height: wp.int32


@wp.struct
class Light:
    texels: wp.array2d(dtype=wp.vec4)  # radiance, and density of being drawn per solid angle, times sin(polar)
    row_first: wp.array2d(dtype=wp.uint32)  # (1, rows): row i is drawn by the numbers from [0, i] to before [0, i + 1]
    col_first: wp.array2d(dtype=wp.uint32)  # (rows, cols): likewise the columns within each row
    rotation: wp.float32


@wp.struct
class Atlas:
    layout: wp.array(dtype=wp.vec3i)  # per part: first texel, rows, cols
    repeat_u: wp.bool
    repeat_v: wp.bool


@wp.struct
class Samples:
    first: wp.int32  # pixel
    spp: wp.int32
    seed_low: wp.uint32
    seed_high: wp.uint32


@wp.func
def light_direction(light: Light, x: float, y: float):
    """The world's direction to continuous pixel coordinates of the environment."""
    azimuth = (x / float(light.texels.shape[1]) - 0.5) * wp.tau - light.rotation
    polar = y / float(light.texels.shape[0]) * wp.pi
    return wp.vec3(wp.sin(polar) * wp.sin(azimuth), wp.cos(polar), -wp.sin(polar) * wp.cos(azimuth))


@wp.func
def light_coordinates(light: Light, d: wp.vec3):
    """The inverse of `light_direction`, with columns in [0, cols) and rows in [0, rows]."""
    turn = (wp.atan2(d[0], -d[2]) + light.rotation) / wp.tau + 0.5
    polar = wp.atan2(wp.sqrt(d[0] * d[0] + d[2] * d[2]), d[1]) / wp.pi
    return (turn - wp.floor(turn)) * float(light.texels.shape[1]), polar * float(light.texels.shape[0])


@wp.func
def light_texel(light: Light, row: int, col: int):
    rows = light.texels.shape[0]
    cols = light.texels.shape[1]
    return light.texels[wp.clamp(row, 0, rows - 1), (col + cols) % cols]


@wp.func
def light_radiance(light: Light, x: float, y: float):
    """Bilinear between pixel centres, around the seam and clamped at the poles."""
    col = int(wp.floor(x - 0.5))
    row = int(wp.floor(y - 0.5))
    a = x - 0.5 - float(col)
    b = y - 0.5 - float(row)
    upper = light_texel(light, row, col) * (1.0 - a) + light_texel(light, row, col + 1) * a
    lower = light_texel(light, row + 1, col) * (1.0 - a) + light_texel(light, row + 1, col + 1) * a
    mixed = upper * (1.0 - b) + lower * b
    return wp.vec3(mixed[0], mixed[1], mixed[2])


@wp.func
def drawn(first: wp.array2d(dtype=wp.uint32), row: int, number: wp.uint32):
    """The column that a random number draws in a row: the last whose numbers begin at or before it."""
    low = int(0)  # noqa: UP018, RUF046 - Warp's way to declare a variable
    high = first.shape[1] - 1
    while low < high:
        middle = (low + high + 1) / 2
        if first[row, middle] <= number:
            low = middle
        else:
            high = middle - 1
    return low


@wp.func
def arriving(geometry: Geometry, light: Light, x: float, y: float, d: wp.vec3, p: wp.vec3, n: wp.vec3, g: wp.vec3):
    """Radiance times cosine over the summed densities of both techniques: the balance heuristic's share of irradiance.

    `g` is the geometric normal, as long as rays must start away from the surface.
    """
    cosine = wp.dot(n, d)
    if cosine <= 0.0:
        return wp.vec3(0.0)
    radiance = light_radiance(light, x, y)
    if wp.max(radiance) <= 0.0:
        return wp.vec3(0.0)
    start = p + g * wp.where(wp.dot(g, d) >= 0.0, 1.0, -1.0)
    if wp.mesh_query_ray_anyhit(geometry.mesh, start, d, FAR):
        return wp.vec3(0.0)
    sine = wp.max(wp.sqrt(d[0] * d[0] + d[2] * d[2]), 1.0e-7)
    density = light_texel(light, int(y), int(x))[3] / sine + cosine / wp.pi
    return radiance * (cosine / density)


@wp.func
def irradiance(geometry: Geometry, light: Light, p: wp.vec3, n: wp.vec3, g: wp.vec3, u: wp.vec4ui, v: wp.vec4ui):
    """An unbiased estimate of the irradiance at `p`, from one direction drawn by light and one by cosine."""
    row = drawn(light.row_first, 0, u[2])
    x = float(drawn(light.col_first, row, u[3])) + chance.unit(v[2])
    y = float(row) + chance.unit(v[3])
    by_light = arriving(geometry, light, x, y, light_direction(light, x, y), p, n, g)
    d = chance.cosine_direction(n, chance.unit(v[0]), chance.unit(v[1]))
    x, y = light_coordinates(light, d)
    return by_light + arriving(geometry, light, x, y, d, p, n, g)


@wp.kernel
def trace(
    geometry: Geometry,
    lens: Lens,
    light: Light,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
):
    """One record for each camera sample: where it meets the surface, and irradiance / pi / spp there."""
    i = wp.tid()
    pixel = samples.first + i / samples.spp
    u, v = chance.numbers(pixel, i % samples.spp, samples.seed_low, samples.seed_high)
    x = (float(pixel % lens.width) + chance.unit(u[0])) / float(lens.width) * 2.0 - 1.0
    y = 1.0 - (float(pixel / lens.width) + chance.unit(u[1])) / float(lens.height) * 2.0
    d = wp.normalize(lens.forward + lens.right * x + lens.top * y)
    hit = wp.mesh_query_ray(geometry.mesh, lens.origin, d, FAR)
    if not hit.result:
        part[i] = -1
        return
    a = geometry.corners[hit.face * 3]
    b = geometry.corners[hit.face * 3 + 1]
    c = geometry.corners[hit.face * 3 + 2]
    s = hit.u
    t = hit.v
    r = 1.0 - s - t
    pa = geometry.points[a]
    pb = geometry.points[b]
    pc = geometry.points[c]
    n = wp.normalize(geometry.normals[a] * s + geometry.normals[b] * t + geometry.normals[c] * r)
    if wp.dot(n, n) < 0.5:  # corner normals that cancel
        n = hit.normal
    n = n * wp.where(wp.dot(n, d) > 0.0, -1.0, 1.0)
    # The corners' size bounds the rounding error of the point between them.
    reach = wp.max(wp.max(wp.max(wp.abs(pa)), wp.max(wp.abs(pb))), wp.max(wp.abs(pc)))
    p = pa * s + pb * t + pc * r
    e = irradiance(geometry, light, p, n, hit.normal * (reach * 1.0e-5), u, v)
    part[i] = geometry.face_part[hit.face]
    uv[i] = geometry.uv[a] * s + geometry.uv[b] * t + geometry.uv[c] * r
    weight[i] = e / (wp.pi * float(samples.spp))


@wp.func
def placed(i: int, n: int, repeat: bool):
    if repeat:
        return ((i % n) + n) % n
    return wp.clamp(i, 0, n - 1)


@wp.func
def taps(atlas: Atlas, part: int, uv: wp.vec2):
    """The four texels around `uv` and their bilinear weights."""
    layout = atlas.layout[part]
    x = uv[0] * float(layout[2]) - 0.5
    y = uv[1] * float(layout[1]) - 0.5
    col = int(wp.floor(x))
    row = int(wp.floor(y))
    a = x - float(col)
    b = y - float(row)
    left = placed(col, layout[2], atlas.repeat_u)
    right = placed(col + 1, layout[2], atlas.repeat_u)
    below = layout[0] + placed(row, layout[1], atlas.repeat_v) * layout[2]
    above = layout[0] + placed(row + 1, layout[1], atlas.repeat_v) * layout[2]
    texels = wp.vec4i(below + left, below + right, above + left, above + right)
    return texels, wp.vec4((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b)


@wp.kernel
def gather(
    atlas: Atlas,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    coverage: wp.array(dtype=wp.float32),
):
    """The chunk's pixels: the sum of weight * base_color over their records."""
    pixel = wp.tid()
    total = wp.vec3(0.0)
    met = int(0)  # noqa: UP018, RUF046
    for sample in range(samples.spp):
        i = pixel * samples.spp + sample
        if part[i] >= 0:
            t, w = taps(atlas, part[i], uv[i])
            colour = texels[t[0]] * w[0] + texels[t[1]] * w[1] + texels[t[2]] * w[2] + texels[t[3]] * w[3]
            total += wp.cw_mul(weight[i], colour)
            met += 1
    image[samples.first + pixel] = total
    coverage[samples.first + pixel] = float(met) / float(samples.spp)


@wp.kernel
def scatter(
    atlas: Atlas,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_texels: wp.array(dtype=wp.vec3),
):
    """The transpose of `gather`: adds weight * grad_image to the texels of each record."""
    i = wp.tid()
    if part[i] >= 0:
        t, w = taps(atlas, part[i], uv[i])
        g = wp.cw_mul(weight[i], grad_image[samples.first + i / samples.spp])
        for k in range(4):
            wp.atomic_add(grad_texels, t[k], g * w[k])
