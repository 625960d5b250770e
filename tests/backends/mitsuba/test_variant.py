"""The caller's Mitsuba variant stays set. Each case runs in its own process: a variant cannot be unset."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

START = """
import svbrdfgan_mitsuba as backend, torch
from svbrdfgan.testing import scenes
import mitsuba as mi, drjit as dr
def picture(bounces):
    renderer = backend.MitsubaRenderer("cpu", bounces)
    view = scenes.front_view(scenes.random_light())
    prepared, white = renderer.prepare(scenes.sphere()), scenes.lambertian((1.0, 1.0, 1.0))
    image = renderer.render(prepared, white, view, spp=4, seed=0).image
    renderer.render_vjp(prepared, white, view, image, wrt=frozenset({"base_color"}), spp=4, seed=0)
    return float(image.sum())
"""
CASES = {
    "none set": """
first, second = picture(1), picture(3)
assert mi.variant() is None
try:
    mi.Float
except (ImportError, AttributeError):
    print(first, second)
""",
    "scalar_rgb": """
mi.set_variant("scalar_rgb")
scalar, integrator = mi.Float, mi.load_dict({"type": "path"})
first, second = picture(1), picture(3)
assert mi.variant() == "scalar_rgb" and mi.Float is scalar
assert mi.load_dict({"type": "path"}).class_name() == integrator.class_name()
print(first, second)
""",
    "llvm_ad_rgb": """
mi.set_variant("llvm_ad_rgb")
prb, scene = mi.ad.integrators.prb.PRBIntegrator, mi.load_dict(mi.cornell_box())
before = mi.render(scene, spp=1, seed=0)
first, second = picture(1), picture(3)
assert mi.variant() == "llvm_ad_rgb" and mi.ad.integrators.prb.PRBIntegrator is prb
assert dr.allclose(mi.render(scene, spp=1, seed=0), before, atol=1e-4)
print(first, second)
""",
}


def run(code: str) -> str:
    path = os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])
    env = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def pictures() -> dict[str, str]:
    return {name: run(START + code) for name, code in CASES.items()}


@pytest.mark.full
def test_it_is_left_as_it_was_and_changes_no_picture(pictures: dict[str, str]) -> None:
    assert pictures["none set"].strip()
    assert pictures["scalar_rgb"] == pictures["llvm_ad_rgb"] == pictures["none set"]
