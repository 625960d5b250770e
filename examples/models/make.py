"""Makes the shipped models: data sets, training, the choice among seeds, and scores on the test vehicles.

    python examples/models/make.py --assets assets -o out/models --minutes 8 --jobs 3

Each recipe has a data set, and each of its seeds a run. The seed that resembles the truth most on the validation
vehicles is scored on the test vehicles, once, and shipped. What is there already is not made again. `--jobs` runs share
a GPU; with several GPUs, runs are spread over them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import torch

HERE = Path(__file__).resolve().parent
RECIPES = ("road-dirt", "rust", "dust", "grime", "chipped-paint")
METAL = ("chipped-paint",)
"""Recipes that lay metal bare, whose models paint metallic, too."""
PROGRAM = "from svbrdfgan.cli import main; main()"


@dataclass(frozen=True)
class Work:
    """Where everything is, and which GPUs are free: one entry for each run that may start."""

    out: Path
    minutes: float
    free: SimpleQueue[str]
    settings: tuple[str, ...]

    def dataset(self, recipe: str) -> Path:
        """The data set of a recipe."""
        folder = self.out / "data" / recipe
        changes = [f"weathering.recipe={recipe}", *(["maps.metallic=0"] if recipe in METAL else [])]
        self.run(
            f"data-{recipe}",
            "dataset",
            str(self.out / "dataset.yaml"),
            *changes,
            *self.of("dataset"),
            "-o",
            str(folder),
        )
        return folder

    def train(self, recipe: str, seed: int) -> Path:
        """A run, trained and scored on the validation vehicles."""
        run, name = self.out / "runs" / f"{recipe}-{seed}", f"{recipe}-{seed}"
        length = [f"seed={seed}", f"minutes={self.minutes}", f"dataset=data/{recipe}"]
        resume = ["--resume"] if (run / "config.json").is_file() else []
        train = ("train", str(self.out / "train.yaml"), *length, *self.of("train"), "-o", str(run), *resume)
        if not (run / "evaluation.validation.json").is_file():
            self.run(f"train-{name}", *train)
            self.run(f"validate-{name}", "evaluate", str(run), "--split", "validation", "--no-oracle", "--workers", "4")
        return run

    def of(self, kind: str) -> Iterator[str]:
        """The settings of a data set or of training that the command line changes."""
        return (word.removeprefix(f"{kind}.") for word in self.settings if word.startswith(f"{kind}."))

    def run(self, name: str, *arguments: str) -> None:
        """Runs `svbrdfgan` on a free GPU; what it says goes into a file."""
        gpu, log = self.free.get(), self.out / "logs" / f"{name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        try:
            with log.open("w") as file:
                command = [sys.executable, "-c", PROGRAM, *arguments]
                visible = os.environ | {"CUDA_VISIBLE_DEVICES": gpu}
                code = subprocess.run(command, stdout=file, stderr=file, env=visible, check=False).returncode
        finally:
            self.free.put(gpu)
        if code:
            sys.exit(f"{' '.join(arguments)} failed; {log} says why")
        print(f"{name}: done", flush=True)


def resemblance(run: Path, split: str) -> float:
    """The score of a run on a split."""
    name = "evaluation.json" if split == "test" else f"evaluation.{split}.json"
    return float(json.loads((run / name).read_text())["generated"]["resemblance"]["resemblance"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("settings", nargs="*", help="such as train.batch_size=16 or dataset.splits.train.views=4")
    parser.add_argument("--assets", type=Path, required=True, help="folder with cars/ and envmaps/")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--recipes", nargs="+", default=RECIPES, choices=RECIPES)
    parser.add_argument("--seeds", nargs="+", type=int, default=(0, 1, 2))
    parser.add_argument("--minutes", type=float, default=8.0, help="training time of each run")
    parser.add_argument("--jobs", type=int, default=3, help="runs that share a GPU")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in ("dataset.yaml", "train.yaml"):
        shutil.copyfile(HERE / name, given.out / name)
    for name in ("cars", "envmaps"):  # file patterns are relative, so that no model's record names a folder
        if not (given.out / name).exists():
            (given.out / name).symlink_to((given.assets / name).resolve())
    free: SimpleQueue[str] = SimpleQueue()
    for gpu in gpus() * given.jobs:
        free.put(gpu)
    work = Work(given.out, given.minutes, free, tuple(given.settings))
    with ThreadPoolExecutor(free.qsize()) as pool:
        list(pool.map(work.dataset, given.recipes))
        pairs = [(recipe, seed) for seed in given.seeds for recipe in given.recipes]
        list(pool.map(lambda pair: work.train(*pair), pairs))


def gpus() -> list[str]:
    """The GPUs by number; the CPU, which has no name, where there are none."""
    return [str(number) for number in range(torch.cuda.device_count())] or [""]


if __name__ == "__main__":
    main()
