"""Renderers and UV embeddings by name: listing the installed ones, and making one.

Listing reads installed metadata only; a plugin is imported when it is made. Each distribution is read on its own, so
that a damaged one is reported and hides no other.
"""

from __future__ import annotations

import configparser
import logging
import re
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import entrypoints

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import build
from svbrdfgan.errors import ConfigError, PluginError, SvbrdfganError

if TYPE_CHECKING:
    from svbrdfgan.protocols import Renderer, UVEmbedding
    from svbrdfgan.rendering.checked_renderer import CheckedRenderer

RENDERERS = "svbrdfgan.renderers"
EMBEDDINGS = "svbrdfgan.uv_embeddings"
_NOUNS = {RENDERERS: "renderer", EMBEDDINGS: "embedding"}
_NO_OPTIONS: Mapping[str, object] = MappingProxyType({})

log = logging.getLogger(__name__)


class MissingDependencyError(PluginError):
    """A plugin is installed, but a package that it needs is not."""


@dataclass(frozen=True)
class Plugin:
    """An entry point, as its distribution's metadata declares it.

    Attributes:
        target: "module:object"; empty if the metadata cannot be read, and then `name` is the distribution's.
        problem: why it cannot be made, as far as metadata shows; None if nothing is wrong.
    """

    name: str
    group: str
    distribution: str
    version: str | None
    target: str
    problem: str | None = None

    @property
    def origin(self) -> str:
        return " ".join(filter(None, (self.distribution, self.version)))

    @property
    def title(self) -> str:
        return f"{_NOUNS.get(self.group, 'plugin')} {self.name!r} ({self.origin})"


def list_plugins(group: str) -> tuple[Plugin, ...]:
    """The installed plugins of the group, sorted by name. None of them is imported."""
    found = [plugin for distribution, text in _distributions() for plugin in _read(group, distribution, text)]
    return tuple(sorted(_refuse_clashes(found), key=lambda plugin: (plugin.name, plugin.distribution)))


def find_plugin(group: str, name: str) -> Plugin:
    """The plugin of that name.

    Raises:
        PluginError: no plugin has the name, two distributions claim it, or its metadata is damaged.
    """
    plugins = list_plugins(group)
    found = next((plugin for plugin in plugins if plugin.name == name), None)
    if found is None:
        raise PluginError(_unknown(group, name, plugins))
    if found.problem:
        raise PluginError(f"{found.title} cannot be used: {found.problem}")
    return found


def load_renderer(name: str, options: Mapping[str, object] = _NO_OPTIONS, path: str | None = None) -> CheckedRenderer:
    """The renderer of that name, made with the options and with its defaults for the others, behind the core's checks.

    Messages name options by `path`, such as "train.yaml: renderer.options"; by default it is the plugin's name.

    Raises:
        PluginError: it is unknown, claimed twice, broken, or lacks a dependency.
        ConfigError: an option is unknown, of the wrong type, or impossible.
    """
    from svbrdfgan.rendering.checked_renderer import CheckedRenderer  # imports torch, which listing plugins can spare

    return CheckedRenderer(cast("Renderer[Any]", make(find_plugin(RENDERERS, name), options, path)), name)


def load_bouncing(name: str, options: Mapping[str, object], bounces: int | None) -> CheckedRenderer:
    """The renderer of that name that follows so many scattering events; with its options alone if it cannot.

    Raises:
        PluginError, ConfigError: as for `load_renderer`.
    """
    if bounces is not None:
        with suppress(ConfigError):  # it has no such option, or does not follow so many
            return load_renderer(name, {**options, "max_bounces": bounces})
    return load_renderer(name, options)


def load_embedding(name: str, options: Mapping[str, object] = _NO_OPTIONS, path: str | None = None) -> UVEmbedding:
    """The UV embedding of that name; arguments and errors are as for `load_renderer`."""
    return cast("UVEmbedding", make(find_plugin(EMBEDDINGS, name), options, path))


def import_factory(plugin: Plugin) -> Callable[..., object]:
    """The class or function that the plugin's entry point names. Imports the plugin."""
    with _as_plugin_errors(plugin, "be imported"):
        factory = entrypoints.EntryPoint.from_string(plugin.target, plugin.name).load()
    if not callable(factory):
        raise PluginError(f"{plugin.title} is broken: {plugin.target} is not a class or function.")
    return cast("Callable[..., object]", factory)


def make(plugin: Plugin, options: Mapping[str, object] = _NO_OPTIONS, path: str | None = None) -> object:
    """The plugin's object, made with options that are validated, and checked against its protocol."""
    factory = import_factory(plugin)
    with _as_plugin_errors(plugin, "be made"):
        made = build(factory, options, path or plugin.name)
        _check_protocol(plugin, made)
    return made


