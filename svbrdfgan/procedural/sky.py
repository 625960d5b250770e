"""Procedural sky environment maps: a sun, a clear or clouded sky, and a ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.ndimage import map_coordinates
from torch import Tensor

from svbrdfgan.errors import ConfigError

_SUN_ILLUMINANCE = 128.0  # klx above the atmosphere; the sky's luminance is in kcd/m2
_WAVELENGTHS = np.array([0.61, 0.55, 0.465])  # representative wavelengths of red, green and blue, micrometres
# CIE XYZ to linear RGB with the sRGB primaries (IEC 61966-2-1).
_XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])

# Perez coefficients A-E of Y, x and y: first times the turbidity, then constant (Preetham et al. 1999, appendix 2).
_PEREZ = np.array(
    [
        [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
_ZENITH = (
    np.array(  # chromaticity x and y at the zenith: rows T^2, T, 1; columns powers 3 to 0 of the sun's zenith angle
        [
            [
                [0.00166, -0.00375, 0.00209, 0.0],
                [-0.02903, 0.06377, -0.03202, 0.00394],
                [0.11693, -0.21196, 0.06052, 0.25886],
            ],
            [
                [0.00275, -0.00610, 0.00317, 0.0],
                [-0.04214, 0.08970, -0.04153, 0.00516],
                [0.15346, -0.26756, 0.06670, 0.26688],
            ],
        ]
    )
)


@dataclass(frozen=True)
class SkyParameters:
    """The parameters of a sky, its sun and the ground below.

    Attributes:
        sun_elevation: above the horizon, radians in [0.03, pi/2].
        sun_azimuth: radians, 0 at +Z and pi/2 at +X, as for `Camera.orbit`.
        turbidity: amount of haze, from 2 (mountain air) to 8 (hazy).
        cloud_cover: 0 is clear, 1 is overcast.
        ground: linear RGB reflectance of the ground in [0, 1].
        exposure: radiance of a white horizontal Lambertian plane, mean of its channels.
        seed: seed of the cloud pattern.

    Raises:
        ConfigError: a number is out of its range.
    """

    sun_elevation: float
    sun_azimuth: float = 0.0
    turbidity: float = 2.5
    cloud_cover: float = 0.0
    ground: tuple[float, float, float] = (0.2, 0.2, 0.2)
    exposure: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "sun_elevation": (0.03, math.pi / 2),
            "sun_azimuth": (-1e3, 1e3),
            "turbidity": (2.0, 8.0),
            "cloud_cover": (0.0, 1.0),
            "exposure": (1e-6, 1e6),
            "seed": (0, 2**63),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ConfigError(f"sky {name} is {value}; wanted {low:g} to {high:g}.")
        if len(self.ground) != 3 or not all(0.0 <= channel <= 1.0 for channel in self.ground):
            raise ConfigError(f"sky ground is {self.ground}; wanted three linear reflectances between 0 and 1.")

    @property
    def sun_direction(self) -> tuple[float, float, float]:
        """Unit vector towards the sun."""
        flat = math.cos(self.sun_elevation)
        return (flat * math.sin(self.sun_azimuth), math.sin(self.sun_elevation), flat * math.cos(self.sun_azimuth))


def sample_sky(seed: int) -> SkyParameters:
    """A random sky, clear to overcast, with the sun 4 to 70 degrees high; the same seed gives the same sky.

    Raises:
        ConfigError: the seed is negative.
    """
    if seed < 0:
        raise ConfigError(f"sky seed is {seed}; wanted 0 or more.")
    rng = np.random.default_rng([seed, 0x5CE])
    tint = np.array([(0.20, 0.19, 0.18), (0.10, 0.12, 0.06), (0.32, 0.27, 0.20), (0.09, 0.09, 0.095)])[rng.integers(4)]
    red, green, blue = (float(c) for c in tint * rng.uniform(0.8, 1.25))
    return SkyParameters(
        sun_elevation=math.radians(rng.uniform(4.0, 70.0)),
        sun_azimuth=float(rng.uniform(-math.pi, math.pi)),
        turbidity=float(rng.uniform(2.0, 5.0)),
        cloud_cover=float(rng.beta(0.7, 0.9)),
        ground=(red, green, blue),
        seed=int(rng.integers(2**31)),
    )


def build_sky(parameters: SkyParameters, rows: int = 64, cols: int = 128) -> Float[Tensor, "rows cols 3"]:
    """An equirectangular map of linear radiance, oriented as in `docs/conventions.md`.

    It is scaled so that a white horizontal Lambertian plane has the radiance `exposure` (mean of the channels). The
    sun's disc is spread over about one pixel; its energy does not depend on the resolution.

    Raises:
        ConfigError: fewer than 8 rows or columns.
    """
    if rows < 8 or cols < 8:
        raise ConfigError(f"sky is {rows} x {cols} pixels; wanted at least 8 x 8.")
    direction, solid_angle = pixels(rows, cols)
    # 0 below and 1 above the horizon, with a ramp of about one row
    above = np.clip(direction[..., 1:2] * rows / 2.0 + 0.5, 0.0, 1.0)
    clear, sun = above * _clear_sky(parameters, direction), _sun(parameters, direction, solid_angle)
    clouds = above * _clouds(parameters, plane_radiance(clear + sun, direction, solid_angle), direction)
    share = _cloud_share(parameters, direction)
    veil = math.exp(-8.0 * max(parameters.cloud_cover - 0.35, 0.0) / 0.65)
    radiance = (1.0 - share) * clear + share * clouds + veil * sun
    plane = plane_radiance(radiance, direction, solid_angle)
    radiance = radiance + (1.0 - above) * np.asarray(parameters.ground) * plane
    scale = parameters.exposure / plane_radiance(radiance, direction, solid_angle).mean()
    return torch.from_numpy((scale * radiance).astype(np.float32))


def pixels(rows: int, cols: int) -> tuple[Float[ndarray, "rows cols 3"], Float[ndarray, "rows cols 1"]]:
    """Unit direction of each pixel's centre, and the pixel's solid angle in steradians."""
    edge = np.cos(np.linspace(0.0, np.pi, rows + 1))
    polar = (np.arange(rows)[:, None] + 0.5) / rows * np.pi
    angle = 2.0 * np.pi * ((np.arange(cols)[None, :] + 0.5) / cols - 0.5)
    x, z = np.sin(polar) * np.sin(angle), -np.sin(polar) * np.cos(angle)
    y = np.broadcast_to(np.cos(polar), x.shape)
    weight = np.broadcast_to(((edge[:-1] - edge[1:]) * 2.0 * np.pi / cols)[:, None], x.shape)
    return np.stack([x, y, z], axis=-1), weight[..., None]


def plane_radiance(radiance: ndarray, direction: ndarray, solid_angle: ndarray) -> Float[ndarray, " 3"]:
    """Radiance of a white Lambertian plane that faces up: its irradiance over pi."""
    return (radiance * np.maximum(direction[..., 1:2], 0.0) * solid_angle).sum(axis=(0, 1)) / np.pi


def _clear_sky(parameters: SkyParameters, direction: ndarray) -> Float[ndarray, "rows cols 3"]:
    """Radiance of the clear sky: Preetham, Shirley and Smits, "A Practical Analytic Model for Daylight", 1999."""
    zenith_angle = math.pi / 2 - parameters.sun_elevation
    turbidity = parameters.turbidity
    a, b, c, d, e = (_PEREZ @ (turbidity, 1.0)).T
    cos_view = np.maximum(direction[..., 1:2], 0.01)  # the Perez formula divides by it; zero at the horizon
    cos_sun = np.clip(direction @ parameters.sun_direction, -1.0, 1.0)[..., None]

    def perez(cos_theta: ndarray, cos_gamma: ndarray) -> ndarray:
        gamma = np.arccos(cos_gamma)
        return (1.0 + a * np.exp(b / cos_theta)) * (1.0 + c * np.exp(d * gamma) + e * cos_gamma**2)

    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * zenith_angle)
    luminance = max((4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192, 0.05)
    x, y = _ZENITH @ (zenith_angle**3, zenith_angle**2, zenith_angle, 1.0) @ (turbidity**2, turbidity, 1.0)
    relative = perez(cos_view, cos_sun) / perez(np.ones(1), np.full(1, math.cos(zenith_angle)))
    return _to_rgb(np.array([luminance, x, y]) * relative)


def _to_rgb(yxy: Float[ndarray, "rows cols 3"]) -> Float[ndarray, "rows cols 3"]:
    """Linear RGB of CIE xyY, given in the order Y, x, y; negative (out-of-gamut) channels become 0."""
    luminance, x, y = np.moveaxis(yxy, -1, 0)
    xyz = np.stack([x, y, 1.0 - x - y], axis=-1) * (luminance / y)[..., None]
    return np.maximum(xyz @ _XYZ_TO_RGB.T, 0.0)


def _sunlight(parameters: SkyParameters) -> Float[ndarray, " 3"]:
    """Irradiance of the sun on a plane that faces it, through air and haze (Preetham et al. 1999, appendix 1)."""
    degrees = math.degrees(parameters.sun_elevation)
    mass = 1.0 / (math.sin(parameters.sun_elevation) + 0.15 * (degrees + 3.885) ** -1.253)
    haze = 0.04608 * parameters.turbidity - 0.04586
    depth = 0.008735 * _WAVELENGTHS**-4.08 + haze * _WAVELENGTHS**-1.3
    return _SUN_ILLUMINANCE * np.exp(-mass * depth)


def _sun(parameters: SkyParameters, direction: ndarray, solid_angle: ndarray) -> Float[ndarray, "rows cols 3"]:
    """Radiance of the sun, spread over about a pixel above the horizon and normalised to the sun's energy."""
    size = max(0.8 * math.pi / direction.shape[0], math.radians(0.27))
    cosine = np.where(direction[..., 1] > 0.0, direction @ parameters.sun_direction, -np.inf)
    disc = np.exp((cosine - cosine.max()) / (0.5 * size**2))[
        ..., None
    ]  # relative to the nearest pixel, so that exp does not underflow at all pixels
    return _sunlight(parameters) * disc / (disc * solid_angle).sum()


