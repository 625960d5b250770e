"""Makes the shipped models: data sets, training, the choice among seeds, scores on the test vehicles, and their cards.

    python examples/models/make.py --assets assets -o out/models --minutes 18

Each recipe has a data set, and each of its seeds a run. The seed that resembles the truth most on the validation
vehicles is scored on the test vehicles, once, and becomes `out/models/shipped/RECIPE`, which belongs into
`svbrdfgan/models`. What is there already is not made again. One run keeps a GPU busy; with several GPUs, runs
are spread over them. A recipe whose resemblance stays below 0.75 on validation does not ship.
"""

from __future__ import annotations

import argparse
import csv
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from inspect import getdoc
from pathlib import Path
from queue import SimpleQueue

import torch

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import dataset_config
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.experiments.demo import SHOWN
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.records import load_record
from svbrdfgan.models.card import ModelCard, Scores, Source
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.training.ship import ship
from svbrdfgan.utils.processes import cores
from svbrdfgan.weathering.recipes import RECIPES

HERE = Path(__file__).resolve().parent
LEARNED = ("road-dirt", "rust", "dust", "grime", "chipped-paint")
"""The recipes that a model each is made of."""
SHIPS, AIM = 0.75, 0.85
"""The resemblance that a model needs on validation to ship, and the one below which its card says so."""
LIMITS = (
    "Detail is as fine as a texel of 512 on a side: half a centimetre to two on a car. Closer up it is soft.",
    "Patterns have the size that they have on a car 4.5 m long, in proportion to the vehicle.",
    "It learned from low-polygon vehicles, and from a recipe, not from photographs.",
)
PROGRAM = "from svbrdfgan.cli import main; main()"


@dataclass(frozen=True)
class Work:
    """Where everything is, which GPUs are free (an entry for each run that may start), and the threads of each run."""

    out: Path
    minutes: float
    free: SimpleQueue[str]
    settings: tuple[str, ...]
    threads: int

    def dataset(self, recipe: str) -> None:
        """Makes the data set of a recipe."""
        changes = [f"weathering.recipe={recipe}", *(["maps.metallic=0"] if RECIPES[recipe].metal else [])]
        config, folder = str(self.out / "dataset.yaml"), str(self.out / "data" / recipe)
        workers = ("--workers", str(self.threads))
        self.run(f"data-{recipe}", "dataset", config, *changes, *self.of("dataset"), "-o", folder, *workers)

    def train(self, recipe: str, seed: int) -> None:
        """Trains a run, and scores it on the validation vehicles."""
        name, run = f"{recipe}-{seed}", self.folder(recipe, seed)
        if not (run / "evaluation.validation.json").is_file():
            length = (f"seed={seed}", f"minutes={self.minutes}", f"dataset=data/{recipe}")
            resume = ["--resume"] if (run / "config.json").is_file() else []
            config = str(self.out / "train.yaml")
            self.run(f"train-{name}", "train", config, *length, *self.of("train"), "-o", str(run), *resume)
            self.run(f"validate-{name}", "evaluate", str(run), "--split", "validation", "--no-oracle")

    def ship(self, recipe: str, seeds: tuple[int, ...], data: tuple[Source, ...]) -> str:
        """Scores the best seed of a recipe on the test vehicles, and makes the folder that is shipped.

        Returns:
            A line on it.
        """
        validated = {seed: scores_of(self.folder(recipe, seed), "validation") for seed in seeds}
        best = max(seeds, key=lambda seed: validated[seed].resemblance or 0.0)
        reached = validated[best].resemblance or 0.0
        if reached < SHIPS:
            return f"{recipe}: seed {best} has {reached} on validation, below {SHIPS}: not shipped"
        run, picture = self.folder(recipe, best), self.out / f"{recipe}.jpg"
        if not (run / "evaluation.json").is_file():
            self.run(f"test-{recipe}", "evaluate", str(run), "--no-oracle")
        if not picture.is_file():
            vehicle, painted = self.out / f"{recipe}.clean.glb", str(self.out / f"{recipe}.glb")
            save_mesh_glb(vehicle, build_vehicle(SHOWN))
            shown = ("texture", str(vehicle), "--model", str(run), "-o", painted, "--force")
            self.run(f"picture-{recipe}", *shown, "--amount", "0.7", "--picture", str(picture))
        others = {f"resemblance of seed {seed} on validation": found.resemblance for seed, found in validated.items()}
        validation, test = validated[best].model_copy(update={"further": others}), scores_of(run, "test")
        given = ("--recipes", recipe, "--seeds", *map(str, seeds), "--minutes", f"{self.minutes:g}", *self.settings)
        card = ModelCard(
            name=recipe,
            title=recipe.replace("-", " ").capitalize(),
            about=" ".join(str(getdoc(RECIPES[recipe])).split("\n\n")[0].split()),
            recipes=(recipe,),
            data=data,
            command=" ".join(("python examples/models/make.py --assets ASSETS -o OUT", *given)),
            validation=validation,
            test=test,
            limits=(*LIMITS, *below_aim(test)),
        )
        ship(run, self.out / "shipped" / recipe, card, picture)
        return f"{recipe}: seed {best}, {reached} on validation, {test.resemblance} on test"

    def folder(self, recipe: str, seed: int) -> Path:
        return self.out / "runs" / f"{recipe}-{seed}"

    def of(self, kind: str) -> Iterator[str]:
        """The settings of a data set or of training that the command line changes."""
        return (word.removeprefix(f"{kind}.") for word in self.settings if word.startswith(f"{kind}."))

    def run(self, name: str, *arguments: str) -> None:
        """Runs `svbrdfgan` on a free GPU; what it says goes into a file."""
        log = self.out / "logs" / f"{name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        gpu = self.free.get()
        try:
            with log.open("w") as file:
                command = [sys.executable, "-c", PROGRAM, *arguments]
                own = os.environ | {"CUDA_VISIBLE_DEVICES": gpu, "OMP_NUM_THREADS": str(self.threads)}
                code = subprocess.run(command, stdout=file, stderr=file, env=own, check=False).returncode
        finally:
            self.free.put(gpu)
        if code:
            raise SystemExit(f"{' '.join(arguments)} failed; {log} says why")
        print(f"{name}: done", flush=True)


