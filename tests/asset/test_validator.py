"""The validator says of the real files what their manifest says, and finds an error in a broken copy."""

import json
from pathlib import Path

import pytest
from full_files import full_files, vehicles
from sample_document import sample_document, write
from validator import counts, new_errors, validated

pytestmark = pytest.mark.full


@pytest.mark.assets
def test_real_files_have_the_errors_that_the_manifest_states(assets: Path) -> None:
    files = full_files(assets)
    assert len(files) == 49
    assert len(vehicles(assets)) == 16
    for file, flaws in zip(files, validated([file.path for file in files], limit=200), strict=True):
        assert len(flaws) == file.error_count, file.name
        assert counts(flaws) <= file.error_codes, file.name


@pytest.mark.assets
@pytest.mark.parametrize("name", ["cake_unlit.glb", "rc_toy/scene.gltf"])
def test_a_file_has_no_errors_beside_its_own(name: str, assets: Path) -> None:
    assert new_errors(assets / "full" / name, assets / "full" / name) == []


def test_a_broken_copy_has_new_errors(tmp_path: Path) -> None:
    before = write(sample_document(), tmp_path / "before.gltf")
    whole = json.loads(before.read_text())
    whole["materials"][0]["normalTexture"]["index"] = 9
    after = tmp_path / "after.gltf"
    after.write_text(json.dumps(whole))
    (sentence,) = new_errors(before, after)
    assert sentence.startswith("UNRESOLVED_REFERENCE: 0 in before.gltf, 1 in after.gltf, at /materials/0/normalTexture")
    assert new_errors(after, before) == []


def test_a_lost_picture_is_an_error(tmp_path: Path) -> None:
    before = write(sample_document(), tmp_path / "before.gltf")
    after = tmp_path / "elsewhere" / "after.gltf"
    after.parent.mkdir()
    after.write_bytes(before.read_bytes())
    assert any(sentence.startswith("IO_ERROR") for sentence in new_errors(before, after))
