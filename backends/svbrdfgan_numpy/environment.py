"""The environment emitter: its radiance in any direction, and directions drawn where it is bright."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.types import Environment
from svbrdfgan_numpy.textures import Taps, bilinear_taps


@dataclass(frozen=True, eq=False)
class EnvironmentEmitter:
    """An environment prepared for lookups and sampling. `taps` index the list that `pixels_of` returns.

    Attributes:
        rows, cols: of the image.
        to_world: rotates the image's directions to the world's.
        share: the probability with which each pixel is drawn.
    """

    rows: int
    cols: int
    to_world: Float[ndarray, "3 3"]
    share: Float[ndarray, " pixels"]

    def taps(self, direction: Float[ndarray, "points 3"]) -> Taps:
        """The pixels whose weighted sum is the radiance from each unit direction."""
        return bilinear_taps(self._coordinates(direction), self.rows, self.cols, repeat=(True, False))

    def sample(self, random: Float[ndarray, "points 2"]) -> Float[ndarray, "points 3"]:
        """Unit directions: a pixel is drawn by its share, then a point around its centre by the lookup's tent.

        The first number chooses the pixel, and its remainder the height within the tent. A tent that reaches beyond a
        pole is folded back, because the lookup clamps there.
        """
        cumulative = np.concatenate([[0.0], np.cumsum(self.share)])
        # Below the last sum even after rounding, or there would be no pixel. From the right, which passes over pixels
        # whose share is 0.
        chosen = np.minimum(random[:, 0] * cumulative[-1], np.nextafter(cumulative[-1], 0.0))
        pixel = np.searchsorted(cumulative, chosen, side="right") - 1
        row, col = np.divmod(pixel, self.cols)
        remains = (chosen - cumulative[pixel]) / (cumulative[pixel + 1] - cumulative[pixel])
        theta = np.pi * (row + 0.5 + _tent(remains)) / self.rows
        azimuth = 2.0 * np.pi * ((col + 0.5 + _tent(random[:, 1])) / self.cols - 0.5)
        sine = np.abs(np.sin(theta))
        return np.stack([sine * np.sin(azimuth), np.cos(theta), -sine * np.cos(azimuth)], axis=-1) @ self.to_world.T

    def pdf(self, direction: Float[ndarray, "points 3"]) -> Float[ndarray, " points"]:
        """The density of `sample`, per steradian: the shares looked up, over 2 pi^2 sin(theta) steradians per du dv."""
        share = self.taps(direction).apply(self.share[:, None])[:, 0]
        sine = np.hypot(direction[:, 0], direction[:, 2])
        return share * self.rows * self.cols / (2.0 * np.pi**2 * np.maximum(sine, 1e-12))  # finite at the poles

    def _coordinates(self, direction: Float[ndarray, "points 3"]) -> Float[ndarray, "points 2"]:
        """(u, v) in [0, 1]: v = 0 is the zenith, u = 0.5 is -Z of the image."""
        x, y, z = (direction @ self.to_world).T
        u = 0.5 + np.arctan2(x, -z) / (2.0 * np.pi)
        return np.stack([u, np.arccos(np.clip(y, -1.0, 1.0)) / np.pi], axis=-1)


def pixels_of(environment: Environment) -> Float[ndarray, "pixels 3"]:
    """The radiance of each pixel, row by row."""
    return environment.radiance.detach().cpu().double().numpy().reshape(-1, 3)


def prepare_emitter(environment: Environment) -> EnvironmentEmitter:
    """The emitter, which draws directions by the mean of the channels times the solid angle."""
    pixels, (rows, cols, _) = pixels_of(environment), environment.radiance.shape
    area = np.repeat(np.sin(np.pi * (np.arange(rows) + 0.5) / rows), cols)
    power = pixels.mean(axis=-1) * area
    power = power if power.any() else area  # black: its gradient still needs samples
    return EnvironmentEmitter(rows, cols, _turn_about_y(environment.rotation), power / power.sum())


def _tent(random: Float[ndarray, " points"]) -> Float[ndarray, " points"]:
    """Offsets in (-1, 1) with density 1 - |x|."""
    low, high = np.sqrt(2.0 * random) - 1.0, 1.0 - np.sqrt(2.0 * np.maximum(1.0 - random, 0.0))
    return np.where(random < 0.5, low, high)


def _turn_about_y(angle: float) -> Float[ndarray, "3 3"]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
