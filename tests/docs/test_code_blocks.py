"""The examples of the pages work: Python runs, commands parse, tables agree with what is installed."""

import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
import torch

from svbrdfgan.cli import COMMANDS, main
from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.data.config import dataset_config
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.training.config import train_config

REPOSITORY = Path(__file__).parents[2]
PAGES = ["README.md", *sorted(page.relative_to(REPOSITORY).as_posix() for page in REPOSITORY.glob("docs/**/*.md"))]
Run = Callable[[str], dict[str, Any]]


@pytest.fixture
def run(code_blocks: Callable[[str, str], list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs the one Python block of a page in an empty folder and returns its names."""
    monkeypatch.chdir(tmp_path)

    def run_page(page: str) -> dict[str, Any]:
        (block,) = code_blocks(page, "python")
        names: dict[str, Any] = {}
        exec(compile(block, page, "exec"), names)
        return names

    return run_page


@pytest.mark.full
def test_the_example_of_the_readme(run: Run) -> None:
    names = run("README.md")
    assert names["layer"].values.grad.abs().sum() > 0
    assert 0.1 < float((names["picture"].coverage > 0).float().mean()) < 0.9  # the van fills the picture, within it
    assert len(load_mesh("dirty_van.glb").faces) >= len(names["mesh"].faces)
    assert Path("dirty_van.layer.png").is_file()
    assert Path("dirty_van.png").is_file()


@pytest.mark.full
def test_the_example_of_the_quickstart(run: Run) -> None:
    names = run("docs/quickstart.md")
    assert names["evaluated"].evaluation.subjects == 1
    assert Path("run/report.html").is_file()
    assert Path("weathered.glb").is_file()


def test_the_example_of_light_transport(run: Run) -> None:
    names = run("docs/api.md")
    image, transport = names["image"], names["transport"]
    assert image.shape == (48, 64, 3)
    seen = transport.seen_texels().unsqueeze(-1) * 3
    assert torch.allclose(names["textures"].grad.sum(-1, keepdim=True), seen, atol=1e-4)


def commands(text: str) -> list[list[str]]:
    """The calls of the program in blocks for a shell and in inline code."""
    blocks = "\n".join(re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)).replace("\\\n", " ")
    inline = "\n".join(re.sub(r"\s+", " ", call) for call in re.findall(r"(?<!`)`(svbrdfgan [^`]+)`(?!`)", text))
    lines = [shlex.split(line, comments=True) for line in f"{blocks}\n{inline}".splitlines()]
    return [line[1:] for line in lines if line[:1] == ["svbrdfgan"] and len(line) > 1]


def check(call: list[str]) -> None:
    """Parses a call without running it. A call without arguments only has to name a command."""
    name, *arguments = call
    assert name in COMMANDS, name
    command = main.get_command(click.Context(main), name)
    if arguments not in ([], ["import"]) and command is not None:
        command.make_context(name, arguments)


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_those_of_the_program(
    page: str, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("assets").mkdir()  # --assets must exist
    for call in commands((repository / page).read_text(encoding="utf-8")):
        check(call)


def test_a_wrong_command_is_found() -> None:
    with pytest.raises(click.UsageError):
        check(commands("`svbrdfgan bake MESH --nonsense -o DIR`")[0])
    with pytest.raises(click.UsageError):
        check(commands("```sh\nsvbrdfgan dataset \\\n  dataset.yaml\n```\n")[0])
    with pytest.raises(click.UsageError):
        check(commands("(`svbrdfgan dataset\ndataset.yaml`)")[0])
    with pytest.raises(AssertionError):
        check(["dream"])


@pytest.mark.parametrize(
    ("page", "folders"), [("lab/results.md", {"dataset", "data-stretch"}), ("experiments.md", {"dataset-materials"})]
)
def test_the_commands_for_real_vehicles_find_their_files(page: str, folders: set[str], repository: Path) -> None:
    """With the two examples beside cars/ and envmaps/, since paths in a YAML file are relative to it."""
    made = set()
    calls = commands((repository / "docs" / page).read_text(encoding="utf-8"))
    for name, config, *words in (call for call in calls if call[0] in ("dataset", "train") and "-o" in call):
        assert Path(config).name == config  # so that paths in files and in options are relative to the same folder
        given = load_yaml(repository / "examples" / "vehicles" / config)
        data = apply_overrides(given, [word for word in words if "=" in word])
        if name == "dataset":
            made.add(words[words.index("-o") + 1])
            declared = dataset_config(data, config)
            sources = [declared.environments, *(split.meshes for split in declared.splits.values())]
            assert {Path(file).parts[0] for source in sources for file in source.files} == {"cars", "envmaps"}
        else:
            assert train_config(data, config).dataset in made
    assert made == folders


def first_column(text: str, header: str) -> set[str]:
    """The names in the first column of the table that this header opens."""
    rows = text.split(f"| {header} |")[1].split("\n\n")[0].splitlines()[2:]
    return {re.findall(r"`([^`]+)`", row.split("|")[1])[0] for row in rows}


def test_the_tables_of_the_readme_are_complete(repository: Path) -> None:
    text = (repository / "README.md").read_text(encoding="utf-8")
    project = tomllib.loads((repository / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    plugins = project["entry-points"]
    assert first_column(text, "renderer") == set(plugins["svbrdfgan.renderers"])
    assert first_column(text, "embedding") == set(plugins["svbrdfgan.uv_embeddings"])
    assert first_column(text, "extra") == set(project["optional-dependencies"]) - {"docs", "test", "dev"}


def test_every_command_is_named(repository: Path) -> None:
    text = (repository / "docs" / "commands.md").read_text(encoding="utf-8")
    assert {call[0] for call in commands(text)} == set(COMMANDS)


def test_the_targets_of_make_exist(repository: Path) -> None:
    targets = re.findall(r"^make (\w+)", (repository / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert targets == ["demo", "test"]
    for target in targets:
        assert re.search(rf"^{target}:", (repository / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
