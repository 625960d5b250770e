"""The generator and the discriminator of thesis 4.3.1."""

from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.discriminator import Discriminator
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import GEOMETRY_CHANNELS, Generator, ResidualBlock, Upsampling
from svbrdfgan.networks.layers import Norm, initialise
from svbrdfgan.networks.saved import GeneratorConfig, make_generator

__all__ = [
    "GEOMETRY_CHANNELS",
    "Conditions",
    "Discriminator",
    "Draw",
    "Generator",
    "GeneratorConfig",
    "Norm",
    "ResidualBlock",
    "Upsampling",
    "initialise",
    "make_generator",
]
