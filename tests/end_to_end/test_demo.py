"""From nothing to a verdict: pictures alone teach more than any one colour could say."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from svbrdfgan.config.models import validate
from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.experiments import demo
from svbrdfgan.experiments.demo import run_demo
from svbrdfgan.training.config import train_config
from svbrdfgan.utils.display import SilentDisplay

SHIPPED = Path(demo.__file__).parent


def test_the_shipped_configurations_are_right() -> None:
    assert validate(DatasetConfig, load_yaml(SHIPPED / "dataset.yaml"), "dataset.yaml").splits.keys() == {
        "train",
        "validation",
        "test",
    }
    assert train_config(load_yaml(SHIPPED / "train.yaml"), "train.yaml").dataset == "dataset"


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_demonstration_recovers_something(tmp_path: Path) -> None:
    """As shipped but smaller, on vehicles of the test split; run again, it continues and prints the same."""
    import yaml

    smaller = {
        "dataset.yaml": ["splits.train.meshes.procedural.count=24"],
        "train.yaml": ["steps=600"],
    }
    for name, overrides in smaller.items():
        (tmp_path / name).write_text(yaml.safe_dump(apply_overrides(load_yaml(SHIPPED / name), overrides)))
    result = run_demo(tmp_path, SilentDisplay())
    assert 0 < result.evaluation.generated.recovered < 1
    assert result.evaluation.oracle is not None
    assert result.evaluation.fraction < 1
    assert result.evaluation.generated.flip < result.evaluation.constant.flip
    assert result.opening.is_file()
    assert result.report.is_file()
    assert result.picture.is_file()
    assert len(trimesh.load(result.vehicle).geometry) > 1
    again = run_demo(tmp_path, SilentDisplay())
    assert again.evaluation.generated.recovered == pytest.approx(result.evaluation.generated.recovered, abs=1e-4)
    assert again.evaluation.oracle.recovered == pytest.approx(result.evaluation.oracle.recovered, abs=1e-4)
