"""What users write is taken as written, or refused with the key, the value and what would be right."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from svbrdfgan.config.models import StrictModel, build, validate
from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.errors import ConfigError


class Uniform(StrictModel):
    low: float
    high: float


class Training(StrictModel):
    batch_size: int = Field(default=1, ge=1)
    learning_rate: float = Field(default=1e-4, gt=0)
    loss: Literal["vanilla", "lsgan", "wgan_gp"] = "vanilla"
    betas: tuple[float, float] = (0.5, 0.999)
    fov: Uniform | float = 40.0
    stages: tuple[Uniform, ...] = ()
    seed: int | None = None


class Config(StrictModel):
    name: str
    training: Training = Training()


@dataclass(frozen=True)
class Tracer:
    device: str = "cpu"
    bounces: Annotated[int, Field(ge=1)] = 1
    clamp: float | None = None
    copy: bool = False  # a name that pydantic's own records use
    size: tuple[int, int] = (8, 8)

    def __post_init__(self) -> None:
        if self.device == "tpu":
            raise ConfigError("device 'tpu' is not known; wanted cpu or cuda.")


def message_for(data: object) -> str:
    with pytest.raises(ConfigError) as caught:
        validate(Config, data, "train.yaml")
    return str(caught.value)


def option_message(options: dict[str, object]) -> str:
    with pytest.raises(ConfigError) as caught:
        build(Tracer, options, "renderer.options")
    return str(caught.value)


def write(folder: Path, text: str) -> Path:
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return path


class TestValidate:
    def test_takes_what_is_right(self) -> None:
        config = validate(Config, {"name": "x", "training": {"betas": [0, 0.9], "fov": {"low": 1, "high": 2}}}, "t")
        assert config.training.betas == (0.0, 0.9)
        assert config.training.fov == Uniform(low=1.0, high=2.0)
        assert config.training.batch_size == 1

    @pytest.mark.parametrize(
        ("training", "wanted"),
        [
            ({"batch_size": 0}, "training.batch_size: 0 is not allowed; wanted a number of at least 1."),
            ({"batch_size": "3"}, "training.batch_size: '3' is not allowed; wanted an integer."),
            ({"batch_size": 3.0}, "training.batch_size: 3.0 is not allowed; wanted an integer."),
            ({"batch_size": True}, "training.batch_size: true is not allowed; wanted an integer."),
            ({"learning_rate": "1"}, "training.learning_rate: '1' is not allowed; wanted a number."),
            ({"learning_rate": float("nan")}, "training.learning_rate: nan is not allowed; wanted a finite number."),
            ({"bacth_size": 1}, "training: unknown key 'bacth_size'; did you mean 'batch_size'?"),
            ({"betas": [1, "a"]}, "training.betas[1]: 'a' is not allowed; wanted a number."),
            ({"betas": [1, 2, 3]}, "training.betas: [1, 2, 3] is not allowed; wanted at most 2 values."),
            ({"betas": [1]}, "training.betas: [1] is not allowed; wanted more values."),
            ({"betas": []}, "training.betas: [] is not allowed; wanted more values."),
            ({"stages": [{"low": 1}]}, "training.stages[0]: key 'high' is missing."),
            (
                {"stages": [{"low": 1, "hihg": 2, "high": 3}]},
                "training.stages[0]: unknown key 'hihg'; did you mean 'high'?",
            ),
            ({"seed": "x"}, "training.seed: 'x' is not allowed; wanted an integer."),
            (None, "training: nothing is not allowed; wanted a mapping of keys."),
        ],
    )
    def test_says_what_is_wrong(self, training: object, wanted: str) -> None:
        assert message_for({"name": "x", "training": training}) == f"train.yaml: {wanted}"

    def test_a_choice_is_guessed(self) -> None:
        assert message_for({"name": "x", "training": {"loss": "lsgam"}}).endswith("did you mean 'lsgan'.")

    def test_each_fault_has_a_line(self) -> None:
        lines = message_for({"training": {"batch_size": 0, "x": 1}}).splitlines()
        assert len(lines) == 3
        assert "train.yaml: key 'name' is missing." in lines

    def test_a_union_is_one_fault_without_inner_names(self) -> None:
        text = message_for({"name": "x", "training": {"fov": "wide"}})
        assert text == "train.yaml: training.fov: 'wide' is not allowed; wanted a mapping of keys or a number."

    def test_an_unknown_key_in_a_union_is_guessed(self) -> None:
        text = message_for({"name": "x", "training": {"fov": {"low": 1, "high": 2, "hihg": 3}}})
        assert "training.fov: unknown key 'hihg'; did you mean 'high'?" in text

    def test_refuses_what_is_no_mapping(self) -> None:
        assert message_for([1]) == "train.yaml: [1] is not allowed; wanted a mapping of keys."

    def test_refuses_objects_and_cycles(self) -> None:
        cycle: dict[str, object] = {}
        cycle["a"] = cycle
        assert message_for(cycle).startswith("train.yaml: ")
        assert message_for({"name": object()}).startswith("train.yaml: ")


class TestBuild:
    def test_gives_only_what_was_given(self) -> None:
        assert build(Tracer, {"bounces": 2, "clamp": 3, "size": [4, 5]}, "r") == Tracer(
            bounces=2, clamp=3.0, size=(4, 5)
        )
        assert build(Tracer, {"copy": True}, "r").copy is True

    @pytest.mark.parametrize(
        ("options", "wanted"),
        [
            ({"bonces": 1}, "renderer.options: unknown key 'bonces'; did you mean 'bounces'?"),
            ({"bounces": 0}, "renderer.options.bounces: 0 is not allowed; wanted a number of at least 1."),
            ({"bounces": "3"}, "renderer.options.bounces: '3' is not allowed; wanted an integer."),
            ({"clamp": "x"}, "renderer.options.clamp: 'x' is not allowed; wanted a number."),
            ({"device": "tpu"}, "renderer.options: device 'tpu' is not known; wanted cpu or cuda."),
        ],
    )
    def test_says_what_is_wrong(self, options: dict[str, object], wanted: str) -> None:
        assert option_message(options) == wanted

    def test_functions_and_missing_options(self) -> None:
        def factory(*, width: int, height: "int" = 2) -> tuple[int, int]:
            return width, height

        assert build(factory, {"width": 1}, "r") == (1, 2)
        with pytest.raises(ConfigError, match=re.escape("r: key 'width' is missing.")):
            build(factory, {}, "r")


class TestYaml:
    def test_reads_yaml_1_2(self, tmp_path: Path) -> None:
        text = "a: 1e-3\nb: no\nc: 010\nd: 1:30\ne: 2024-01-01\nf: true\ng: -1.5E+2\nh: ~\ni: [1, .5]\nj: .inf\nk:\n"
        wanted = {"a": 1e-3, "b": "no", "c": "010", "d": "1:30", "e": "2024-01-01", "f": True, "g": -150.0}
        wanted |= {"h": None, "i": [1, 0.5], "j": float("inf"), "k": None}
        assert load_yaml(write(tmp_path, text)) == wanted

    def test_anchors_and_merges(self, tmp_path: Path) -> None:
        assert load_yaml(write(tmp_path, "a: &x {p: 1, q: 2}\nb: {<<: *x, p: 3}\n"))["b"] == {"p": 3, "q": 2}

    @pytest.mark.parametrize(
        ("text", "wanted"),
        [
            ("a: 1\nb:\n  c: 1\n  c: 2\n", "line 4, column 3: key 'c' is given twice."),
            ("a: [1\n", "config.yaml, line 2"),
            ("- 1\n", "is a list; wanted a mapping"),
            ("", "is empty; wanted a mapping"),
            ("3", "is a single value; wanted a mapping"),
            ("1: 2", "line 1, column 1: a key that is not text."),
            ("a: !!python/object/apply:os.getcwd []", "is not read; leave it out"),
            ("a: \x00", "is not YAML"),
            ("a: !!int x", "is not read; leave it out"),
        ],
    )
    def test_refuses_the_rest(self, tmp_path: Path, text: str, wanted: str) -> None:
        with pytest.raises(ConfigError, match=re.escape(wanted)):
            load_yaml(write(tmp_path, text))

    def test_files_that_cannot_be_read(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="No such file"):
            load_yaml(tmp_path / "none.yaml")
        with pytest.raises(ConfigError, match="cannot be read"):
            load_yaml(tmp_path)
        (tmp_path / "latin.yaml").write_bytes(b"a: \xe4")
        with pytest.raises(ConfigError, match="not UTF-8"):
            load_yaml(tmp_path / "latin.yaml")


def test_a_copy_has_no_other_keys() -> None:
    config = Config(name="x")
    assert config.model_copy(update={"name": "y"}) == Config(name="y")
    with pytest.raises(TypeError, match="Config has no nam"):
        config.model_copy(update={"nam": "y"})


class TestOverrides:
    def test_puts_values_in_and_leaves_the_original(self) -> None:
        data = {"name": "x", "training": {"seed": 1}}
        changed = apply_overrides(data, ["training.batch_size=4", "a.b.c=[1, 1e-3]", "name=no", "training.seed="])
        assert changed == {"name": "no", "training": {"seed": None, "batch_size": 4}, "a": {"b": {"c": [1, 1e-3]}}}
        assert data == {"name": "x", "training": {"seed": 1}}

    @pytest.mark.parametrize("override", ["seed", "=3", "a..b=1", "name.first=1", "a=[1", "a={b: 1, b: 2}"])
    def test_refuses_what_is_no_override(self, override: str) -> None:
        with pytest.raises(ConfigError) as caught:
            apply_overrides({"name": "x"}, [override])
        assert override in str(caught.value)
