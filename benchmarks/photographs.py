"""What can be learned from photographs, beside what the same scenes teach when we render them.

    python benchmarks/photographs.py photos.yaml -o out --blender blender --jobs 4

photos.yaml is `benchmarks/photographs.yaml`, beside the vehicles and lights that it names. Blender photographs its
training scenes, which are imported and learned from as each of `ROWS` says, and the same scenes are rendered. The last
generator of each run is scored on the test vehicles, whose layers it never saw. `out/table.md` holds the resemblance of
each row: the mean over the seeds, each seed, and the mean relative to that of the row `matched`.

Run again, it goes on where it was. Runs are spread over all GPUs, and begin as soon as their pictures are taken; a set
of pictures is taken at a time, by Blenders of two threads on all cores. What runs say is in `out/logs`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from threading import Lock
from typing import Any

import click
import torch

from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import INDEX
from svbrdfgan.data.staged_photos.config import staged_photos_config
from svbrdfgan.data.staged_photos.stage import MANIFEST, stage_photos
from svbrdfgan.evaluation.record import EVALUATION, Evaluation
from svbrdfgan.io.records import load_record
from svbrdfgan.training.run import CONFIG
from svbrdfgan.training.turns import run_folder
from svbrdfgan.utils.processes import cores

IMAGE = (128, 128)
"""Of exemplars."""
TRAIN = """
spp: 64
batch_size: 16
score_every: 1000000  # the last generator counts in every row, since photographs have no truth to choose by
discriminator: {weights: he, compares: reflectance}
generator: {width: 32, kernel: 3, blocks: 4, downsamplings: 3, random_fields: 7, skips: true, conditions: false}
"""
"""The training configuration of all rows."""
PROGRAM = "from svbrdfgan.cli import main; main()"
MOST_BAKERS = 8
"""Processes that render scenes, at most, since each has a context on the GPU."""


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        photography: what differs in the section of photos.yaml; None: exemplars are rendered by us instead.
        manifest: keys of the manifest.
        steps: of the first turn; later ones have three fifths of them.
        views: pictures of each vehicle.
    """

    photography: Mapping[str, Any] | None
    steps: int
    r1: float
    manifest: Mapping[str, Any] = field(default_factory=dict)
    turns: int = 1
    views: int = 6

    @property
    def pictures(self) -> str:
        """The folder of its pictures, which rows may share."""
        kind = "matched" if self.photography is None else "-".join(map(str, self.photography.values())) or "plain"
        return f"{kind}-{self.views}"


ROWS: Mapping[str, Row] = {
    "matched": Row(None, 2700, 0.03),
    "before": Row({"pairs": "before"}, 2400, 0.1),
    "flash": Row({"pairs": "flash", "view": "Raw"}, 2400, 0.1),
    "turns": Row({}, 1500, 0.1, {"bootstrap": 8, "refine_cameras": True}, turns=3),
    "given": Row({}, 1500, 0.1, {"bootstrap": 8}, turns=3),
    "matched-2030": Row(None, 2700, 0.03, views=58),
    "turns-2030": Row({}, 1500, 0.1, {"bootstrap": 8, "refine_cameras": True}, turns=3, views=58),
}
FEW = [name for name, row in ROWS.items() if row.views == ROWS["matched"].views]
"""`matched`: rendered, in known light. `before`: with pictures of clean vehicles. `flash`: with and without a flash.
`turns`: unknown light, and cameras off by a degree, which are corrected. `given`: which are not. `-2030`: as many
pictures instead of 210; Blender takes three hours for them on two cores."""


@dataclass(frozen=True)
class Work:
    """Where everything is, and a GPU for each program that may run; "" where there is none.

    Attributes:
        photos: photos.yaml.
        blender: as for `svbrdfgan dataset photograph`.
        threads: of each program, if nobody says how many.
        workers: the option that says how many processes import pictures.
    """

    photos: Path
    blender: str | None
    out: Path
    threads: int
    workers: tuple[str, str]
    free: SimpleQueue[str]
    taking: Lock = field(default_factory=Lock)
    taken: set[str] = field(default_factory=set)
    importing: dict[str, Lock] = field(default_factory=lambda: {name: Lock() for name in ROWS})

    def pictures(self, name: str) -> Path:
        """The folder with the pictures of a row, which are taken if they are not there."""
        row = ROWS[name]
        if row.pictures not in self.taken:  # else nobody waits for those of another row
            with self.taking:
                if row.pictures not in self.taken:
                    photograph(row, self.photos, self.out, self.blender)
                    self.taken.add(row.pictures)
        return self.out / row.pictures

    def exemplars(self, name: str) -> Path:
        """The data set of a row that takes no turns; imports its photographs if no other run has."""
        row, data, pictures = ROWS[name], self.out / "data" / name, self.pictures(name)
        if row.photography is None:
            return pictures
        with self.importing[name]:
            if not (data / INDEX).is_file():
                options = (*words(importing(row)), *self.workers, "-o", str(data))
                self.run(f"import-{name}", "dataset", "import", str(pictures / MANIFEST), *options)
        return data

    def score(self, name: str, seed: int) -> None:
        """Trains a run of a row, and scores it on the test vehicles."""
        row, run, title = ROWS[name], self.last_run(name, seed), f"{name}-{seed}"
        if (run / EVALUATION).is_file():
            return
        config = str(self.out / "train.yaml")
        settings: dict[str, Any] = {"seed": seed, "steps": row.steps, "loss.r1": row.r1}
        if row.turns > 1:
            changes = words(settings | {f"manifest.{key}": value for key, value in importing(row).items()})
            options = ("--turns", str(row.turns), *self.workers, "-o", str(self.out / "runs" / title))
            self.run(f"learn-{title}", "learn", str(self.pictures(name) / MANIFEST), config, *changes, *options)
        else:
            data = self.exemplars(name)
            resume = ["--resume"] if (run / CONFIG).is_file() else []
            changes = words(settings | {"dataset": str(data.resolve())})
            self.run(f"learn-{title}", "train", config, *changes, "-o", str(run), *resume)
        self.run(f"score-{title}", "evaluate", str(run), "--on", str(self.pictures("matched")), *self.workers)

    def last_run(self, name: str, seed: int) -> Path:
        """The folder of the run that is scored."""
        folder, turns = self.out / "runs" / f"{name}-{seed}", ROWS[name].turns
        return run_folder(folder, turns) if turns > 1 else folder

    def run(self, title: str, *arguments: str) -> None:
        """Runs a command of svbrdfgan on a free GPU."""
        gpu, log = self.free.get(), self.out / "logs" / f"{title}.txt"
        try:
            with log.open("a") as file:
                environment = {"OMP_NUM_THREADS": str(self.threads), **os.environ}
                environment |= {"CUDA_VISIBLE_DEVICES": gpu} if gpu else {}
                command = [sys.executable, "-c", PROGRAM, *arguments]
                done = subprocess.run(command, env=environment, stdout=file, stderr=subprocess.STDOUT)
        finally:
            self.free.put(gpu)
        if done.returncode:
            raise click.ClickException(f"{title} failed; {log} says why. Run again, the benchmark goes on.")


