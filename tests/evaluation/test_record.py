"""The record of an evaluation: what it says, and that earlier ones can still be read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from svbrdfgan.evaluation.record import Evaluation, MapScore, share
from svbrdfgan.io.records import load_record

EARLIER = {
    "split": "test", "recovered": 0.5, "oracle": 0.8, "fraction": 0.625, "oracle_plateau": True, "oracle_steps": 300,
    "flip": 0.1, "flip_oracle": 0.05, "flip_constant": 0.2, "flip_truth": 0.02, "seen": 0.75,
    "constant": (0.0, 0.0, 0.0, 0.0), "subjects": 3, "exemplars": 6,
}  # fmt: skip
RELIT = {"relit_flip": 0.12, "relit_flip_oracle": 0.1, "relit_flip_constant": 0.3, "relit_flip_truth": 0.03}
MAPS = {
    "base_color": MapScore(recovered=0.5, oracle=0.8, fraction=0.625, error=0.05, constant_error=0.1, area=0.75),
    "metallic": MapScore(error=0.0, constant_error=0.0, area=0.7),
    "normal": MapScore(recovered=0.25, oracle=0.5, fraction=0.5, error=6.0, constant_error=8.0, area=0.13),
}


def test_earlier_records_are_read(tmp_path: Path) -> None:
    (tmp_path / "evaluation.json").write_text(json.dumps(EARLIER | {"maps": {"roughness": 0.12}}))
    found = load_record(Evaluation, tmp_path / "evaluation.json")
    assert found.maps == {"roughness": MapScore(error=0.12)}
    assert found.relit_flip is found.relit_ratio is None
    told = found.lines()
    assert not any("relit" in line for line in told)
    assert told[-1].split() == ["roughness", "-", "-", "-", "0.120", "-", "-"]


def test_what_is_saved_is_read(tmp_path: Path) -> None:
    evaluation = Evaluation.model_validate(EARLIER | RELIT | {"maps": MAPS})
    evaluation.save(tmp_path)
    assert load_record(Evaluation, tmp_path / "evaluation.json") == evaluation


def test_maps_are_a_table_with_a_warning_of_what_can_hardly_be_observed() -> None:
    told = Evaluation.model_validate(EARLIER | RELIT | {"maps": MAPS}).lines()
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
    told = Evaluation.model_validate(EARLIER | RELIT).lines()
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
    figures = {"deviation": 0.8, "mean_correlation": 0.7, "power": (0.9, 1.1)}
    said = EARLIER | {"oracle_plateau": None, "fraction": None, "resemblance": 0.4, "draws": draws}
    said |= {"resemblance_oracle": 0.8, "draws_oracle": draws, "resemblance_fraction": 0.5}
    told = Evaluation.model_validate(said | {"figures": {"generated": figures}}).lines()
    assert told[1] == "oracle:    0.800 (one draw of it after 300 steps)"
    assert told[-3:] == [
        "its oracle:  0.800 (least: deviation 0.50; 300 steps)",
        "fraction:    0.500 of the oracle",
        "generated: deviation 0.80 of the truth's; mean maps correlate 0.70; power 0.90, 1.10 of the truth's, finest "
        "octave first",
    ]