def _check_protocol(plugin: Plugin, made: Any) -> None:
    from svbrdfgan import protocols  # here, since it imports torch

    protocol, record = {
        RENDERERS: (protocols.Renderer, protocols.RendererCapabilities),
        EMBEDDINGS: (protocols.UVEmbedding, protocols.UVCapabilities),
    }[plugin.group]
    lacking = sorted(name for name in vars(protocol) if not name.startswith("_") and name not in dir(made))
    fits: bool = isinstance(made, protocol)
    if lacking or not fits:
        wanted = f"svbrdfgan.protocols.{protocol.__name__}"
        raise PluginError(
            f"{plugin.title} is broken: it is not a {wanted}; it lacks {', '.join(lacking) or 'a member'}."
        )
    if not isinstance(made.capabilities, record):
        raise PluginError(f"{plugin.title} is broken: its capabilities are no svbrdfgan.protocols.{record.__name__}.")


@contextmanager
def _as_plugin_errors(plugin: Plugin, doing: str) -> Iterator[None]:
    try:
        yield
    except SvbrdfganError:
        raise
    except ModuleNotFoundError as error:
        root = (error.name or "").split(".")[0]
        if root in ("", "svbrdfgan", re.split(r"[.:]", plugin.target)[0]):
            raise PluginError(f"{plugin.title} cannot {doing}: {error}; reinstall {plugin.distribution}.") from error
        command = f"pip install '{plugin.distribution}[{plugin.name}]'"
        raise MissingDependencyError(f"{plugin.title} needs {root}, which is not installed: {command}.") from error
    except (Exception, SystemExit) as error:
        reason = (str(error).strip().splitlines() or ["no message"])[0]
        raise PluginError(f"{plugin.title} cannot {doing}: {type(error).__name__}: {reason}") from error


def _unknown(group: str, name: str, plugins: tuple[Plugin, ...]) -> str:
    names = sorted({plugin.name for plugin in plugins if plugin.target})
    unreadable = [f" {plugin.origin} may hold it, but {plugin.problem}" for plugin in plugins if not plugin.target]
    known = f"installed are {', '.join(names)}." if names else "none is installed."
    return f"{_NOUNS.get(group, 'plugin')} {name!r} is unknown{did_you_mean(name, names)}; {known}{''.join(unreadable)}"


def _distributions() -> Iterator[tuple[entrypoints.Distribution, str]]:
    """The installed distributions, of each name the first on the path, with the text of their entry_points.txt."""
    seen: set[str] = set()
    for folder in sys.path:
        for label, info in _metadata_folders(Path(folder or ".")):
            distribution = entrypoints.Distribution.from_name_version(label)
            distribution.name = re.sub(r"[-_.]+", "-", distribution.name).lower()
            distribution.version = (distribution.version or "").split("-")[0] or None
            if distribution.name not in seen:
                seen.add(distribution.name)
                yield distribution, _text(info / "entry_points.txt")


def _metadata_folders(folder: Path) -> list[tuple[str, Path | zipfile.Path]]:
    """The "name-version" and metadata folder of each distribution in a directory, a zip file or an egg."""
    try:
        zipped = folder.is_file() and zipfile.is_zipfile(folder)
        root = zipfile.Path(folder) if zipped else folder
        if folder.suffix == ".egg":
            return [(folder.stem, root / "EGG-INFO")]
        items = [item for item in root.iterdir() if item.name.endswith((".dist-info", ".egg-info"))]
    except OSError:
        return []
    return sorted(((item.name.rpartition(".")[0], item) for item in items), key=lambda pair: pair[0])


def _text(path: Path | zipfile.Path) -> str:
    try:
        return path.read_bytes().decode("utf-8", errors="replace")
    except (OSError, KeyError):
        return ""


def _read(group: str, distribution: entrypoints.Distribution, text: str) -> Iterator[Plugin]:
    config = entrypoints.CaseSensitiveConfigParser(delimiters=("=",))
    origin = (group, distribution.name, distribution.version)
    try:
        config.read_string(text)
    except configparser.Error as error:
        problem = f"its entry_points.txt is malformed ({str(error).splitlines()[0]}); reinstall {distribution.name}."
        log.warning("%s: %s", distribution.name, problem)
        if f"[{group}]" in text:
            yield Plugin(distribution.name, *origin, "", problem)
        return
    if config.has_section(group):
        for name, target in config.items(group, raw=True):
            yield Plugin(name, *origin, target, _target_problem(name, target))


def _target_problem(name: str, target: str) -> str | None:
    try:
        entrypoints.EntryPoint.from_string(target, name)
    except entrypoints.BadEntryPoint:
        return f"its entry point {target!r} is malformed; wanted 'module:object'."
    return None


def _refuse_clashes(plugins: list[Plugin]) -> Iterator[Plugin]:
    claims = Counter(plugin.name for plugin in plugins if plugin.target)
    for plugin in plugins:
        if plugin.target and claims[plugin.name] > 1:
            rivals = " and ".join(
                sorted(rival.origin for rival in plugins if rival.name == plugin.name and rival.target)
            )
            yield replace(plugin, problem=f"the name {plugin.name!r} is claimed by {rivals}; uninstall one of them.")
        else:
            yield plugin
