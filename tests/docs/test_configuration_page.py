"""docs/configuration.md is what the configuration models say."""

import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml

from svbrdfgan.config.models import validate

ROW = re.compile(r"^\| `([^`]+)` \| (.+?) \| (.+?) \| (.+) \|$", re.MULTILINE)


@pytest.fixture(scope="module")
def maker(repository: Path) -> dict[str, Any]:
    """The names of the script that makes the page."""
    return runpy.run_path(str(repository / "docs" / "make_configuration.py"))


def test_the_page_is_what_the_models_say(maker: dict[str, Any]) -> None:
    told = maker["PAGE"].read_text(encoding="utf-8")
    assert told == maker["page"](), "make the page again: python docs/make_configuration.py"


def test_every_key_has_a_meaning(maker: dict[str, Any]) -> None:
    rows = ROW.findall(maker["page"]())
    assert len(rows) > 100
    assert [key for key, _, _, meaning in rows if meaning in ("None", "")] == []


def test_defaults_are_written_as_users_write_them(maker: dict[str, Any]) -> None:
    data: dict[str, dict[str, Any]] = {
        "`dataset.yaml`": {"splits": {"train": {"meshes": {"procedural": {"count": 1}}}}},
        "`train.yaml`": {"dataset": "data"},
    }
    for title, least in data.items():
        table = maker["page"]().split(f"## {title}\n")[1].split("\n#")[0]
        told = {
            key: yaml.safe_load(default.strip("`")) for key, _, default, _ in ROW.findall(table) if key not in least
        }
        model = maker["FILES"][title]
        assert validate(model, {**least, **told}, "page") == validate(model, least, "page")
