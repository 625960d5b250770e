"""Distributions as they are written, and what is said of those that cannot be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from svbrdfgan.config.distributions import Fixed, Integer, Name, Number, Paint, limits, mean, values_of
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.errors import ConfigError

COUNT = 4000


class Record(StrictModel):
    number: Number = Fixed[float](fixed=1.0)
    integer: Integer = Fixed[int](fixed=1)
    paint: Paint | None = None
    name: Name = Fixed[str](fixed="rust")


def drawn(**written: Any) -> list[Any]:
    (name,) = written
    distribution = getattr(validate(Record, written, "here"), name)
    rng = np.random.default_rng(0)
    return [distribution.sample(rng) for _ in range(COUNT)]


@pytest.mark.parametrize("written", [5, 5.0, {"fixed": 5}])
def test_fixed(written: Any) -> None:
    assert set(drawn(number=written)) == {5.0}


def test_uniform_fills_its_range_evenly() -> None:
    values = np.array(drawn(number={"uniform": [-2, 6]}))
    assert values.min() >= -2
    assert values.max() <= 6
    counts, _ = np.histogram(values, bins=8, range=(-2, 6))
    assert (np.abs(counts - COUNT / 8) < 5 * np.sqrt(COUNT / 8)).all()


def test_log_uniform_fills_each_octave_evenly() -> None:
    values = np.array(drawn(number={"log_uniform": [0.25, 4]}))
    assert values.min() >= 0.25
    assert values.max() <= 4
    counts, _ = np.histogram(np.log2(values), bins=4, range=(-2, 2))
    assert (np.abs(counts - COUNT / 4) < 5 * np.sqrt(COUNT / 4)).all()


def test_normal_has_its_mean_and_deviation() -> None:
    values = np.array(drawn(number={"normal": [20, 5]}))
    assert values.mean() == pytest.approx(20, abs=5 * 5 / np.sqrt(COUNT))
    assert values.std() == pytest.approx(5, rel=0.1)


@pytest.mark.parametrize(
    "written",
    [
        3,
        {"fixed": 3},
        {"uniform": [-2, 6]},
        {"log_uniform": [0.1, 6]},
        {"log_uniform": [2, 2]},
        {"normal": [20, 5]},
        {"choice": [1.5, 2, 9]},
    ],
)
def test_the_mean_is_that_of_what_is_drawn(written: Any) -> None:
    values = np.array(drawn(number=written))
    expected = mean(validate(Record, {"number": written}, "here").number)
    assert values.mean() == pytest.approx(expected, abs=5 * values.std() / np.sqrt(COUNT) + 1e-12)


@pytest.mark.parametrize(
    ("name", "values"), [("number", [1.5, 2, 9]), ("integer", [3, 4]), ("paint", [[0, 0.5, 1], [0.2, 0.2, 0.2]])]
)
def test_choice_takes_each_equally_often(name: str, values: list[Any]) -> None:
    found = drawn(**{name: {"choice": values}})
    wanted = [tuple(v) if isinstance(v, list) else v for v in values]
    assert set(found) == set(wanted)
    for value in wanted:
        assert abs(found.count(value) - COUNT / len(values)) < 5 * np.sqrt(COUNT / len(values))


@pytest.mark.parametrize("written", [[0.1, 0.2, 0.3], {"fixed": [0.1, 0.2, 0.3]}])
def test_a_colour(written: Any) -> None:
    assert set(drawn(paint=written)) == {(0.1, 0.2, 0.3)}


def test_an_integer_is_one() -> None:
    assert set(map(type, drawn(integer=7))) == {int}


def test_uniform_integers_have_both_bounds() -> None:
    found = drawn(integer={"uniform": [3, 5]})
    assert set(map(type, found)) == {int}
    for value in (3, 4, 5):
        assert abs(found.count(value) - COUNT / 3) < 5 * np.sqrt(COUNT / 3)


def test_names() -> None:
    assert set(drawn(name="dust")) == {"dust"}
    assert set(drawn(name={"choice": ["dust", "rust"]})) == {"dust", "rust"}
    assert values_of(validate(Record, {"name": {"choice": ["b", "a", "b"]}}, "here").name) == ("b", "a")


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        (3, (1.0, 1.0)),
        (0.5, (0.5, 0.5)),
        ({"uniform": [0.2, 6]}, (0.2, 1.0)),
        ({"log_uniform": [0.25, 6]}, (0.25, 1.0)),
        ({"normal": [0.5, 0.1]}, (0.0, 1.0)),
        ({"normal": [0.5, 0]}, (0.5, 0.5)),
        ({"choice": [0.75, 0.25, 0.5]}, (0.25, 0.75)),
    ],
)
def test_limits_are_the_least_and_greatest_of_what_is_drawn(written: Any, wanted: tuple[float, float]) -> None:
    assert limits(validate(Record, {"number": written}, "here").number, 0.0, 1.0) == wanted


@pytest.mark.parametrize(
    "written",
    [
        {"number": 5},
        {"number": {"uniform": [0, 1]}},
        {"number": {"log_uniform": [0.1, 1]}},
        {"number": {"normal": [3, 0]}},
        {"number": {"choice": [1, 2]}},
        {"integer": {"choice": [1, 2]}},
        {"integer": {"uniform": [1, 9]}},
        {"name": {"choice": ["rust", "dust"]}},
        {"paint": [0.1, 0.2, 0.3]},
        {"paint": {"choice": [[0, 0, 0], [1, 1, 1]]}},
    ],
)
def test_json_and_back(written: dict[str, Any]) -> None:
    record = validate(Record, written, "here")
    assert validate(Record, record.model_dump(mode="json"), "there") == record
    assert Record.model_validate_json(record.model_dump_json()) == record


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ({"number": "fast"}, "number"),
        ({"number": [1, 2]}, "number"),
        ({"number": True}, "number"),
        ({"number": None}, "number"),
        ({"number": {}}, r"number.*uniform"),
        ({"number": {"unifrom": [0, 1]}}, r"number.*uniform"),
        ({"number": {"uniform": [0, 1], "normal": [0, 1]}}, r"number.*uniform"),
        ({"number": {"uniform": [3, 1]}}, r"number.*low <= high"),
        ({"number": {"uniform": [1]}}, r"number\.uniform"),
        ({"number": {"uniform": 1}}, r"number\.uniform"),
        ({"number": {"uniform": [0, 1, 2]}}, r"number\.uniform"),
        ({"number": {"uniform": ["a", 1]}}, r"number\.uniform\[0\]"),
        ({"number": {"log_uniform": [0, 1]}}, r"number.*0 < low"),
        ({"number": {"log_uniform": [2, 1]}}, r"number.*low <= high"),
        ({"number": {"normal": [0, -1]}}, r"number.*deviation >= 0"),
        ({"number": {"choice": []}}, r"number.*at least one"),
        ({"number": {"choice": 3}}, r"number\.choice"),
        ({"number": {"choice": [1, "x"]}}, r"number\.choice\[1\]"),
        ({"number": {"fixed": "x"}}, "number"),
        ({"integer": 1.5}, "integer"),
        ({"integer": {"uniform": [0, 1.5]}}, r"integer\.uniform\[1\]"),
        ({"integer": {"normal": [0, 1]}}, "integer"),
        ({"name": {"uniform": [0, 1]}}, "name"),
        ({"integer": {"choice": [1, 2.5]}}, r"integer\.choice\[1\]"),
        ({"paint": [0.1, 0.2]}, "paint"),
        ({"paint": "red"}, "paint"),
        ({"paint": {"choice": [[0, 0, 0], [1, 1]]}}, r"paint\.choice\[1\]"),
    ],
)
def test_a_mistake_is_one_line_with_its_key(written: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        validate(Record, written, "here.yaml")
    (line,) = str(caught.value).splitlines()
    assert line.startswith("here.yaml: ")
    assert line.endswith(".") or "needs" in line


@pytest.mark.parametrize(
    "written",
    [
        {"number": {"uniform": [-1e308, 1e308]}},
        {"number": {"log_uniform": [1e-300, 1e300]}},
        {"number": {"normal": [0, 1e300]}},
        {"integer": {"uniform": [0, 10**30]}},
    ],
)
def test_numbers_that_would_overflow_are_told(written: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="is out of range; wanted numbers up to") as caught:
        validate(Record, written, "here")
    assert len(str(caught.value).splitlines()) == 1


def test_seeds_may_have_63_bits() -> None:
    assert max(drawn(integer={"uniform": [0, 2**63 - 1]})) > 2**62
