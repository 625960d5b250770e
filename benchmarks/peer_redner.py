"""redner, the ray tracer of the thesis, as a peer of `svbrdfgan bench`, on the CPU.

    python3.7 -m venv redner && redner/bin/pip install torch==1.7.1 redner==0.4.28 scikit-image imageio
    svbrdfgan bench --peer "redner/bin/python benchmarks/peer_redner.py {scene} --spp {spp}"

Prints one JSON line with median seconds of a picture, and of a picture and its gradient; building the scene is timed
apart. The last packages of redner are for Python 3.7, so this file is too.
"""

import argparse
import json
import math
import statistics
import time

import numpy as np
import pyredner
import torch


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    pyredner.set_use_gpu(False)
    pyredner.set_print_timing(False)
    with np.load(given.scene) as arrays:
        arrays = {name: arrays[name] for name in arrays.files}
    texture = torch.tensor(arrays["texture"], requires_grad=True)
    prepare, forward, both = [], [], []
    for seed in range(given.repeats + 1):
        start = time.perf_counter()
        scene = _scene(arrays, texture)
        built = time.perf_counter()
        image = pyredner.render_pathtracing(scene, num_samples=(given.spp, given.spp), max_bounces=1, seed=seed)
        pictured = time.perf_counter()
        (image * image).mean().backward()
        done = time.perf_counter()
        prepare.append(built - start)
        forward.append(pictured - built)
        both.append(done - built)
    medians = {"prepare_s": prepare, "forward_s": forward, "forward_backward_s": both}
    line = {name: statistics.median(seconds[1:]) for name, seconds in medians.items()}
    print(json.dumps(dict(line, peer="redner 0.4.28 cpu", spp=given.spp)))


def _scene(arrays, texture):
    origin, target, up = (torch.tensor(row, dtype=torch.float32) for row in arrays["camera"])
    camera = pyredner.Camera(
        position=origin,
        look_at=target,
        up=up,
        fov=torch.tensor([math.degrees(arrays["vertical_fov"])], dtype=torch.float32),
        resolution=(int(arrays["height"]), int(arrays["width"])),
    )
    parts = [_part(arrays, texture, part) for part in np.unique(arrays["face_part"])]
    light = pyredner.EnvironmentMap(torch.tensor(arrays["radiance"]), env_to_world=_turn(float(arrays["rotation"])))
    return pyredner.Scene(camera=camera, objects=parts, envmap=light)


def _part(arrays, texture, part):
    """A part's faces, with the vertices that they use; part 0 has the texture."""
    used, faces = np.unique(arrays["faces"][arrays["face_part"] == part], return_inverse=True)
    reflectance = pyredner.Texture(texture) if part == 0 else torch.tensor(arrays["base_color"][part])
    return pyredner.Object(
        vertices=torch.tensor(arrays["positions"][used]),
        indices=torch.tensor(faces.reshape(-1, 3).astype(np.int32)),
        uvs=torch.tensor(arrays["uv"][used]),
        normals=torch.tensor(arrays["normals"][used]),
        material=pyredner.Material(diffuse_reflectance=reflectance, two_sided=True),
    )


def _turn(rotation):
    """A rotation about +Y; redner's first column lies where our middle one does, half a turn away."""
    cosine, sine = math.cos(rotation + math.pi), math.sin(rotation + math.pi)
    rows = [[cosine, 0.0, sine, 0.0], [0.0, 1.0, 0.0, 0.0], [-sine, 0.0, cosine, 0.0], [0.0, 0.0, 0.0, 1.0]]
    return torch.tensor(rows, dtype=torch.float32)


if __name__ == "__main__":
    main()
