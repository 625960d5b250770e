"""`python -m tests.reliability.endurance WORK`: works for long in one process, and prints what the process holds.

WORK is a renderer's name, or `training`. Each line is a JSON object; see `Held`.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.generate import generate
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.testing.scenes import corner_box, corner_view, random_light, random_texture
from svbrdfgan.training.config import train_config
from svbrdfgan.training.trainer import train
from svbrdfgan.types import Material, Materials
from svbrdfgan.utils.display import SilentDisplay
from tests.reliability.commands import DATASET, TRAIN

_SAMPLES = 20


@dataclass(frozen=True)
class Held:
    """What the process holds after so many renders or steps.

    Attributes:
        resident: bytes of main memory.
        device: bytes of the GPU's memory that no process has, of all allocators; 0 without a GPU.
        files: temporary files.
    """

    count: int
    resident: int
    device: int
    descriptors: int
    threads: int
    files: int

    @classmethod
    def now(cls, count: int) -> Held:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return cls(
            count,
            pages * os.sysconf("SC_PAGE_SIZE"),
            torch.cuda.mem_get_info()[0] if torch.cuda.is_available() else 0,
            len(os.listdir("/proc/self/fd")),
            threading.active_count(),
            sum(len(files) for _, _, files in os.walk(tempfile.gettempdir())),
        )


def grown(held: Sequence[Held], bytes_each: float, slack: int = 2 << 20) -> list[str]:
    """What grew from the first half of the work to its end, a tenth of it left out at the start.

    Args:
        bytes_each: that a render or a step may leave in memory.
        slack: bytes by which allocators go up and down.
    """
    warm = held[max(1, len(held) // 10) :]
    first, last = warm[: len(warm) // 2], warm[len(warm) // 2 :]
    count = last[-1].count - first[0].count
    memory = {
        "resident": max(each.resident for each in last) - max(each.resident for each in first),
        "device": min(each.device for each in first) - min(each.device for each in last),
    }
    found = [f"{name}: {more} bytes" for name, more in memory.items() if more > slack + bytes_each * count / 2]
    for name in ("descriptors", "threads", "files"):
        before, after = (max(getattr(each, name) for each in part) for part in (first, last))
        found += [f"{name}: {before} to {after}"] if after > before else []
    return found


def render(name: str, count: int, note: Callable[[int], None]) -> None:
    """Prepares, renders and differentiates a small scene so often, with other textures and light each time."""
    renderer = load_renderer(name)
    wrt = renderer.capabilities.differentiable & {"base_color", "environment"}
    for number in range(count):
        prepared = renderer.prepare(corner_box())
        size = 16 + number % 3
        materials = Materials((Material.lambertian(random_texture(size, size, number)),) * len(prepared.parts))
        view = corner_view(random_light(seed=number))
        image = renderer.render(prepared, materials, view, spp=2, seed=number).image
        renderer.render_vjp(prepared, materials, view, torch.ones_like(image), wrt=wrt, spp=2, seed=number)
        note(number + 1)


def learn(steps: int, folder: Path, tell: Callable[[int], None]) -> None:
    """Trains for so many steps on a small data set, on a GPU if there is one."""

    class _Noting(SilentDisplay):
        steps = 0

        def advance(self, steps: int = 1, note: str = "") -> None:
            self.steps += steps
            tell(self.steps)

    generate(dataset_config(DATASET, "endurance"), folder / "data", base=folder)
    often = {"score_every": max(1, steps // 100), "save_every": max(1, steps // 100)}
    own = {"dataset": str(folder / "data"), "device": "auto", "renderer": "warp", "steps": steps}
    config = train_config({**TRAIN, **often, **own}, "endurance")
    train(config, folder / "run", display=_Noting())


def main() -> None:
    """Prints a line for each twentieth of the work."""
    parser = argparse.ArgumentParser(prog="python -m tests.reliability.endurance", description=__doc__)
    parser.add_argument("work")
    parser.add_argument("--count", type=int, default=10_000, help="renders or steps")
    given = parser.parse_args()
    every = max(1, given.count // _SAMPLES)

    def note(count: int) -> None:
        if count % every == 0:
            print(json.dumps(asdict(Held.now(count))), flush=True)

    if given.work == "training":
        with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:
            learn(given.count, Path(folder), note)
    else:
        render(given.work, given.count, note)


if __name__ == "__main__":
    main()
