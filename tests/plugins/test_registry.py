"""One broken plugin never breaks another, nor the listing; each failure is one sentence."""

import logging
import os
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan.plugins import select
from svbrdfgan.plugins.probe import probe, probe_all
from svbrdfgan.plugins.registry import (
    EMBEDDINGS,
    RENDERERS,
    Plugin,
    find_plugin,
    list_plugins,
    load_embedding,
    load_renderer,
)
from svbrdfgan.protocols import Renderer, UVCapabilities, UVEmbedding

EMBEDDING = """
from svbrdfgan.protocols import UVCapabilities
class Made:
    capabilities = UVCapabilities(injective=True, subdivides=False)
    def __init__(self, *, size: int = 3):
        self.size = size
    def embed(self, mesh): ...
"""
RENDERER = """
import torch
from svbrdfgan.protocols import RendererCapabilities
both = frozenset({"base_color", "roughness"})
class Made:
    capabilities = RendererCapabilities()
    device = torch.device("cpu")
    def prepare(self, surface): ...
    def render(self, prepared, materials, view, *, spp, seed): ...
    def render_vjp(self, prepared, materials, view, grad_image, *, wrt, spp, seed): ...
"""

Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Puts a distribution, as metadata and a module, on the path."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def make(
        name: str, source: str = EMBEDDING, entry: str | None = None, group: str = EMBEDDINGS, to: str = ""
    ) -> Path:
        folder = tmp_path / to
        info = folder / f"{name}-1.0.dist-info"
        info.mkdir(parents=True)
        (folder / f"plug_{name}.py").write_text(source)
        (info / "entry_points.txt").write_text(f"[{group}]\n{entry or f'{name} = plug_{name}:Made'}\n")
        return folder

    yield make
    for module in [module for module in sys.modules if module.startswith("plug_")]:
        del sys.modules[module]


def rows(group: str = EMBEDDINGS) -> dict[str, list[Plugin]]:
    found: dict[str, list[Plugin]] = {}
    for plugin in list_plugins(group):
        found.setdefault(plugin.name, []).append(plugin)
    return found


def refusal(name: str, **options: object) -> str:
    with pytest.raises(PluginError) as caught:
        load_embedding(name, options)
    return str(caught.value)


