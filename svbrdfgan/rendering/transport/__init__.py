"""Light transport: the image of a Lambertian surface as an affine function of its textures, traced once and stored."""

from svbrdfgan.rendering.transport.build import build_transport
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import TransportBatch

__all__ = ["LightTransport", "TransportBatch", "build_transport"]
