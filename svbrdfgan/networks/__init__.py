"""The generator and the discriminator of thesis 4.3.1."""

from svbrdfgan.networks.discriminator import Discriminator
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import GEOMETRY_CHANNELS, Generator, ResidualBlock, Upsampling
from svbrdfgan.networks.layers import Norm, initialise

__all__ = [
    "GEOMETRY_CHANNELS",
    "Discriminator",
    "Draw",
    "Generator",
    "Norm",
    "ResidualBlock",
    "Upsampling",
    "initialise",
]
