"""The record of an evaluation: what it says of each painter, and of the generator beside the oracle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.evaluation.record import Evaluation, share
from svbrdfgan.io.records import load_record

SCORES = {
    "split": "test", "subjects": 3, "exemplars": 6, "areas": {"base_color": 0.75},
    "generated": {"recovered": 0.5, "flip": 0.1},
    "oracle": {"recovered": 0.8, "flip": 0.05, "plateau": True, "steps": 300},
    "constant": {"flip": 0.2, "layer": (0.0, 0.0, 0.0, 0.0)},
    "truth": {"flip": 0.02},
}  # fmt: skip
RELIT = {"generated": 0.12, "oracle": 0.1, "constant": 0.3, "truth": 0.03}
MAPS = {
    "areas": {"metallic": 0.7, "normal": 0.13},
    "generated": {
        "maps": {
            "base_color": {"recovered": 0.5, "error": 0.05},
            "metallic": {"error": 0.0},
            "normal": {"recovered": 0.25, "error": 6.0},
        }
    },
    "oracle": {"maps": {"base_color": {"recovered": 0.8}, "normal": {"recovered": 0.5}}},
    "constant": {"errors": {"base_color": 0.1, "metallic": 0.0, "normal": 8.0}},
}


def evaluation(*changes: dict[str, Any]) -> Evaluation:
    """The scores above, with what these dictionaries add to each painter's."""
    said: dict[str, Any] = dict(SCORES)
    for change in changes:
        said |= {painter: said[painter] | scores for painter, scores in change.items()}
    return Evaluation.model_validate(said)


def relit() -> dict[str, Any]:
    return {painter: {"relit_flip": flip} for painter, flip in RELIT.items()}


def test_what_is_saved_is_read(tmp_path: Path) -> None:
    found = evaluation(relit(), MAPS)
    found.save(tmp_path)
    assert load_record(Evaluation, tmp_path / "evaluation.json") == found


def test_ratios_are_to_the_oracle() -> None:
    found = evaluation(relit(), MAPS)
    assert (found.fraction, found.relit_ratio, found.half_way) == (0.625, pytest.approx(1.2), 0)
    assert found.of_oracle(lambda its: its.of_map("normal").recovered) == 0.5
    assert found.of_oracle(lambda its: its.of_map("roughness").recovered) is None
    alone = found.model_copy(update={"oracle": None})
    assert alone.fraction is alone.relit_ratio is alone.resemblance_fraction is None
    assert evaluation({"oracle": {"validation": 0.9}}).half_way == 0.45


def test_maps_are_a_table_with_a_warning_of_what_can_hardly_be_observed() -> None:
    told = evaluation(relit(), MAPS).lines()
    assert told[-6] == (
        "relit:     FLIP 0.120, 1.20 times the oracle's (oracle 0.100, constant layer 0.300, noise alone 0.030)"
    )
    heads, color, metallic, normal, warning = told[-5:]
    assert len({line.index(cell) for line, cell in ((heads, "error"), (color, "0.050"), (normal, "6.0 degrees"))}) == 1
    assert color.split() == ["base_color", "0.500", "0.800", "0.625", "0.050", "0.100", "75%"]
    assert metallic.split() == ["metallic", "-", "-", "-", "0.000", "0.000", "70%"]
    assert normal.split() == ["normal", "0.250", "0.500", "0.500", "6.0", "degrees", "8.0", "degrees", "13%"]
    assert warning == "normal can be observed on only 13% of the learnable area: its score says little."


def test_base_color_alone_has_no_table() -> None:
    told = evaluation(relit()).lines()
    assert told[-1].startswith("relit:")
    assert len(told) == 5


@pytest.mark.parametrize(
    ("learned", "oracle", "wanted"),
    [(0.5, 0.8, 0.625), (-0.2, 0.8, -0.25), (0.5, 0.0, None), (0.5, -0.4, None), (0.5, None, None), (None, 0.8, None)],
)
def test_a_share_of_an_oracle_that_recovered_nothing_says_nothing(
    learned: float | None, oracle: float | None, wanted: float | None
) -> None:
    assert share(learned, oracle) == wanted


def test_a_distribution_has_its_oracle_and_its_figures() -> None:
    draws = {
        "patches": 1,
        "mean": 1,
        "deviation": 0.5,
        "spectrum": 1,
        "joint": 1,
        "amount": 1,
        "subjects": 3,
        "draws": 16,
    }
    figures = {"deviation": 0.8, "mean_correlation": 0.7, "power": (0.9, 1.1), "relief": (0.6, 1.3)}
    changes = {
        "generated": {
            "draws": draws | {"deviation": 0.25},
            "figures": figures | {"relit": {"flip": 0.06, "of_truth": 0.05, "pairs": 16}},
        },
        "oracle": {"draws": draws, "plateau": None},
        "truth": {"figures": figures | {"deviation": 1.0}},
    }
    found = evaluation(changes, relit(), MAPS)
    assert found.of_distribution
    assert found.fraction is None, "both are those of one draw"
    assert found.lines() == [
        "resemblance: 0.794 (1: as alike as true draws are to each other, 0: one colour)",
        "least part:  deviation 0.25 (whether draws differ from each other as much as true ones do, place by place)",
        "parts:       patches 1.00, mean 1.00, deviation 0.25, spectrum 1.00, joint 1.00, amount 1.00",
        "compared:    16 draws of each of 3 test subjects, 75% of their area",
        "oracle:      0.891 (least: deviation 0.50; 300 steps)",
        "fraction:    0.891 of the oracle",
        "truth: deviation 1.00 of the truth's; mean maps correlate 0.70; power 0.90, 1.10 of the truth's, finest "
        "octave first; relief 0.60, 1.30 likewise",
        "generated: deviation 0.80 of the truth's; mean maps correlate 0.70; power 0.90, 1.10 of the truth's, finest "
        "octave first; relief 0.60, 1.30 likewise; relit FLIP 1.20 of that between true draws",
    ]


def test_a_distribution_without_scores_says_why_and_gives_no_score_of_one_draw() -> None:
    found = evaluation(relit()).model_copy(update={"refusal": "too small."})
    assert found.lines() == ["resemblance: unknown, since too small."]
