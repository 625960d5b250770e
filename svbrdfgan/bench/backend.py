"""One of our renderers as a program to be timed: `python -m svbrdfgan.bench.backend PARENT NAME SCENE --spp N`.

Like a peer's, its last line of output is JSON with the seconds of each step.
"""

from __future__ import annotations

import argparse
import json
import sys

import torch

from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.time_renderer import measure
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.utils.processes import end_with_parent


def figures(name: str, scene: BenchScene, spp: int, batch: int, repeats: int) -> dict[str, object]:
    """The object that the program prints: `STEP_s`, `STEP_bytes` and, on a GPU, `STEP_torch_bytes` of each step."""
    renderer = load_renderer(name)
    meter = measure(renderer, scene, spp, batch, repeats)
    device = renderer.device
    line: dict[str, object] = {"peer": name, "spp": spp, "batch": batch}
    line["device"] = torch.cuda.get_device_name(device) if device.type == "cuda" else device.type
    for suffix, values in (("s", meter.seconds), ("bytes", meter.peak_bytes), ("torch_bytes", meter.torch_bytes)):
        line |= {f"{step}_{suffix}": value for step, value in values.items()}
    return line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parent", type=int, help="the process that starts it, without which it ends")
    parser.add_argument("name")
    parser.add_argument("scene")
    for option, default in (("--spp", 16), ("--batch", 1), ("--repeats", 5)):
        parser.add_argument(option, type=int, default=default)
    given = parser.parse_args()
    end_with_parent(given.parent)
    try:
        scene = BenchScene.load(given.scene)
        print(json.dumps(figures(given.name, scene, given.spp, given.batch, given.repeats)))
    except SvbrdfganError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
