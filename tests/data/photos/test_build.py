"""Photographs become exemplars that keep the radiance, colours and cameras of the pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from PIL import Image
from stand_ins import SHOULDER, SMALL, StandIn

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset, DatasetIndex
from svbrdfgan.data.photos import check
from svbrdfgan.data.photos.build import ImportedPicture, import_pictures
from svbrdfgan.data.photos.light import GLOSS, white
from svbrdfgan.data.photos.manifest import Manifest, read_manifest
from svbrdfgan.data.reflectance_errors import load_errors, no_errors
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training.batches import make_batch_source
from svbrdfgan.training.config import train_config
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.step import make_pair
from svbrdfgan.training.trainer import train
from svbrdfgan.types import Materials, Rendering

Photographs = tuple[Path, list[StandIn]]


def declared(photographs: Photographs, **changes: Any) -> Manifest:
    return read_manifest(
        {**load_yaml(photographs[0] / "manifest.yaml"), **SMALL, "light": "mean", **changes}, "manifest.yaml"
    )


def with_true_cameras(photographs: Photographs, **changes: Any) -> Manifest:
    given = load_yaml(photographs[0] / "manifest.yaml")["pictures"]
    cameras = [json.loads(one.camera.model_dump_json()) for one in photographs[1]]
    pictures = [{**entry, "camera": camera} for entry, camera in zip(given, cameras, strict=True)]
    return declared(photographs, pictures=pictures, **changes)


@pytest.fixture(scope="module")
def imported(
    photographs: Photographs, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, tuple[ImportedPicture, ...]]:
    """The stand-ins as a data set, with the manifest's cameras and estimated light. Not to be changed."""
    folder = tmp_path_factory.mktemp("imported") / "own"
    return folder, import_pictures(declared(photographs, light="estimated", bootstrap=2), folder, base=photographs[0])


@pytest.fixture(scope="module")
def exemplars(imported: tuple[Path, tuple[ImportedPicture, ...]]) -> Exemplars:
    return load_exemplars(Dataset.open(imported[0]), "train")


def rendered(exemplars: Exemplars, index: int, materials: Callable[[Subject], Materials]) -> Rendering:
    """Other materials in an exemplar's scene, with little noise."""
    scene, subject = exemplars.scenes[index], exemplars.subject(index)
    renderer = load_renderer("mitsuba", {"device": "cpu"})
    view = exemplars.loader.view(scene)
    return renderer.render(renderer.prepare(subject.surface), materials(subject), view, spp=1024, seed=5)


@pytest.mark.full
def test_an_exemplar_is_the_linear_picture_up_to_exposure_and_gloss(photographs: Photographs, tmp_path: Path) -> None:
    """Compared with the true radiance, rendered from the exemplar's camera: within 12 % of the mean.

    Most of that is noise. Colour, and so the exposure of each channel, is kept within 3 %.
    """
    import_pictures(with_true_cameras(photographs), tmp_path / "own", base=photographs[0])
    found = load_exemplars(Dataset.open(tmp_path / "own"), "train")
    for number, one in enumerate(photographs[1]):
        true = one.render(found.scenes[number].camera.camera(), (48, 48), 2048)
        image, coverage = found.images[number].float(), found.coverage[number].float()
        veil = GLOSS * rendered(found, number, lambda s: white(s.learnable, len(s.surface.parts))).image
        below = (true.image * one.gain < SHOULDER).all(dim=-1)
        whole = torch.minimum(coverage, true.coverage) > 0.99
        full = (F.max_pool2d((~whole).float()[None], 3, 1, 1)[0] == 0) & below  # not what was filled in at the edge
        assert full.sum() > 150
        shown = image[full] + veil[full]
        wanted = true.image[full] * (shown.mean() / true.image[full].mean())
        assert (shown - wanted).abs().mean() < 0.12 * wanted.mean()
        assert torch.allclose(shown.mean(dim=0), wanted.mean(dim=0), rtol=0.03)