class TestListing:
    def test_metadata_alone(self, install: Install) -> None:
        install("quiet", "raise RuntimeError('imported')")
        assert rows()["quiet"] == [Plugin("quiet", EMBEDDINGS, "quiet", "1.0", "plug_quiet:Made")]
        assert "plug_quiet" not in sys.modules

    def test_the_in_tree_plugins_come_through_the_same_door(self) -> None:
        assert {"numpy", "warp"} <= {p.name for p in list_plugins(RENDERERS) if p.distribution == "svbrdfgan"}
        assert [p.problem for p in rows()["hemispherical"]] == [None]

    def test_a_malformed_distribution_is_shown_and_disturbs_nothing(self, install: Install) -> None:
        install("good")
        install("bad", entry="this line means nothing")
        install("twice", entry="a = m:x\na = m:y")
        found = rows()
        assert found["good"][0].problem is None
        assert "malformed" in str(found["bad"][0].problem)
        assert "malformed" in str(found["twice"][0].problem)
        assert refusal("a").endswith("reinstall twice.")

    def test_a_malformed_stranger_is_logged(self, install: Install, caplog: pytest.LogCaptureFixture) -> None:
        install("stranger", entry="nonsense", group="console_scripts")
        assert "stranger" not in rows()
        assert "stranger: its entry_points.txt is malformed" in caplog.text

    def test_bytes_that_are_no_text(self, install: Install) -> None:
        folder = install("latin", entry="latin = plug_latin:Made")
        (folder / "latin-1.0.dist-info/entry_points.txt").write_bytes(
            b"# \xe4\n[svbrdfgan.uv_embeddings]\nlatin = a:b\n"
        )
        assert rows()["latin"][0].problem is None

    def test_a_malformed_target(self, install: Install) -> None:
        install("target", entry="target = not a target!\nfine = plug_target:Made")
        assert "'not a target!' is malformed" in str(rows()["target"][0].problem)
        assert rows()["fine"][0].problem is None

    def test_a_percent_sign_is_no_interpolation(self, install: Install) -> None:
        install("percent", entry="percent = %(x)s\nfine = plug_percent:Made")
        assert rows()["fine"][0].problem is None

    def test_the_first_of_a_distribution_counts(self, install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
        install("same")
        old = install("same", to="old")
        monkeypatch.setattr(sys, "path", [*sys.path, str(old)])
        assert [p.problem for p in rows()["same"]] == [None]

    def test_zips_and_eggs(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        entry = f"[{EMBEDDINGS}]\n"
        with zipfile.ZipFile(tmp_path / "lib.zip", "w") as archive:
            archive.writestr("Zipped_Kit-2.0.dist-info/entry_points.txt", entry + "zipped = a:b")
        with zipfile.ZipFile(tmp_path / "egg-3.0-py3.11.egg", "w") as archive:
            archive.writestr("EGG-INFO/entry_points.txt", entry + "egg = a:b")
        (tmp_path / "folder-4.0.egg/EGG-INFO").mkdir(parents=True)
        (tmp_path / "folder-4.0.egg/EGG-INFO/entry_points.txt").write_text(entry + "folder = a:b")
        (tmp_path / "not.zip").write_text("nothing")
        names = ["lib.zip", "egg-3.0-py3.11.egg", "folder-4.0.egg", "not.zip", "missing"]
        monkeypatch.setattr(sys, "path", [*sys.path, *(str(tmp_path / name) for name in names)])
        found = rows()
        assert [found[n][0].origin for n in ("zipped", "egg", "folder")] == ["zipped-kit 2.0", "egg 3.0", "folder 4.0"]

    def test_a_name_claimed_twice_names_both(self, install: Install) -> None:
        install("one", entry="mine = plug_one:Made\nother = plug_one:Made")
        install("two", entry="mine = plug_two:Made")
        assert "claimed by one 1.0 and two 1.0" in refusal("mine")
        assert [bool(plugin.problem) for plugin in rows()["mine"]] == [True, True]
        assert isinstance(load_embedding("other"), UVEmbedding)

    def test_no_distribution_owns_its_names(self, install: Install) -> None:
        install("intruder", RENDERER, entry="numpy = plug_intruder:Made", group=RENDERERS)
        with pytest.raises(PluginError, match=r"claimed by intruder 1\.0 and svbrdfgan [0-9.]+; uninstall one of them"):
            load_renderer("numpy")
        assert "plug_intruder" not in sys.modules
        assert [plugin.problem for plugin in rows(RENDERERS)["warp"]] == [None]

    def test_a_renderer_and_an_embedding_may_share_a_name(self, install: Install) -> None:
        install("both")
        install("second", RENDERER, entry="both = plug_second:Made", group=RENDERERS)
        assert isinstance(load_embedding("both"), UVEmbedding)
        assert isinstance(load_renderer("both"), Renderer)


class TestLoading:
    def test_makes_the_chosen_one_with_its_options(self, install: Install) -> None:
        install("good")
        install("unasked", "raise RuntimeError('imported')")
        made = load_embedding("good", {"size": 5})
        assert made.capabilities == UVCapabilities(injective=True, subdivides=False)
        assert made.size == 5  # type: ignore[attr-defined]

    def test_options_are_checked(self, install: Install) -> None:
        install("good")
        with pytest.raises(ConfigError, match=r"good: unknown key 'sice'; did you mean 'size'\?"):
            load_embedding("good", {"sice": 5})
        with pytest.raises(
            ConfigError, match=r"train.yaml: embedding.options.size: '5' is not allowed; wanted an integer"
        ):
            load_embedding("good", {"size": "5"}, "train.yaml: embedding.options")

    def test_an_unknown_name(self) -> None:
        text = refusal("hemisferical")
        assert "did you mean 'hemispherical'?" in text
        assert "installed are " in text

    @pytest.mark.parametrize(
        ("source", "wanted"),
        [
            (
                "import nowhere_to_be_found.part",
                "needs nowhere_to_be_found, which is not installed: pip install 'bad[bad]'.",
            ),
            ("import plug_bad.part", "reinstall bad."),
            ("import svbrdfgan.never", "No module named 'svbrdfgan.never'"),
            ("from math import tau, nonsense", "ImportError: cannot import name 'nonsense'"),
            ("raise ValueError('first\\nsecond')", "cannot be imported: ValueError: first"),
            ("raise SystemExit('bye')", "SystemExit: bye"),
            ("this is no Python", "SyntaxError"),
            ("Other = 1", "AttributeError"),
            ("Made = 1", "plug_bad:Made is not a class or function"),
            ("class Made: ...", "it lacks capabilities, embed"),
            (EMBEDDING.replace("UVCapabilities(injective=True, subdivides=False)", "{}"), "its capabilities are no "),
            ("class Made:\n    def __init__(self): raise OSError('no driver')", "cannot be made: OSError: no driver"),
            ("class Made:\n    def __init__(self): import nowhere_at_all", "pip install 'bad[bad]'"),
            (
                "from __future__ import annotations\nclass Made:\n    def __init__(self, x: Absent = 1): ...",
                "annotations",
            ),
        ],
    )
    def test_a_broken_plugin_is_one_sentence(self, install: Install, source: str, wanted: str) -> None:
        install("bad", source)
        text = refusal("bad")
        assert wanted in text
        assert "embedding 'bad' (bad 1.0)" in text
        assert "\n" not in text

    @pytest.mark.parametrize(
        ("source", "wanted"),
        [
            (
                "import nowhere_to_be_found",
                "needs nowhere_to_be_found, which is not installed: pip install 'bad[bad]'.",
            ),
            ("raise RuntimeError('no LLVM')", "cannot be imported: RuntimeError: no LLVM"),
            (EMBEDDING, "it is not a svbrdfgan.protocols.Renderer; it lacks device, prepare, render, render_vjp."),
            (RENDERER.replace("RendererCapabilities()", "'all'"), "its capabilities are no svbrdfgan.protocols."),
        ],
    )
    def test_a_broken_renderer_likewise(self, install: Install, source: str, wanted: str) -> None:
        install("bad", source, group=RENDERERS)
        with pytest.raises(PluginError) as caught:
            load_renderer("bad")
        assert wanted in str(caught.value)
        assert "renderer 'bad' (bad 1.0)" in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_a_backend_without_its_package_names_its_extra(self) -> None:
        code = (
            "import sys; sys.modules['warp'] = None\n"
            "from svbrdfgan.plugins.registry import load_renderer\n"
            "try: load_renderer('warp')\n"
            "except Exception as error: print(type(error).__name__, error)\n"
            "print(load_renderer('numpy').capabilities.max_bounces)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        refused, works = done.stdout.splitlines()
        assert refused.startswith("MissingDependencyError renderer 'warp' (svbrdfgan ")
        assert refused.endswith("needs warp, which is not installed: pip install 'svbrdfgan[warp]'.")
        assert works == "1"


CRASHES = {
    "abort": ("import os; os.abort()", "SIGABRT"),
    "segfault": ("import ctypes; ctypes.string_at(0)", "SIGSEGV"),
    "leaves": ("import os; os._exit(0)", "exit code 0"),
    "missing": ("import nowhere_to_be_found", "pip install 'missing[missing]'"),
    "raises": ("raise ValueError('broken here')", "broken here"),
}


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
class TestProbe:
    def test_crashes_are_reported_beside_a_noisy_one_that_works(self, install: Install) -> None:
        for name, (source, _) in CRASHES.items():
            install(name, source)
        noise = "import os, sys\nprint('{}' * 100000)\nos.write(1, b'garbage')\nprint('oops', file=sys.stderr)\n"
        install("noisy", noise + EMBEDDING)
        plugins = [find_plugin(EMBEDDINGS, name) for name in [*CRASHES, "noisy"]]
        *crashed, noisy = probe_all(plugins)
        assert [p.status for p in crashed] == ["broken", "broken", "broken", "missing", "broken"]
        for outcome, (_, wanted) in zip(crashed, CRASHES.values(), strict=True):
            assert wanted in str(outcome.reason)
        assert (noisy.status, noisy.reason) == ("ok", None)
        assert noisy.capabilities == {"injective": True, "subdivides": False}

    @pytest.mark.full
    def test_a_hang_ends_with_the_children_it_started(
        self, install: Install, ended: Callable[[int], bool], tmp_path: Path
    ) -> None:
        source = (
            "import pathlib, subprocess, sys, time\n"
            "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
            "pathlib.Path(__file__).with_name('child').write_text(str(child.pid))\n"
            "time.sleep(600)\n"
        )
        install("hangs", source)
        started = time.monotonic()
        outcome = probe(find_plugin(EMBEDDINGS, "hangs"), timeout=15)  # enough to start Python twice on a busy machine
        assert time.monotonic() - started < 60
        assert (outcome.status, "within 15 s" in str(outcome.reason)) == ("broken", True)
        assert ended(int((tmp_path / "child").read_text()))

    def test_a_known_problem_starts_no_process(self, install: Install) -> None:
        install("target", entry="target = not a target!")
        outcome = probe(rows()["target"][0], timeout=0)
        assert outcome.status == "broken"
        assert "malformed" in str(outcome.reason)


class TestChoice:
    def test_falls_to_the_next_and_says_why(
        self, install: Install, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        install("fast", "import os; os.abort()", group=RENDERERS)
        install("able", RENDERER, group=RENDERERS)
        monkeypatch.setattr(select, "RANKING", dict.fromkeys(("cpu", "cuda"), ("absent", "fast", "able")))
        caplog.set_level(logging.INFO)
        assert select.select_renderer("cpu") == PluginChoice(name="able")
        assert "'fast' is not used on cpu" in caplog.text
        assert "SIGABRT" in caplog.text
        assert isinstance(load_renderer("able"), Renderer)

    @pytest.mark.full
    def test_one_without_the_maps_is_passed_over(
        self, install: Install, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        for name, able in {"plain": "", "reads": "maps=both", "learns": "maps=both, differentiable=both"}.items():
            install(name, RENDERER.replace("Capabilities()", f"Capabilities({able})"), group=RENDERERS)
        monkeypatch.setattr(select, "RANKING", dict.fromkeys(("cpu", "cuda"), ("plain", "reads", "learns")))
        caplog.set_level(logging.INFO)
        assert select.select_renderer("cpu").name == "plain"
        assert select.select_renderer("cpu", ["roughness"]).name == "reads"
        assert select.select_renderer("cpu", ["roughness"], differentiable=True).name == "learns"
        assert "'plain' is not used on cpu: roughness is not in its maps." in caplog.text
        assert "'reads' is not used on cpu: roughness is not in its differentiable." in caplog.text
        three = tuple(find_plugin(RENDERERS, name) for name in ("plain", "reads", "learns"))
        monkeypatch.setattr(select, "list_plugins", lambda group: three)
        with pytest.raises(PluginError, match=r"\n  learns on cpu: metallic, sheen are not in its maps\."):
            select.select_renderer("cpu", ["sheen", "roughness", "metallic"])

    def test_none_works(self, install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
        install("able", RENDERER, group=RENDERERS)
        able = find_plugin(RENDERERS, "able")
        monkeypatch.setattr(select, "list_plugins", lambda group: (able,))
        with pytest.raises(PluginError, match=r"works on 'cuda':\n  able on cuda: .* runs on cpu, not on cuda\."):
            select.select_renderer("cuda")

    def test_names_not_ranked_come_last(self) -> None:
        plugins = tuple(
            Plugin(name, RENDERERS, "d", None, "m:o") for name in ("zeta", "numpy", "alpha", "warp", "mitsuba")
        )
        assert [p.name for p in select._ranked(plugins, "cuda")] == ["warp", "mitsuba", "numpy", "alpha", "zeta"]


@pytest.mark.full
def test_required_backends_work() -> None:
    """SVBRDFGAN_REQUIRED_BACKENDS names renderers that this machine must have; nothing may quietly skip them."""
    names = os.environ.get("SVBRDFGAN_REQUIRED_BACKENDS", "").split()
    if not names:
        pytest.skip("SVBRDFGAN_REQUIRED_BACKENDS is not set: name the renderers that must work here")
    outcomes = probe_all([find_plugin(RENDERERS, name) for name in names])
    assert {n: o.reason for n, o in zip(names, outcomes, strict=True)} == dict.fromkeys(names)
