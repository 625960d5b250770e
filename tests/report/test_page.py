"""The report needs nothing but itself, holds what it promises, and says what is missing."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
import torch

from svbrdfgan.evaluation.record import MapScore
from svbrdfgan.evaluation.relight import PaintedScene
from svbrdfgan.report.page import write_report
from svbrdfgan.training.state import State

JOURNAL = [
    {"step": 50, "g_loss": 0.9, "d_loss": 1.2, "d_accuracy": 0.6, "images_per_second": 30.0, "seconds": 7.0},
    {"step": 100, "recovered": 0.30, "seconds": 14.0},
    {"step": 150, "recovered": 0.45, "seconds": 21.0},
    {"step": 200, "g_loss": 0.8, "d_loss": 1.3, "d_accuracy": 0.55, "images_per_second": 31.0, "seconds": 28.0},
]


class Page(HTMLParser):
    """The addresses, the headings and the text of a page."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.headings: list[str] = []
        self.words = ""
        self.source = source
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "xlink:href", "srcset", "data", "action")]

    def handle_data(self, data: str) -> None:
        inside = next((tag for tag in reversed(self.tags) if tag not in ("span", "b", "meta")), "")
        if inside in ("h1", "h2") and data.strip():
            self.headings.append(data.strip())
        self.words += f" {data}"


def write(run: Path, evaluated, journal=(), checkpoint: bool = False) -> Page:
    (run / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in journal), encoding="utf-8")
    if checkpoint:
        state = State.fresh(evaluated.config.train, torch.device("cpu"))
        state.step = 1200
        state.save(run)
    path = write_report(run, evaluated)
    assert path == run / "report.html"
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, evaluated) -> Page:
    run = tmp_path_factory.mktemp("runs") / "run-7"
    run.mkdir()
    return write(run, evaluated, JOURNAL, checkpoint=True)


def test_the_page_needs_nothing_but_itself(whole: Page) -> None:
    assert len(whole.addresses) > 20
    assert {address.split(",")[0] for address in whole.addresses if not address.startswith("#")} == {
        "data:image/png;base64"
    }
    assert not {"link", "iframe", "object"} & set(whole.tags)
    assert whole.tags.count("script") == 1  # our own, which has no address
    assert "@import" not in whole.source
    assert re.findall(r"url\((?!#)", whole.source) == []


def test_the_page_has_its_parts_in_order(whole: Page) -> None:
    wanted = ["Verdict", "Held-out vehicles", "Texture space", "The discriminator's view", "Training", "Reproduce"]
    assert whole.headings[1:] == wanted
    assert whole.headings[0].startswith("Road dirt, learned from")


@pytest.mark.parametrize(
    "told",
    [
        *("0.612", "0.874", "70%", "0.043", "0.031", "0.081", "0.021", "83%"),
        *("At its plateau after 2,300 steps", "after 1,200 steps", "200 steps, 800 images in 28 s", "600"),
        *("sedan_1", "van_2", "1.2.3", "batch_size: 4", "cars/*.glb"),
        *("svbrdfgan dataset dataset.yaml -o dirty-cars", "svbrdfgan train train.yaml -o run-7"),
    ],
)
def test_the_page_tells(whole: Page, told: str) -> None:
    assert told in whole.words


def test_the_learned_layer_stands_beside_the_truth_and_the_oracle(whole: Page) -> None:
    alts = re.findall(r'alt="sedan_1: ([^"]+)"', whole.source)
    assert alts[:5] == ["Truth", "Learned", "Oracle", "Best constant", "Unweathered"]
    assert {"Position", "Normal", "Error of albedo", "Real, judged", "Fake, judged"} <= set(alts)


def test_maps_and_relit_pictures_are_shown(run: Path, evaluated) -> None:
    before = evaluated.evaluation
    maps = {"base_color": MapScore(recovered=0.6123), "normal": MapScore(recovered=0.4, error=7.8)}
    update = {
        "areas": {"base_color": 0.83, "normal": 0.1},
        "generated": before.generated.model_copy(update={"relit_flip": 0.1234, "maps": maps}),
        "oracle": before.oracle.model_copy(update={"relit_flip": 0.1}),
    }
    grey = torch.full((40, 60, 3), 0.5)
    pictures = {painter: grey + n / 10 for n, painter in enumerate(("generated", "constant", "truth"), 1)}
    scene = PaintedScene(evaluated.source.exemplars.scenes[0], torch.ones(40, 60), grey, pictures)
    verdict = before.model_copy(update=update)
    page = write(run, replace(evaluated, evaluation=verdict, relit=(scene,)))
    assert page.headings[3] == "Relit"
    for told in ("0.123", "1.23 times", "7.8 degrees", "normal can be observed on only 10%"):
        assert told in page.words
    before_textures = page.source[page.source.index("<h2>Relit") : page.source.index("<h2>Texture")]
    assert re.findall(r'alt="sedan_1: ([^"]+)"', before_textures) == ["Truth", "Learned", "Best constant"]
    assert f"FLIP {scene.flips()['generated']:.3f}" in before_textures


def test_a_rising_oracle_is_called_so(run: Path, evaluated) -> None:
    rising = evaluated.evaluation.oracle.model_copy(update={"plateau": False})
    page = write(run, replace(evaluated, evaluation=evaluated.evaluation.model_copy(update={"oracle": rising})))
    assert "Still rising after 2,300 steps" in page.words
    assert "At its plateau" not in page.words


def test_without_an_oracle_the_page_says_so(run: Path, evaluated, makers) -> None:
    page = write(run, makers.without_oracle(evaluated), JOURNAL)
    assert "No oracle was trained" in page.words
    assert "0.612" in page.words
    assert re.findall(r'alt="sedan_1: Oracle"', page.source) == []


def test_without_validation_log_or_checkpoint_the_page_says_so(run: Path, evaluated) -> None:
    page = write(run, evaluated)
    for told in ("There was no validation split", "The run kept no log", "no checkpoint that can be read"):
        assert told in page.words
    assert "svg" not in page.tags


@pytest.mark.full
def test_a_checkpoint_of_other_networks_is_left_out(run: Path, evaluated) -> None:
    (run / "checkpoints" / "step_00000001").mkdir(parents=True)
    assert "no checkpoint that can be read" in write(run, evaluated).words


@pytest.mark.full
def test_a_run_with_further_maps_shows_what_its_discriminator_thinks(run: Path, evaluated) -> None:
    State.fresh(evaluated.config.train, torch.device("cpu"), maps=("roughness",)).save(run)
    page = write(run, evaluated)
    assert "no checkpoint that can be read" not in page.words
    assert "Fake, judged" in page.source


def test_without_weathered_pictures_the_page_says_so(run: Path, evaluated, makers) -> None:
    page = write(run, makers.without_weathering(evaluated), checkpoint=True)
    assert page.words.count("No picture of this split is weathered") == 2


def test_names_are_text_and_never_markup(run: Path, makers) -> None:
    page = write(run, makers.make_evaluated(names=('<script>"&',)), checkpoint=True)
    assert page.tags.count("script") == 1
    assert '<script>"&' in page.words


@pytest.mark.full
def test_the_page_replaces_the_one_before_and_leaves_nothing_else(run: Path, evaluated) -> None:
    (run / "report.html").write_text("old", encoding="utf-8")
    write(run, evaluated)
    assert sorted(path.name for path in run.iterdir()) == ["log.jsonl", "report.html"]
    assert (run / "report.html").read_text(encoding="utf-8").startswith("<!doctype html>")