@pytest.mark.full
def test_outlines_are_the_mesh_s_with_a_mask_and_without(exemplars: Exemplars) -> None:
    """So exemplars and fakes have the same outlines. Pixels beside the mask have the colour of the nearest inside."""
    for index in range(len(exemplars)):
        made = rendered(exemplars, index, lambda s: s.materials())
        coverage, image = exemplars.coverage[index].float(), exemplars.images[index].float()
        assert (coverage - made.coverage).abs().max() < 0.25  # noise of 64 samples
        assert (coverage - made.coverage).abs().mean() < 0.01
        edge = (coverage > 0.3) & (coverage < 0.99)
        inside = image[coverage > 0.99].mean()
        assert (image[edge] / coverage[edge].unsqueeze(-1)).mean() == pytest.approx(float(inside), rel=0.6)


def test_every_picture_is_an_exemplar(photographs: Photographs, imported: Any, exemplars: Exemplars) -> None:
    folder, records = imported
    assert [one.exemplar for one in records] == [f"train/{n:06d}" for n in range(4)]
    assert [one.file for one in records] == [one.file for one in photographs[1]]
    assert exemplars.subject_of.tolist() == [0, 0, 1, 1]
    assert exemplars.images.isfinite().all()
    assert all(0.15 < float(share) < 0.8 for share in exemplars.coverage.float().mean(dim=(1, 2)))
    assert (exemplars.images[exemplars.coverage == 0] == 0).all()
    assert json.loads((folder / "imported.json").read_text())[2]["exposure"] == records[2].exposure
    assert sorted(path.name for path in (folder / "overlay").iterdir()) == [
        *(f"{n:04d}.png" for n in range(4)),
        "contact-sheet.png",
    ]


