"""A manifest of pictures that is imported in a second."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle

CAMERA: dict[str, Any] = {"azimuth_degrees": 90, "elevation_degrees": 10, "distance": 1.8}


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One grey picture of a van, with a mask over nearly all of it."""
    folder = tmp_path_factory.mktemp("own")
    save_mesh_glb(folder / "van.glb", build_vehicle(sample_vehicle("van", 5)))
    Image.new("RGB", (48, 48), (120, 120, 120)).save(folder / "van.jpg")
    mask = np.zeros((48, 48), dtype=np.uint8)
    mask[4:44, 2:46] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    data = {
        "pictures": [
            {"file": "van.jpg", "mesh": "van.glb", "mask": "mask.png", "camera": {**CAMERA, "target": [0, 0.2, 0]}}
        ],
        "image": [24, 24],
        "texture": 16,
        "renderer": {"name": "mitsuba", "device": "cpu"},
        "embedding": {"name": "hemispherical", "resolution": 16},
        "environments": {"procedural": {"count": 1}},
        "environment_rows": 8,
    }
    (folder / "manifest.yaml").write_text(yaml.safe_dump(data))
    return folder / "manifest.yaml"
