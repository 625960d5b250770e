"""The table: every pair of renderers in every scene, and whether they agree."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np

from svbrdfgan.plugins.probe import probe_all
from svbrdfgan.plugins.registry import RENDERERS, list_plugins, load_bouncing
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.testing.pairs.compare import Comparison, Runs, compare
from svbrdfgan.testing.pairs.pair_scene import SCENES, PairScene, SceneUnavailableError, make_scene
from svbrdfgan.testing.pairs.quantity import QUANTITIES, RenderedScene, offered
from svbrdfgan.testing.pairs.references import NOT_STORED, Reference
from svbrdfgan.testing.pairs.sampling import Aim, Profile, sample

Verdict = Literal["agree", "differ", "underpowered", "stale", "skipped"]

STORED = "*"
"""Marks the stored reference of a renderer, after its name."""

LIVE_SCENES = ("convex", "occluding")
"""Scenes in which a renderer is compared with its own stored reference, in sums alone, to detect an outdated one."""

_LIVE = Profile("live", of_sum=0.01, of_block=np.inf, runs=24, limit=2**21)

Measured = Mapping[str, Runs]  # by quantity
Maker = Callable[[int], "CheckedRenderer | None"]
"""Makes a renderer with this `max_bounces`; None if it cannot."""


@dataclass(frozen=True, eq=False)
class Row:
    """One pair in one scene.

    Attributes:
        pair: their names; empty where there was nothing to compare.
        comparisons: one for each quantity that both have.
        samples: of each of the two, for the quantity that took most.
        reason: why there are no comparisons; empty where there are.
    """

    scene: str
    pair: tuple[str, ...]
    verdict: Verdict
    comparisons: tuple[Comparison, ...] = ()
    samples: tuple[int, ...] = ()
    reason: str = ""

    @property
    def failed(self) -> bool:
        return self.verdict not in ("agree", "skipped")


@dataclass(frozen=True, eq=False)
class Table:
    """The comparisons to make, and how strict they are.

    Attributes:
        makers: of every renderer to run, by name.
        reference: stored runs of one renderer, which is then run only to check that they are still valid.
        only: pairs that have none of these renderers are left out; empty means all.
    """

    profile: Profile
    makers: Mapping[str, Maker]
    reference: Reference | None = None
    only: frozenset[str] = field(default_factory=frozenset)

    @property
    def stored_name(self) -> str:
        return self.reference.renderer if self.reference else ""

    @cached_property
    def family(self) -> int:
        """The number of comparisons in the whole table, whichever rows are wanted."""
        return comparisons(len({*self.makers, self.stored_name} - {""}))

    def rows(self, scene_name: str) -> Iterator[Row]:
        """The rows of one scene, as they are found."""
        try:
            scene = make_scene(scene_name)
        except SceneUnavailableError as error:
            yield Row(scene_name, (), "skipped", reason=str(error))
            return
        stored, reason = self.reference.of(scene) if self.reference else ({}, "")
        live = [name for name in self.makers if name != self.stored_name]
        rendered_scenes = [
            rendered for rendered in (prepared(name, self.makers[name], scene) for name in live) if rendered
        ]
        if reason and scene_name in NOT_STORED:
            yield Row(scene_name, (self.stored_name,), "skipped", reason=reason)
        elif reason:
            yield Row(scene_name, (self.stored_name,), "stale", reason=reason)
        if len(rendered_scenes) + bool(stored) < 2 or not rendered_scenes:
            names = ", ".join(
                [rendered.name for rendered in rendered_scenes] + [self.stored_name + STORED] * bool(stored)
            )
            maps = ", ".join(sorted(scene.maps))
            reason = f"no two renderers follow {scene.max_bounces} bounces and read {maps}: only {names or 'none'}."
            yield Row(scene_name, (), "skipped", reason=reason)
        else:
            yield from self._compared(scene, rendered_scenes, stored)
        if stored and scene_name in LIVE_SCENES and self.stored_name in self.makers and self._wanted(self.stored_name):
            yield from self._against_itself(scene, stored)

    def _wanted(self, *pair: str) -> bool:
        return not self.only or bool(self.only & set(pair))

    def _compared(self, scene: PairScene, rendered_scenes: Sequence[RenderedScene], stored: Measured) -> Iterator[Row]:
        """Rows of the pairs; each renderer is sampled once, well enough for all its pairs."""
        measured: dict[str, Measured] = {self.stored_name + STORED: stored} if stored else {}
        for rendered in rendered_scenes:
            rivals = [
                rival for rival in rendered_scenes if rival is not rendered and self._wanted(rendered.name, rival.name)
            ]
            against = stored if self._wanted(rendered.name, self.stored_name) else {}
            if not rivals and not against:
                continue
            measured[rendered.name] = self._measured(self.profile, rendered, rivals, against)
        for a, b in combinations(sorted(measured, key=lambda name: name.endswith(STORED)), 2):
            if self._wanted(a, b.removesuffix(STORED)):
                yield self._row(self.profile, scene, (a, b), measured)

    def _against_itself(self, scene: PairScene, stored: Measured) -> Iterator[Row]:
        name = self.stored_name
        if rendered := prepared(name, self.makers[name], scene):
            measured = {name: self._measured(_LIVE, rendered, [], stored), name + STORED: stored}
            yield self._row(_LIVE, scene, (name, name + STORED), measured)

    def _measured(
        self, profile: Profile, rendered: RenderedScene, rivals: Sequence[RenderedScene], stored: Measured
    ) -> dict[str, Runs]:
        """Runs of every quantity that another has too."""
        runs = {}
        for name, quantity in QUANTITIES.items():
            contested = any(offered(rival.renderer, quantity) for rival in rivals)
            references = [stored[name]] if name in stored else []
            if offered(rendered.renderer, quantity) and (contested or references):
                runs[name] = sample(rendered, quantity, Aim(profile, self.family, contested, references))
        return runs

    def _row(self, profile: Profile, scene: PairScene, pair: tuple[str, str], measured: Mapping[str, Measured]) -> Row:
        a, b = (measured[name] for name in pair)
        shared = [name for name in QUANTITIES if name in a and name in b]
        found = tuple(
            compare(a[name], b[name], QUANTITIES[name], scene, profile.tolerances, self.family) for name in shared
        )
        most = tuple(max(side[name].samples for name in shared) for side in (a, b))
        return Row(scene.name, pair, _verdict(found), found, most)


def comparisons(renderers: int) -> int:
    """The number of comparisons in a table of this many renderers: every pair, and one renderer with its reference."""
    scenes = [scene for scene in map(_available, SCENES) if scene]
    blocks = sum(quantity.size(scene) + 1 for scene in scenes for quantity in QUANTITIES.values())
    return blocks * (renderers * (renderers - 1) // 2 + 1)


def installed_renderers(device: str | None = None) -> dict[str, Maker]:
    """Makers of the renderers that work here, on the device if one is named. Each is probed in its own process."""
    plugins = list_plugins(RENDERERS)
    probes = zip(plugins, probe_all(plugins, device), strict=True)
    return {plugin.name: maker(plugin.name, probe.options) for plugin, probe in probes if probe.status == "ok"}


def maker(name: str, options: Mapping[str, object]) -> Maker:
    """A maker of the installed renderer of that name; returns None if the renderer cannot do `max_bounces`."""

    def make(max_bounces: int) -> CheckedRenderer | None:
        renderer = load_bouncing(name, options, max_bounces)
        return renderer if renderer.capabilities.max_bounces == max_bounces else None

    return make


def prepared(name: str, make: Maker, scene: PairScene) -> RenderedScene | None:
    """The renderer with the scene prepared; None if it cannot do the scene's `max_bounces`, or lacks a map."""
    renderer = make(scene.max_bounces)
    if renderer is None or not scene.maps <= renderer.capabilities.maps:
        return None
    return RenderedScene(name, renderer, renderer.prepare(scene.surface), scene)


def _verdict(found: Sequence[Comparison]) -> Verdict:
    if any(comparison.differs.any() for comparison in found):
        return "differ"
    return "underpowered" if any(comparison.underpowered.any() for comparison in found) else "agree"


def _available(name: str) -> PairScene | None:
    try:
        return make_scene(name)
    except SceneUnavailableError:
        return None