def _clouds(parameters: SkyParameters, clear_plane: Float[ndarray, " 3"], direction: ndarray) -> ndarray:
    """Radiance of clouds, relative to `clear_plane`, the radiance of a white plane under the clear sky and the sun.

    Single clouds are nearly as bright as that plane; a closed cover has the gradient of the CIE overcast sky (S 011).
    """
    cover = parameters.cloud_cover
    light = 0.5 * clear_plane + 0.5 * clear_plane.mean()
    gradient = (9.0 / 7.0) * (1.0 + 2.0 * np.maximum(direction[..., 1:2], 0.0)) / 3.0
    return (0.85 - 0.5 * cover) * light * (1.0 + cover * (gradient - 1.0))


def _cloud_share(parameters: SkyParameters, direction: ndarray) -> Float[ndarray, "rows cols 1"]:
    """Cloud coverage of each direction: three octaves of noise on a plane overhead, uniform towards the horizon."""
    lattice = np.random.default_rng([parameters.seed, 0xC10]).random((32, 32))
    up = np.maximum(direction[..., 1], 0.0)
    plane = direction[..., [0, 2]] / (up + 0.25)[..., None]
    noise = np.zeros(up.shape)
    for octave in range(3):
        at = np.moveaxis(plane * 1.7 * 2**octave + 7.3 * octave, -1, 0)
        noise += 0.5 ** (octave + 1) * map_coordinates(lattice, at, order=1, mode="grid-wrap")
    cover = parameters.cloud_cover
    broken = _smoothstep((noise - 0.78 + 0.75 * cover) / 0.25 + 0.5)
    even = _smoothstep(np.array((cover - 0.2) / 0.6))
    closed = _smoothstep(np.array((cover - 0.6) / 0.3))
    weight = _smoothstep(up / 0.3) * (1.0 - closed)
    return ((1.0 - weight) * even + weight * broken)[..., None]


def _smoothstep(x: ndarray) -> ndarray:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