def scores_of(run: Path, split: str) -> Scores:
    """What a card says of an evaluation."""
    name = "evaluation.json" if split == "test" else f"evaluation.{split}.json"
    found = load_record(Evaluation, run / name)
    draws, figures = found.generated.draws, found.generated.figures
    if draws is None or figures is None:
        raise SystemExit(f"{run} has no scores on {split}: {found.refusal}")
    amount, relit = figures.amount, figures.relit
    return Scores(
        vehicles=draws.subjects,
        resemblance=round(draws.resemblance, 3),
        parts={name: round(value, 3) for name, value in draws.parts.items()},
        deviation=round(figures.deviation, 3),
        power=tuple(round(value, 3) for value in figures.power),
        normals=tuple(round(value, 3) for value in figures.relief),
        relit_flip=None if relit is None else round(relit.ratio, 3),
        amount_correlation=None if amount is None else round(amount.correlation, 3),
        amount_error=None if amount is None else round(amount.error, 3),
    )


def below_aim(scores: Scores) -> Iterator[str]:
    """What a card says where the draws resemble the truth less than they should."""
    if scores.resemblance is not None and scores.resemblance < AIM:
        name, value = min(scores.parts.items(), key=lambda part: part[1])
        yield (
            f"Resemblance is {scores.resemblance:.2f} on the test vehicles, below the {AIM} that a model should reach;"
            f" the weakest part is {name}, {value:.2f}."
        )


def sources(assets: Path) -> tuple[Source, ...]:
    """Who made what the models learn from, and its licences."""
    config = dataset_config(load_yaml(HERE / "dataset.yaml"), "dataset.yaml")
    used = {*config.splits["train"].meshes.files, *config.environments.files}
    with (assets / "MANIFEST.tsv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file, delimiter="\t") if row["file"] in used]
    found = Counter((row["attribution"], row["licence"]) for row in rows)
    named = [Source(name=f"{name} (files: {number})", licence=licence) for (name, licence), number in found.items()]
    return (*named, Source(name="procedural vehicles of this package", licence="Apache-2.0"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("settings", nargs="*", help="such as train.batch_size=16 or dataset.splits.train.views=4")
    parser.add_argument("--assets", type=Path, required=True, help="folder with cars/, envmaps/ and MANIFEST.tsv")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--recipes", nargs="+", default=LEARNED, choices=LEARNED)
    parser.add_argument("--seeds", nargs="+", type=int, default=(0, 1, 2))
    parser.add_argument("--minutes", type=float, default=18.0, help="training time of each run")
    parser.add_argument("--jobs", type=int, default=1, help="runs that share a GPU")
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
    threads = max(1, cores() // free.qsize())
    work = Work(given.out, given.minutes, free, tuple(given.settings), threads)
    seeds, data = tuple(given.seeds), sources(given.assets)
    with ThreadPoolExecutor(free.qsize()) as pool:
        list(pool.map(work.dataset, given.recipes))
        pairs = [(recipe, seed) for seed in seeds for recipe in given.recipes]
        list(pool.map(lambda pair: work.train(*pair), pairs))
        for line in pool.map(lambda recipe: work.ship(recipe, seeds, data), given.recipes):
            print(line)


def gpus() -> list[str]:
    """The GPUs by number; the CPU, which has no name, where there are none."""
    return [str(number) for number in range(torch.cuda.device_count())] or [""]


if __name__ == "__main__":
    main()
