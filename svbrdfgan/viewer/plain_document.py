"""Rewrites what browsers' libraries do not read in a glTF document."""

from __future__ import annotations

from io import BytesIO

from PIL import Image

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.document import Document, Json, picture_bytes
from svbrdfgan.io.gltf.materials import SPECULAR_GLOSSINESS, metallic_roughness
from svbrdfgan.io.gltf_codecs.pictures import KTX2, UnreadablePicture, decode_picture

_BASIS = "KHR_texture_basisu"


def make_plain(document: Document) -> None:
    """Turns pictures of KTX2 into PNG, and materials of specular and glossiness into dielectrics, in place.

    Pictures that cannot be read become white, as do those whose files are missing or may not be read: a page would ask
    for them wherever the document says. Of specular and glossiness, the factor of glossiness alone counts.
    """
    for number, entry in enumerate(document.table("images")):
        try:
            data = picture_bytes(document, number)
        except (FileNotFoundError, AssetError, ValueError):
            data = b""
        if not data or data.startswith(KTX2):
            entry.pop("uri", None)
            entry |= {"bufferView": document.add_view(_png(data)), "mimeType": "image/png"}
    for texture in document.table("textures"):
        if (basis := texture.get("extensions", {}).pop(_BASIS, None)) is not None:
            texture["source"] = basis["source"]
    for material in document.table("materials"):
        if SPECULAR_GLOSSINESS in material.get("extensions", {}):
            _make_dielectric(material)
    for key in ("extensionsRequired", "extensionsUsed"):
        if key in document.header:
            left = [name for name in document.header[key] if name not in (_BASIS, SPECULAR_GLOSSINESS)]
            document.header[key] = left
            if not left:
                del document.header[key]


def _png(data: bytes) -> bytes:
    try:
        picture = decode_picture(data, None)
    except UnreadablePicture:
        picture = Image.new("RGB", (1, 1), "white")
    stream = BytesIO()
    picture.save(stream, format="PNG", compress_level=1)
    return stream.getvalue()


def _make_dielectric(material: Json) -> None:
    pbr = dict(metallic_roughness(material))
    pbr.pop("metallicRoughnessTexture", None)  # it holds colours
    material["pbrMetallicRoughness"] = {**pbr, "baseColorFactor": list(pbr["baseColorFactor"])}
    del material["extensions"][SPECULAR_GLOSSINESS]
