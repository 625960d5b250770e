"""Runs all programs on all cases."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.programs import Figures, Program, faster
from svbrdfgan.errors import ConfigError
from svbrdfgan.plugins.probe import probe_all
from svbrdfgan.plugins.registry import RENDERERS, find_plugin, list_plugins
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.leftovers import scratch_folder

SLOW = ("numpy",)
"""Renderers that take minutes on the standard scene, and are measured only if named."""

log = logging.getLogger(__name__)

Maker = Callable[[Case], BenchScene]


@dataclass(frozen=True)
class Result:
    """The figures of one case.

    Attributes:
        vertices, faces: numbers in the scene.
        embedding_s: as in `BenchScene`.
        backends, peers: figures of the programs that ran.
    """

    case: Case
    vertices: int
    faces: int
    embedding_s: float
    backends: tuple[Figures, ...]
    peers: tuple[Figures, ...]

    @property
    def programs(self) -> tuple[Figures, ...]:
        """All figures, peers first."""
        return (*self.peers, *self.backends)


@dataclass(frozen=True)
class Bench:
    """Everything to measure.

    Attributes:
        makers: make the scenes, by the name that cases have for them.
        repeats: samples behind each median.
        spp: samples per pixel of peers whose command has no {spp}.
    """

    makers: Mapping[str, Maker]
    backends: tuple[Program, ...]
    peers: tuple[Program, ...]
    repeats: int
    spp: int

    def results(self, cases: Iterable[Case], display: Display) -> Iterator[Result]:
        """The result of each case, as soon as it is measured. Peers run before and after ours; the faster times count.

        Raises:
            ConfigError: a peer fits no case.
            BenchError: a program failed, or printed no figures.
            AssetError, EmbeddingError: a scene cannot be made.
        """
        cases = tuple(dict.fromkeys(cases))
        for peer in self.peers:
            if not any(peer.fits(case, self.spp) for case in cases):
                raise ConfigError(
                    f"{peer.title} can run none of the cases; put {{scene}} into its command, which becomes the path "
                    "of the scene's file, and --spp {spp}."
                )
        display.begin("programs", sum(self._runs(case) for case in cases))
        with scratch_folder() as folder:
            scenes = _Scenes(folder, self.makers)
            for first in {case.scene: case for case in reversed(cases)}.values():
                scenes.get(first)  # a mesh that cannot be used fails here, before anything is measured
            for case in cases:
                yield self._result(case, scenes, display)

    def _runs(self, case: Case) -> int:
        return len(self.backends) + 2 * sum(peer.fits(case, self.spp) for peer in self.peers)

    def _result(self, case: Case, scenes: _Scenes, display: Display) -> Result:
        scene, path = scenes.get(case)

        def run(program: Program) -> Figures:
            display.advance(0, f"{program.title}: {_briefly(case)}")
            figures = program.run(case, path, self.repeats)
            display.advance()
            return figures

        peers = [peer for peer in self.peers if peer.fits(case, self.spp)]
        before = [run(peer) for peer in peers]
        backends = tuple(run(program) for program in self.backends)
        after = [run(peer) for peer in peers]
        best = tuple(map(faster, before, after))
        return Result(case, len(scene.positions), len(scene.faces), scene.embedding_s, backends, best)


@dataclass
class _Scenes:
    """Scenes, in memory and in files; each is made once."""

    folder: Path
    makers: Mapping[str, Maker]
    made: dict[tuple[str, int | None], BenchScene] = field(default_factory=dict)

    def get(self, case: Case) -> tuple[BenchScene, Path]:
        key = (case.scene, case.vertices)
        if key not in self.made:
            self.made[key] = self.makers[case.scene](case)
        scene = self.made[key].with_film(case.pixels)
        path = self.folder / f"{list(self.made).index(key)}-{case.pixels}.npz"
        if not path.exists():
            scene.save(path)
        return scene, path


def working_backends() -> tuple[str, ...]:
    """The installed renderers that work here, without the slow ones. Each is tried in its own process.

    Raises:
        ConfigError: there is none.
    """
    candidates = [plugin for plugin in list_plugins(RENDERERS) if plugin.name not in SLOW]
    outcomes = dict(zip((plugin.name for plugin in candidates), probe_all(candidates), strict=True))
    for name, outcome in outcomes.items():
        if outcome.status != "ok":
            log.warning("%s is left out: %s", name, outcome.reason)
    if not (names := tuple(name for name, outcome in outcomes.items() if outcome.status == "ok")):
        raise ConfigError(
            f"no renderer works here except {', '.join(SLOW)}, which takes minutes; name it with --backend."
        )
    return names


def backend_programs(names: Iterable[str]) -> tuple[Program, ...]:
    """The renderers of these names.

    Raises:
        PluginError: one is unknown, claimed twice or damaged.
    """
    return tuple(Program.backend(find_plugin(RENDERERS, name).name) for name in names)


def _briefly(case: Case) -> str:
    vertices = "" if case.vertices is None else f", {case.vertices:,} vertices"
    batch = "" if case.batch == 1 else f", batch {case.batch}"
    return f"{case.scene}{vertices}, {case.pixels}x{case.pixels}, {case.spp} spp{batch}"
