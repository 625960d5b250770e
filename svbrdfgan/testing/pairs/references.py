"""Stored runs of a renderer that is too slow to run each time: the sums over blocks, not the scenes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.tensors import save_tensors, stored_tensors
from svbrdfgan.testing.pairs.compare import Runs
from svbrdfgan.testing.pairs.pair_scene import PairScene, same_scene
from svbrdfgan.testing.pairs.quantity import QUANTITIES

RUNS = 32
"""Independent runs stored apart, for the standard error; each round adds to all of them."""

SHIPPED = Path(__file__).parent / "numpy.safetensors"
"""Made by `python -m svbrdfgan.testing.pairs.make_reference`."""

NOT_STORED = frozenset({"glossy", "metallic", "normal-mapped"})
"""Scenes that `SHIPPED` lacks so far: their Jacobians need many core-hours of `numpy`. Fast renderers are compared."""

_FORMAT = "svbrdfgan pair reference 1"


@dataclass(frozen=True, eq=False)
class Stored:
    """Runs of one quantity in one scene.

    Attributes:
        values: the mean of each run over all rounds.
        rounds: which rounds are in it; a round is RUNS pictures of `samples` camera samples, with seeds of its own.
    """

    values: Float[ndarray, "runs blocks"]
    rounds: frozenset[int]
    samples: int

    @property
    def runs(self) -> Runs:
        return Runs(self.values, len(self.rounds) * RUNS * self.samples)

    def joined(self, other: Stored) -> Stored:
        """The runs of both together.

        Raises:
            AssetError: both share a round, which would be counted twice, or differ in samples.
        """
        if self.rounds & other.rounds or self.samples != other.samples:
            raise AssetError("two references share rounds or differ in samples; start one of them at another round.")
        count, more = len(self.rounds), len(other.rounds)
        values = (count * self.values + more * other.values) / (count + more)
        return replace(self, values=values, rounds=self.rounds | other.rounds)


@dataclass(frozen=True, eq=False)
class Reference:
    """Runs of one renderer, by scene and quantity.

    Attributes:
        fingerprints: of the scenes as they were.
        version: of the project that made them.
    """

    renderer: str
    version: str
    fingerprints: Mapping[str, str]
    stored: Mapping[tuple[str, str], Stored]

    def of(self, scene: PairScene) -> tuple[dict[str, Runs], str]:
        """The runs in a scene by quantity. Empty, with a reason, if they are missing or the scene has changed."""
        remedy = "run `python -m svbrdfgan.testing.pairs.make_reference`"
        found = {name: self.stored[scene.name, name].runs for name in QUANTITIES if (scene.name, name) in self.stored}
        if not found:
            return {}, f"the stored {self.renderer} reference has no {scene.name!r}: {remedy}."
        if not same_scene(self.fingerprints[scene.name], scene.fingerprint()):
            return {}, f"the stored {self.renderer} reference is of another {scene.name!r} than this: {remedy}."
        return found, ""

    def joined(self, other: Reference) -> Reference:
        """The runs of both together; of a scene about which they differ, only those of `other`."""
        theirs = other.fingerprints
        kept = {name for name, print_ in self.fingerprints.items() if same_scene(theirs.get(name, print_), print_)}
        stored = {key: value for key, value in self.stored.items() if key[0] in kept}
        for key, value in other.stored.items():
            stored[key] = stored[key].joined(value) if key in stored else value
        return replace(other, fingerprints={**self.fingerprints, **other.fingerprints}, stored=stored)

    def save(self, path: Path) -> None:
        """Writes one safetensors file, atomically. Blocks that are always zero take no room."""
        tensors, about = {}, {}
        for (scene, quantity), stored in self.stored.items():
            key = f"{scene}/{quantity}"
            seen = np.flatnonzero(stored.values.any(axis=0))
            tensors[key] = torch.from_numpy(stored.values[:, seen].astype(np.float32))
            tensors[f"{key}/blocks"] = torch.from_numpy(seen.astype(np.int32))
            about[key] = {"rounds": sorted(stored.rounds), "samples": stored.samples, "blocks": stored.values.shape[1]}
        meta = {"renderer": self.renderer, "version": self.version, "scenes": dict(self.fingerprints), "stored": about}
        save_tensors(path, _FORMAT, tensors, {"about": json.dumps(meta)})


def load_reference(path: Path = SHIPPED) -> Reference:
    """The reference that `Reference.save` wrote.

    Raises:
        AssetError: the file is missing, damaged, or of another kind.
    """
    with stored_tensors(path, _FORMAT, "make it again") as (tensors, words):
        meta: dict[str, Any] = json.loads(words["about"])
        stored = {_split(key): _unpacked(tensors, key, about) for key, about in meta["stored"].items()}
        reference = Reference(meta["renderer"], meta["version"], meta["scenes"], stored)
    return reference


def _split(key: str) -> tuple[str, str]:
    scene, _, quantity = key.rpartition("/")
    return scene, quantity


def _unpacked(tensors: Mapping[str, Tensor], key: str, about: Mapping[str, Any]) -> Stored:
    values = np.zeros((RUNS, about["blocks"]))
    values[:, tensors[f"{key}/blocks"].numpy()] = tensors[key].numpy()
    return Stored(values, frozenset(about["rounds"]), about["samples"])
