"""Light transport: the picture of a Lambertian surface as an affine function of its textures, traced once and kept."""

from svbrdfgan.transport.build import build_transport
from svbrdfgan.transport.product import TransportBatch
from svbrdfgan.transport.record import LightTransport

__all__ = ["LightTransport", "TransportBatch", "build_transport"]
