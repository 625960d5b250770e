"""Warp functions: the environment emitter, its radiance in any direction, and directions drawn where it is bright.

A position in the environment is (x, y) in pixels: pixel (row, col) is centred at (col + 0.5, row + 0.5).
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import rng


@wp.struct
class EnvironmentEmitter:
    texels: wp.array2d(dtype=wp.vec4)  # radiance, and density of `sample` per solid angle, times sin(polar)
    row_first: wp.array2d(dtype=wp.uint32)  # (1, rows): row i is drawn by the numbers from [0, i] to before [0, i + 1]
    col_first: wp.array2d(dtype=wp.uint32)  # (rows, cols): likewise the columns within each row
    rotation: wp.float32


@wp.func
def direction(emitter: EnvironmentEmitter, at: wp.vec2):
    """The world direction to a position in the environment."""
    azimuth = (at[0] / float(emitter.texels.shape[1]) - 0.5) * wp.tau - emitter.rotation
    polar = at[1] / float(emitter.texels.shape[0]) * wp.pi
    return wp.vec3(wp.sin(polar) * wp.sin(azimuth), wp.cos(polar), -wp.sin(polar) * wp.cos(azimuth))


@wp.func
def position(emitter: EnvironmentEmitter, d: wp.vec3):
    """The inverse of `direction`, with x in [0, cols) and y in [0, rows]."""
    turn = (wp.atan2(d[0], -d[2]) + emitter.rotation) / wp.tau + 0.5
    polar = wp.atan2(wp.sqrt(d[0] * d[0] + d[2] * d[2]), d[1]) / wp.pi
    return wp.vec2((turn - wp.floor(turn)) * float(emitter.texels.shape[1]), polar * float(emitter.texels.shape[0]))


@wp.func
def taps(rows: int, cols: int, at: wp.vec2):
    """Rows and columns of the four pixels around a position, and their bilinear weights.

    Columns wrap around the seam; rows are clamped at the poles.
    """
    col = int(wp.floor(at[0] - 0.5))
    row = int(wp.floor(at[1] - 0.5))
    a = at[0] - 0.5 - float(col)
    b = at[1] - 0.5 - float(row)
    left = (col + cols) % cols
    right = (col + 1 + cols) % cols
    upper = wp.clamp(row, 0, rows - 1)
    lower = wp.clamp(row + 1, 0, rows - 1)
    weights = wp.vec4((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b)
    return wp.vec4i(upper, upper, lower, lower), wp.vec4i(left, right, left, right), weights


@wp.func
def radiance(emitter: EnvironmentEmitter, at: wp.vec2):
    """The radiance from a position, bilinear between pixel centres."""
    row, col, w = taps(emitter.texels.shape[0], emitter.texels.shape[1], at)
    mixed = emitter.texels[row[0], col[0]] * w[0] + emitter.texels[row[1], col[1]] * w[1]
    mixed += emitter.texels[row[2], col[2]] * w[2] + emitter.texels[row[3], col[3]] * w[3]
    return wp.vec3(mixed[0], mixed[1], mixed[2])


@wp.func
def density(emitter: EnvironmentEmitter, at: wp.vec2, d: wp.vec3):
    """The density with which `sample` draws the direction `d` to a position, per steradian."""
    row = wp.clamp(int(at[1]), 0, emitter.texels.shape[0] - 1)
    sine = wp.max(wp.sqrt(d[0] * d[0] + d[2] * d[2]), 1.0e-7)  # finite at the poles
    return emitter.texels[row, int(at[0]) % emitter.texels.shape[1]][3] / sine


@wp.func
def drawn_column(first: wp.array2d(dtype=wp.uint32), row: int, number: wp.uint32):
    """The column that a random number draws in a row: the last one whose numbers begin at or before it."""
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
def place_in(first: wp.array2d(dtype=wp.uint32), row: int, col: int, number: wp.uint32):
    """How far a random number lies between those that draw a column and those that draw the next, in [0, 1)."""
    begin = first[row, col]
    end = wp.uint32(0)  # 2^32, after the last one
    if col + 1 < first.shape[1]:
        end = first[row, col + 1]
    width = float(end - begin)
    if end == begin:
        width = 4294967296.0
    return wp.min((float(number - begin) + 0.5) / width, 1.0 - rng.UNIT)


@wp.func
def position_in(emitter: EnvironmentEmitter, row: int, col: int, row_number: wp.uint32, col_number: wp.uint32):
    """The position in a pixel where the random numbers that draw it lie among all that do.

    So positions in one bright pixel, such as the sun's, are spread as evenly as the numbers. Two more numbers of a
    lattice would not be, in the few of its points that draw the pixel.
    """
    x = place_in(emitter.col_first, row, col, col_number)
    return wp.vec2(float(col) + x, float(row) + place_in(emitter.row_first, 0, row, row_number))


@wp.func
def sample(emitter: EnvironmentEmitter, row_number: wp.uint32, col_number: wp.uint32):
    """A position drawn by two random numbers: the pixel in proportion to its light, uniform within the pixel."""
    row = drawn_column(emitter.row_first, 0, row_number)
    col = drawn_column(emitter.col_first, row, col_number)
    return position_in(emitter, row, col, row_number, col_number)