def importing(row: Row) -> dict[str, Any]:
    """The keys of the manifest that the row's import changes."""
    return {"image": list(IMAGE), **row.manifest}


def words(changes: Mapping[str, Any]) -> list[str]:
    """The changes as KEY=VALUE."""
    return [f"{key}={json.dumps(value)}" for key, value in changes.items()]


def photograph(row: Row, photos: Path, out: Path, blender: str | None) -> None:
    """Takes the pictures of a row, or renders its scenes, and those of the test split on which all rows are scored."""
    base = photos.parent
    declared = apply_overrides(load_yaml(photos), [f"splits.train.views={row.views}"])
    if row.photography is None:
        # pictures of gloss are imported as if there were none, so what is learned is base colour alone
        whole = staged_photos_config(declared, str(photos)).dataset
        plain = whole.model_copy(update={"image": IMAGE, "maps": {}})
        generate(plain, out / row.pictures, base=base, workers=min(cores(), MOST_BAKERS))
    elif not (out / row.pictures / MANIFEST).is_file():
        photography = {**declared.get("photography", {}), **row.photography}
        config = staged_photos_config({**declared, "photography": photography}, str(photos))
        stage_photos(config, out / row.pictures, base=base, blender=blender, jobs=max(1, cores() // 2))


def table(scores: Mapping[str, Sequence[float]]) -> Iterable[str]:
    """The lines of the table."""
    mean = {name: sum(values) / len(values) for name, values in scores.items()}
    yield from ("| exemplars | resemblance | each seed | of matched |", "|---|---:|---|---:|")
    for name, values in scores.items():
        same = [other for other in scores if ROWS[other].views == ROWS[name].views]
        ours = [mean[other] for other in same if ROWS[other].photography is None]
        of = f"{mean[name] / ours[0]:.2f}" if any(ours) else ""
        yield f"| {name} | {mean[name]:.2f} | {', '.join(f'{value:.2f}' for value in values)} | {of} |"


@click.command()
@click.argument("photos", type=click.Path(path_type=Path, dir_okay=False))
@click.option("-o", "--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--rows", default=",".join(FEW), show_default=True)
@click.option("--seeds", default="0,1,2", show_default=True)
@click.option("--blender", metavar="PROGRAM", help="As for `svbrdfgan dataset photograph`.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Programs at a time.")
@click.option("--workers", type=click.IntRange(1), help="Processes of each import.  [default: the cores over JOBS]")
def main(photos: Path, out: Path, rows: str, seeds: str, blender: str | None, jobs: int, workers: int | None) -> None:
    names, numbers = rows.split(","), [int(seed) for seed in seeds.split(",")]
    if strange := set(names) - ROWS.keys():
        raise click.ClickException(f"there is no row {', '.join(strange)}; known are {', '.join(ROWS)}.")
    (out / "logs").mkdir(parents=True, exist_ok=True)
    (out / "train.yaml").write_text(TRAIN)
    share, gpus = max(1, cores() // jobs), torch.cuda.device_count()
    work = Work(photos, blender, out, share, ("--workers", str(workers or share)), SimpleQueue())
    for job in range(jobs):
        work.free.put(str(job % gpus) if gpus else "")
    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(work.score, *zip(*((name, seed) for name in names for seed in numbers), strict=True)))

    def score(name: str, seed: int) -> float:
        return load_record(Evaluation, work.last_run(name, seed) / EVALUATION).generated.resemblance or 0.0

    lines = "\n".join(table({name: [score(name, seed) for seed in numbers] for name in names})) + "\n"
    (out / "table.md").write_text(lines)
    click.echo(lines, nl=False)


if __name__ == "__main__":
    main()
