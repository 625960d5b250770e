"""JSON of strangers: one sentence for what cannot be read."""

from pathlib import Path

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.records import load_json
from svbrdfgan.utils.named_files import MOST_CONTAINERS


@pytest.mark.parametrize(("text", "said"), [("{", "is not valid JSON"), ("[" * 100_000, "is nested too deeply")])
def test_what_is_not_json_is_told(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(AssetError, match=said):
        load_json(tmp_path / "a.json")
    with pytest.raises(AssetError, match="cannot be read"):
        load_json(tmp_path / "none.json")


def test_more_lists_than_are_read_in_seconds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    path.write_text("[" + "[]," * MOST_CONTAINERS + "[]]")
    with pytest.raises(AssetError, match=f"has more than {MOST_CONTAINERS:,} lists and objects"):
        load_json(path)