def test_bad_pictures_are_left_out_and_spoil_no_others(
    photographs: Photographs, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """One fails when it is read, and one when it is exposed: then the exemplars after it move up."""
    Image.new("RGB", (240, 160)).save(tmp_path / "black.png")
    (tmp_path / "torn.jpg").write_bytes(b"\xff\xd8 torn")
    entries = [dict(entry) for entry in load_yaml(photographs[0] / "manifest.yaml")["pictures"]]
    for entry in entries:
        entry.pop("mask", None)
    entries[0]["file"], entries[3]["file"] = str(tmp_path / "black.png"), str(tmp_path / "torn.jpg")
    manifest = declared(photographs, pictures=entries, bootstrap=1)
    records = import_pictures(manifest, tmp_path / "own", base=photographs[0])
    assert [one.file for one in records] == [entries[1]["file"], entries[2]["file"]]
    assert [one.exemplar for one in records] == ["train/000000", "train/000001"]
    said = caplog.messages
    assert "pictures[3]: " in said[0]
    assert "torn.jpg" in said[0]
    assert said[1] == "1 of 4 pictures are left out"
    assert "pictures[0]: " in said[2]
    assert "the picture is black" in said[2]
    assert said[3] == "1 of 3 pictures are left out"

    dataset = Dataset.open(tmp_path / "own")
    assert sorted(path.name for path in (tmp_path / "own" / "train").iterdir()) == [
        f"{n:06d}.{suffix}" for n in range(2) for suffix in ("errors.safetensors", "exr", "json")
    ]
    found = load_exemplars(dataset, "train")
    assert [Path(scene.mesh.path).stem for scene in found.scenes] == ["car_0", "car_1"]
    assert [mesh.views for mesh in dataset.index.meshes["train"]] == [1, 1]
    assert load_errors(tmp_path / "own", "train", 2) is not None

    with pytest.raises(ConfigError, match="the picture is black"):
        import_pictures(declared(photographs, pictures=entries[:1], paint={}), tmp_path / "none", base=photographs[0])
    assert not (tmp_path / "none").exists()


@pytest.mark.full
def test_processes_that_share_the_pictures_make_the_same(
    photographs: Photographs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So do those of a picture that cannot be used, which is told in one sentence."""
    monkeypatch.setattr(check, "_LEAST_SHARE", 2)
    folder, made = photographs
    Image.new("RGB", (240, 160)).save(tmp_path / "black.png")
    pictures = [dict(entry) for entry in load_yaml(folder / "manifest.yaml")["pictures"]]
    pictures.insert(1, {**pictures[1], "file": str(tmp_path / "black.png")})
    pictures[0]["light_group"] = pictures[2]["light_group"] = "yard"
    manifest = declared(photographs, pictures=pictures, light="estimated", bootstrap=1)
    for workers in (1, 2):
        records = import_pictures(manifest, tmp_path / str(workers), base=folder, workers=workers)
        assert [record.file for record in records] == [one.file for one in made]
    files = [path.relative_to(tmp_path / "1") for path in (tmp_path / "1" / "train").iterdir()]
    assert len(files) == 12
    for file in files:
        assert (tmp_path / "1" / file).read_bytes() == (tmp_path / "2" / file).read_bytes(), file


def test_scenes_keep_paint_camera_and_that_the_truth_is_unknown(photographs: Photographs, exemplars: Exemplars) -> None:
    for one, scene in zip(photographs[1], exemplars.scenes, strict=True):
        assert scene.weathering == "unknown"
        assert scene.materials == {"body": one.paint}
        # From where the manifest says, within what turning the camera leaves alone: its place.
        assert scene.camera.camera().origin == pytest.approx(one.claimed.camera().origin, abs=1e-6)
    lights = [scene.environment for scene in exemplars.scenes]
    assert [one.asset.path for one in lights] == [f"assets/environments/light of picture {n}.exr" for n in range(4)]
    assert {(one.scale, one.rotation_degrees) for one in lights} == {(1.0, 0.0)}
    assert list(exemplars.layers) == [None] * 4
    assert not any(map(exemplars.weathered, range(4)))


def test_masks_agree_with_good_cameras_and_not_with_bad_ones(photographs: Photographs, imported: Any) -> None:
    _, records = imported
    assert [one.iou is None for one in records] == [False, True, False, True]
    assert all(one.iou > 0.8 for one in records if one.iou is not None)
    assert [one.doubts for one in records] == [()] * 4
    pictures = load_yaml(photographs[0] / "manifest.yaml")["pictures"]
    camera = photographs[1][0].camera.model_dump(mode="json")
    pictures[0]["camera"] = {**camera, "azimuth_degrees": camera["azimuth_degrees"] + 60}
    wrong = declared(photographs, pictures=pictures)
    records = import_pictures(wrong, imported[0].parent / "wrong", base=photographs[0], preview=True)
    assert records[0].iou is not None
    assert records[0].iou < 0.8
    assert "correct the camera or the mask" in records[0].doubts[0]


def test_a_picture_in_known_light_may_show_little(photographs: Photographs, tmp_path: Path) -> None:
    """Nothing is estimated from it, and its fakes get no errors."""
    from svbrdfgan.io.environment import save_environment

    save_environment(tmp_path / "street.exr", torch.full((8, 16, 3), 3.0))
    entry = load_yaml(photographs[0] / "manifest.yaml")["pictures"][0]
    far = {**entry, "environment": str(tmp_path / "street.exr")}
    manifest = declared(photographs, pictures=[far], paint={}, image=[8, 8], bootstrap=2)
    import_pictures(manifest, tmp_path / "own", base=photographs[0])
    errors = load_errors(tmp_path / "own", "train", 1)
    assert errors is not None
    assert torch.equal(errors.values[0, 0].float(), no_errors(8, 8))


def test_cameras_of_masked_pictures_are_refined(photographs: Photographs, tmp_path: Path) -> None:
    pictures = load_yaml(photographs[0] / "manifest.yaml")["pictures"]
    for entry in pictures:
        if "azimuth_degrees" in entry["camera"]:
            entry["camera"] = {**entry["camera"], "azimuth_degrees": entry["camera"]["azimuth_degrees"] + 6}
    changed = declared(photographs, pictures=pictures, refine_cameras=True)
    records = import_pictures(changed, tmp_path / "own", base=photographs[0], preview=True)
    assert [one.refinement is None for one in records] == [one.iou is None for one in records]
    first = records[0].refinement
    assert first is not None
    assert 4 < first.degrees < 9
    assert first.before < 0.93
    assert first.after > 0.96
    assert records[0].iou == pytest.approx(first.after, abs=0.02)


@pytest.mark.full
def test_exposure_of_the_photograph_does_not_matter(photographs: Photographs, tmp_path: Path) -> None:
    """Under the mean light, a picture of half the linear brightness gives the same exemplar."""
    from svbrdfgan.io.exr import save_exr
    from svbrdfgan.io.image import load_image

    entry = load_yaml(photographs[0] / "manifest.yaml")["pictures"][0]
    dimmed = load_image(photographs[0] / entry["file"]) * 0.5
    save_exr(photographs[0] / "dimmed.exr", dict(zip("RGB", dimmed.unbind(-1), strict=True)))
    changed = declared(
        photographs,
        pictures=[{**entry, "file": "dimmed.exr"}],
        paint={photographs[1][0].mesh: list(photographs[1][0].paint)},
    )
    import_pictures(changed, tmp_path / "own", base=photographs[0])
    import_pictures(declared(photographs), tmp_path / "plain", base=photographs[0])
    again, plain = (load_exemplars(Dataset.open(tmp_path / name), "train") for name in ("own", "plain"))
    assert torch.allclose(again.images[0], plain.images[0], rtol=2e-3, atol=2e-3)
    assert {scene.environment.asset.path for scene in plain.scenes} == {"assets/environments/mean of the pool.exr"}


@pytest.mark.full
def test_a_light_is_the_same_every_time(photographs: Photographs, imported: Any, tmp_path: Path) -> None:
    import_pictures(declared(photographs, light="estimated"), tmp_path / "own", base=photographs[0])
    for number in range(4):
        name = f"assets/environments/light of picture {number}.exr"
        assert (tmp_path / "own" / name).read_bytes() == (imported[0] / name).read_bytes()


def test_a_light_that_is_known_is_the_scene_s_own(photographs: Photographs, tmp_path: Path) -> None:
    from svbrdfgan.io.environment import save_environment

    save_environment(tmp_path / "street.exr", torch.full((8, 16, 3), 3.0))
    entry = load_yaml(photographs[0] / "manifest.yaml")["pictures"][0]
    known = {"environment": str(tmp_path / "street.exr"), "environment_rotation_degrees": 40.0}
    changed = declared(photographs, pictures=[{**entry, **known}], paint={}, light="estimated", bootstrap=2)
    import_pictures(changed, tmp_path / "own", base=photographs[0])
    errors = load_errors(tmp_path / "own", "train", 1)
    assert errors is not None
    tint = errors.values[..., :3].float().flatten(0, -2).median(dim=0).values
    assert torch.allclose(tint / tint[1], torch.ones(3), atol=0.05)  # the light has no error; gloss and exposure do
    (scene,) = load_exemplars(Dataset.open(tmp_path / "own"), "train").scenes
    assert scene.environment.asset.path == "assets/environments/own street.exr"
    assert scene.environment.rotation_degrees == 40
    assert scene.environment.scale * 3 == pytest.approx(1.0, rel=1e-3)


def test_fakes_get_errors_like_those_of_the_import(imported: Any, training_data: Any) -> None:
    """A fake of no layer: the errors are those of a bootstrap, and are put on its reflectance, not on its outline."""
    errors = load_errors(imported[0], "train", 4)
    assert errors is not None
    assert errors.values.shape == (4, 2, 48, 48, 8)
    assert errors.values.isfinite().all()
    assert 0.3 < float(errors.values[..., :3].median()) < 3.0
    assert not torch.equal(errors.values[:, 0], errors.values[:, 1])

    renderer, clean, pairs = load_renderer("mitsuba", {"device": "cpu"}), torch.zeros(1, 32, 32, 4), []
    for wanted in (True, False):
        scenes = {"import_errors": wanted}
        config = train_config(training_data(dataset=str(imported[0]), scenes=scenes, renderer="mitsuba"), "here")
        run = resolve_run(config)
        assert run.config.discriminator.compares == "reflectance"
        source = make_batch_source(run, "train", renderer, torch.device("cpu"))
        rng = np.random.default_rng(0)
        pairs.append(make_pair(source, [1], source.scenes([1], rng), clean, source.drawn_errors([1], rng)))
    (real, erring), (same, plain) = pairs
    assert torch.equal(real.image, same.image)
    assert torch.equal(erring.coverage, plain.coverage)
    changed = (erring.image - plain.image)[plain.coverage > 0.5].abs()
    assert float(changed.median()) > 0.01


@pytest.mark.parametrize("scenes", [{}, {"environment": "redrawn", "pool": 2}])
def test_it_trains_and_cannot_be_scored(
    imported: Any, training_data: Any, tmp_path: Path, exemplars: Exemplars, scenes: dict[str, Any]
) -> None:
    folder = imported[0]
    config = train_config(training_data(dataset=str(folder), scenes=scenes, renderer="mitsuba", steps=2), "here")
    state = train(config, tmp_path / "run")
    assert state.step == 2
    assert (tmp_path / "run" / "model.safetensors").is_file()
    with pytest.raises(AssetError, match="nothing can be scored"):
        evaluate(tmp_path / "run", split="train", oracle=False, device="cpu")


def test_a_run_says_what_the_next_import_expects(
    photographs: Photographs, imported: Any, training_data: Any, tmp_path: Path
) -> None:
    """In turns: a run learns, pictures are imported once more by what it paints, and the next run goes on from it."""
    changes = {"renderer": "mitsuba", "steps": 1}
    train(train_config(training_data(dataset=str(imported[0]), **changes), "here"), tmp_path / "run")
    again = declared(photographs, light="estimated", bootstrap=1, model=str(tmp_path / "run"))
    import_pictures(again, tmp_path / "own", base=photographs[0])
    light = "assets/environments/light of picture 0.exr"
    assert (tmp_path / "own" / light).read_bytes() != (imported[0] / light).read_bytes()
    errors = load_errors(tmp_path / "own", "train", 4)
    assert errors is not None
    assert errors.values.isfinite().all()
    following = training_data(dataset=str(tmp_path / "own"), init=str(tmp_path / "run"), **changes)
    assert train(train_config(following, "here"), tmp_path / "next").step == 1

    embedding = {"name": "hemispherical", "resolution": 16}
    other = declared(photographs, model=str(tmp_path / "run"), embedding=embedding)
    with pytest.raises(ConfigError, match="model: it was trained with the embedding"):
        import_pictures(other, tmp_path / "other", base=photographs[0])
    with pytest.raises(AssetError, match=r"^model: .*is not a run"):
        import_pictures(declared(photographs, model="nothing"), tmp_path / "other", base=photographs[0])


@pytest.mark.full
def test_meshes_named_in_test_are_kept_from_training(photographs: Photographs, tmp_path: Path) -> None:
    import_pictures(declared(photographs, test=[photographs[1][0].mesh]), tmp_path / "own", base=photographs[0])
    plan = DatasetIndex.load(tmp_path / "own")
    assert [mesh.name for mesh in plan.meshes["train"]] == ["car_1"]
    assert [mesh.name for mesh in plan.meshes["test"]] == ["car_0"]
    assert len(load_exemplars(Dataset.open(tmp_path / "own"), "test")) == 2


@pytest.mark.full
def test_views_may_differ_from_mesh_to_mesh(photographs: Photographs, tmp_path: Path) -> None:
    """And pictures of one mesh follow each other, in any order of the manifest."""
    entries = load_yaml(photographs[0] / "manifest.yaml")["pictures"]
    mixed = [entries[2], entries[0], entries[3]]
    records = import_pictures(declared(photographs, pictures=mixed), tmp_path / "own", base=photographs[0])
    assert [one.exemplar for one in records] == ["train/000000", "train/000002", "train/000001"]
    sampler = DatasetIndex.load(tmp_path / "own").sampler("train")
    assert [sampler.mesh(n).name for n in range(len(sampler))] == ["car_1", "car_1", "car_0"]
    stored = [Scene.load(tmp_path / "own" / f"{one.exemplar}.json").mesh.path for one in records]
    assert [Path(path).stem for path in stored] == ["car_1", "car_0", "car_1"]


def test_dataset_does_not_make_what_only_import_can(imported: Any, tmp_path: Path) -> None:
    config: DatasetConfig = DatasetIndex.load(imported[0]).config
    assert config.weathering is None
    with pytest.raises(ConfigError, match="name a recipe"):
        generate(config, tmp_path / "other", base=tmp_path)
