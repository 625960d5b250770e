"""Sheets of draws: a picture for each seed, amount and recipe, and none for a generator of one layer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svbrdfgan.evaluation import true_draws
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.networks.generator import Generator
from svbrdfgan.report.draws import COLUMNS, sheets
from svbrdfgan.report.page import write_report


@pytest.fixture(scope="module")
def varied(varied_run: Path) -> Evaluated:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(true_draws, "_POINTS", 128)
        return evaluate(varied_run, split="validation", device="cpu", oracle=False)


def test_a_sheet_shows_seeds_amounts_and_recipes(varied: Evaluated) -> None:
    (sheet,) = sheets(varied, [0])
    titles = [picture.title for picture in sheet.pictures]
    assert titles[:COLUMNS] == ["Truth", *(f"Seed {seed}" for seed in range(COLUMNS - 1))]
    assert titles[COLUMNS : 2 * COLUMNS] == [f"Amount {step:.2f}" for step in np.linspace(0.2, 1.0, COLUMNS)]
    assert titles[2 * COLUMNS :] == ["rust", "dust"]
    shown = {picture.title: np.asarray(picture.picture) for picture in sheet.pictures}
    for one, other in (("Seed 0", "Seed 1"), ("Amount 0.20", "Amount 1.00"), ("rust", "dust")):
        assert (shown[one] != shown[other]).any()


def test_the_report_has_the_sheets(varied: Evaluated, varied_run: Path) -> None:
    page = write_report(varied_run, varied).read_text(encoding="utf-8")
    assert "<h2>Draws</h2>" in page
    assert "Amount 0.20" in page
    assert "<h2>Close-ups</h2>" in page


def test_close_ups_show_the_truth_and_the_same_place_as_learned(varied: Evaluated) -> None:
    (found,) = varied.close_ups
    assert set(found.pictures) == {"truth", "generated"}
    assert found.coverage.mean() > 0.5, "it is near"
    assert found.flips()["truth"] < found.flips()["generated"]


def test_a_generator_of_one_layer_has_none(varied: Evaluated) -> None:
    assert sheets(replace(varied, generator=Generator(width=4, blocks=0)), [0]) == []
    assert sheets(replace(varied, generator=None), [0]) == []
