"""JSON of strangers: one sentence for what cannot be read."""

from pathlib import Path

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.records import load_json


@pytest.mark.parametrize(("text", "said"), [("{", "is not valid JSON"), ("[" * 100_000, "is nested too deeply")])
def test_what_is_not_json_is_told(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(AssetError, match=said):
        load_json(tmp_path / "a.json")
    with pytest.raises(AssetError, match="cannot be read"):
        load_json(tmp_path / "none.json")
