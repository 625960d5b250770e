"""One training step, and the state that it changes."""

from __future__ import annotations

import copy
import errno
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.conditions import labels_of_scenes
from svbrdfgan.errors import AssetError, ConfigError, TrainingError
from svbrdfgan.training.batches import BatchSource, make_batch_source
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.training.discriminator_batch import ImageBatch, octaves_of
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.state import State, checkpoints
from svbrdfgan.training.step import Diagnostics, draw_seeds, make_pair, step_rng, training_step

Data = Callable[..., dict[str, Any]]
CPU = torch.device("cpu")
LOSSES: dict[str, dict[str, Any]] = {
    "vanilla": {},
    "lsgan": {},
    "relativistic": {"r1": 0.1, "r2": 0.1},
    "wgan": {"r1": 0.0, "gradient_penalty": 10.0, "critic_steps": 2},
}


@pytest.fixture(scope="module")
def config(training_data: Data) -> Callable[..., TrainConfig]:
    return lambda **changes: train_config(training_data(**changes), "here")


@pytest.fixture(scope="module")
def source(config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path) -> BatchSource:
    return make_batch_source(resolve_run(config()), "train", cpu_renderer, CPU)


def run_steps(
    config: TrainConfig, state: State, source: BatchSource, steps: int, batch: Sequence[int] = (0, 4)
) -> list[Diagnostics]:
    fabric = Fabric(accelerator="cpu", devices=1)
    return [training_step(fabric, config, state, source, [batch] * config.loss.critic_steps) for _ in range(steps)]


def weights(state: State) -> dict[str, Tensor]:
    return {name: tensor.clone() for name, tensor in state._tensors().items()}


def test_a_texture_that_cannot_be_halved_so_often_is_refused(config: Callable[..., TrainConfig]) -> None:
    resolve_run(config(generator={"downsamplings": 3}))
    with pytest.raises(ConfigError, match=r"downsamplings: a texture of 32 texels cannot be halved 4 times"):
        resolve_run(config(generator={"downsamplings": 4}))


def test_a_step_changes_all_that_learns(config: Callable[..., TrainConfig], source: BatchSource) -> None:
    state = State.fresh(config(), CPU)
    before = weights(state)
    (reports,) = run_steps(config(), state, source, 1)
    after = weights(state)
    for network in ("generator", "discriminator", "averaged"):
        names = [name for name in before if name.startswith(f"{network}.") and name.endswith("weight")]
        assert names
        assert all(not torch.equal(before[name], after[name]) for name in names), network
    assert state.step == 1
    assert {"d_loss", "g_loss", "d_real", "d_fake", "d_accuracy", "d_penalty"} <= reports.keys()
    assert not any(value.requires_grad for value in reports.values())


@pytest.mark.parametrize("name", LOSSES)
def test_every_loss_runs(name: str, config: Callable[..., TrainConfig], source: BatchSource) -> None:
    chosen = config(loss={"name": name, **LOSSES[name]})
    state = State.fresh(chosen, CPU)
    for reports in run_steps(chosen, state, source, 3):
        assert all(bool(value.isfinite()) for value in reports.values())


@pytest.fixture
def taught(
    config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path
) -> tuple[TrainConfig, State, BatchSource, list[dict[str, Any]]]:
    """A discriminator after 80 steps against a generator that stands still, and the reports of these steps."""
    rates, plain = {"generator_rate": 1e-12, "discriminator_rate": 3e-3}, {"compares": "radiance"}
    chosen = config(optimizer=rates, loss={"r1": 0.0}, discriminator=plain)
    source, state = make_batch_source(resolve_run(chosen), "train", cpu_renderer, CPU), State.fresh(chosen, CPU)
    return chosen, state, source, run_steps(chosen, state, source, 80)


def test_the_discriminator_learns_to_tell(taught: tuple[Any, ...]) -> None:
    *_, reports = taught
    margins = [float(report["d_real"] - report["d_fake"]) for report in reports]
    assert sum(margins[-20:]) / 20 > 1.0 > abs(margins[0]) + 0.9, "each step draws backgrounds, so one tells little"


def test_the_generator_learns_to_fool(taught: tuple[Any, ...]) -> None:
    """A discriminator that has learned, and then stands still."""
    learning, state, source, _ = taught
    for group in state.generator_adam.param_groups:
        group["lr"] = 1e-2
    for group in state.discriminator_adam.param_groups:
        group["lr"] = 1e-12
    reports = run_steps(learning, state, source, 15)
    assert reports[-1]["g_loss"] < 0.8 * reports[0]["g_loss"]


def test_the_same_seed_gives_the_same_run(config: Callable[..., TrainConfig], source: BatchSource) -> None:
    states = [State.fresh(config(), CPU) for _ in range(2)]
    for state in states:
        run_steps(config(), state, source, 3)
    one, other = map(weights, states)
    assert all(torch.equal(one[name], other[name]) for name in one)
    elsewhere = State.fresh(config(seed=1), CPU)
    assert not torch.equal(elsewhere.generator.first.weight, State.fresh(config(), CPU).generator.first.weight)


@pytest.mark.parametrize("compares", ["radiance", "reflectance"])
def test_chance_and_conditions_learn(
    compares: str, config: Callable[..., TrainConfig], cpu_renderer: Any, varied_dataset: Path
) -> None:
    """Both sides are shown the exemplar's own conditions, and each step draws other seeds."""
    small, plain = {"width": 4, "blocks": 1, "random_fields": 2}, {"compares": compares}
    chosen = config(dataset=str(varied_dataset), generator=small, discriminator=plain)
    resolved = resolve_run(chosen)
    source = make_batch_source(resolved, "train", cpu_renderer, CPU)
    labels = source.labels([0, 4])
    assert labels is not None
    assert torch.equal(labels, labels_of_scenes(resolved.conditions, [source.exemplars.scenes[n] for n in (0, 4)]))
    state = State.fresh(chosen, CPU, labels=resolved.conditions.size)
    painted = torch.rand(2, 32, 32, 4)
    for side in make_pair(source, [0, 4], source.scenes([0, 4], np.random.default_rng(0)), painted):
        assert side.labels is not None
        assert torch.equal(side.labels, labels)
    before = weights(state)
    run_steps(chosen, state, source, 2)
    modulation = [name for name in before if name.startswith("generator.modulation")]
    assert modulation
    assert all(not torch.equal(before[name], state._tensors()[name]) for name in modulation)
    drawn = [draw_seeds(step_rng(Fabric(accelerator="cpu"), chosen, step, 0), 2, CPU) for step in (0, 0, 1)]
    assert torch.equal(drawn[0], drawn[1])
    assert drawn[0].min() >= 0
    assert len({*drawn[0].tolist(), *drawn[2].tolist()}) == 4


def test_seeds_take_no_random_numbers_of_the_scenes(config: Callable[..., TrainConfig]) -> None:
    one, other = (step_rng(Fabric(accelerator="cpu"), config(), 3, 0) for _ in range(2))
    draw_seeds(one, 5, CPU)
    assert one.random() == other.random()


def test_moments_from_a_file_lie_as_the_weights_do(
    config: Callable[..., TrainConfig], source: BatchSource, tmp_path: Path
) -> None:
    """A fused step goes over memory, not over indices."""
    state, loaded = State.fresh(config(), CPU), State.fresh(config(), CPU)
    run_steps(config(), state, source, 2)
    state.save(tmp_path)
    loaded.load(checkpoints(tmp_path)[-1])
    for adam in (loaded.generator_adam, loaded.discriminator_adam):
        for parameter, moments in adam.state.items():
            assert moments["exp_avg"].stride() == moments["exp_avg_sq"].stride() == parameter.stride()
    run_steps(config(), state, source, 1)
    run_steps(config(), loaded, source, 1)
    one, other = weights(state), weights(loaded)
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_a_checkpoint_on_a_full_disk_is_one_sentence_and_leaves_the_one_before(
    config: Callable[..., TrainConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = State.fresh(config(), CPU)
    state.save(tmp_path)
    state.step = 7

    def full(path: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(
        AssetError, match=r"step_00000007 cannot be written \(No space left on device\); check the folder"
    ):
        state.save(tmp_path)
    assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["step_00000000"]


def test_penalties_come_when_told(config: Callable[..., TrainConfig], source: BatchSource) -> None:
    chosen = config(loss={"r1": 0.5, "penalty_every": 2})
    reports = run_steps(chosen, State.fresh(chosen, CPU), source, 4)
    assert ["d_penalty" in one for one in reports] == [True, False, True, False]


def test_real_and_fake_stand_before_the_same_background() -> None:
    image, background = torch.zeros(2, 4, 4, 3), torch.rand(2, 3)
    shown = ImageBatch(image, torch.zeros(2, 4, 4), None).tone_mapped(background)
    assert torch.equal(shown, shown[:, :, :1, :1].expand_as(shown))
    assert not torch.equal(shown[0], shown[1])
    grey = (ImageBatch(torch.full((1, 1, 1, 3), v), torch.ones(1, 1, 1), None) for v in (0.0, 1.0))
    black, white = (image.tone_mapped(background[:1]) for image in grey)
    torch.testing.assert_close(black, torch.full((1, 3, 1, 1), -1.0))
    torch.testing.assert_close(white, torch.full((1, 3, 1, 1), 1.0))


def test_buffers_follow_the_picture_as_channels() -> None:
    """The G-buffer as it is, the light buffer with the picture's tone curve and without its background."""
    gbuffer, light = torch.randn(1, 4, 4, 6), torch.zeros(1, 4, 4, 9)
    light[..., 3:] = 1.0
    given = ImageBatch(torch.zeros(1, 4, 4, 3), torch.zeros(1, 4, 4), gbuffer, light)
    shown = given.tone_mapped(torch.full((1, 3), 0.5))[0].permute(1, 2, 0)
    assert shown.shape == (4, 4, 18)
    assert torch.equal(shown[..., 3:9], gbuffer[0])
    torch.testing.assert_close(shown[..., 9:12], torch.full((4, 4, 3), -1.0))
    torch.testing.assert_close(shown[..., 12:], torch.full((4, 4, 6), 1.0))
    both = ImageBatch.cat([given.pick([0, 0]), given])
    assert both.light_buffer is not None
    assert both.light_buffer.shape == (3, 4, 4, 9)


def test_a_clean_picture_is_shown_as_the_difference_from_it() -> None:
    """The background is the same in both, so it never shows there."""
    image = torch.rand(2, 4, 4, 3)
    coverage = torch.ones(2, 4, 4)
    coverage[:, 2:], image[:, 2:] = 0.0, 0.0
    given = ImageBatch(image, coverage, None, clean=torch.cat([image[:1], 0.5 * image[1:]]))
    same, brighter = given.pick([1, 0]).tone_mapped(torch.rand(2, 3)).flip(0)
    assert same.shape == (6, 4, 4)
    assert not same[3:].any()
    assert brighter[3:, :2].min() > 0
    assert not brighter[3:, 2:].any()
    joined = ImageBatch.cat([given, given]).clean
    assert joined is not None
    assert joined.shape == (4, 4, 4, 3)


def test_octaves_of_the_difference_are_shown_steeper() -> None:
    """A checkerboard of two pixels lies in the second finest octave, and one of single pixels in none of them."""
    row, col = torch.meshgrid(torch.arange(32), torch.arange(32), indexing="ij")
    boards = [((row // side + col // side) % 2).float() - 0.5 for side in (1, 2)]
    images = torch.stack(boards)[..., None].expand(2, 32, 32, 3)
    power = torch.stack([octave.square().mean(dim=(1, 2, 3)) for octave in octaves_of(images, 3)])
    assert (power > 1e-12).tolist() == [[False, True], [False, False], [False, False]]
    batch = ImageBatch(torch.rand(2, 9, 13, 3), torch.ones(2, 9, 13), clean=torch.rand(2, 9, 13, 3))
    shown = batch.tone_mapped(torch.rand(2, 3), octaves=2).permute(0, 2, 3, 1)
    assert shown.shape == (2, 9, 13, 12)
    steeper = torch.cat([8.0 * octave for octave in octaves_of(shown[..., 3:6], 2)], dim=-1)
    assert torch.allclose(shown[..., 6:], steeper, atol=1e-6)


def test_octaves_need_a_clean_picture(config: Callable[..., TrainConfig]) -> None:
    with pytest.raises(ConfigError, match="clean_picture: true"):
        config(rendering="online", discriminator={"octaves": 2})


def test_pixel_sizes_and_labels_are_planes_after_the_buffers() -> None:
    labels, sizes = torch.tensor([[0.5, -1.0], [0.0, 1.0]]), torch.tensor([[0.25], [-0.75]])
    given = ImageBatch(torch.zeros(2, 4, 4, 3), torch.zeros(2, 4, 4), None, labels=labels, pixel_size=sizes)
    shown = given.pick([1, 0]).tone_mapped(torch.zeros(2, 3))
    assert shown.shape == (2, 6, 4, 4)
    wanted = torch.cat([sizes, labels], dim=1).flip(0)
    assert torch.equal(shown[:, 3:], wanted[:, :, None, None].expand(2, 3, 4, 4))


@pytest.mark.parametrize(
    ("shown", "channels"),
    [
        ((), 3),
        (("gbuffer",), 9),
        (("gbuffer", "light_buffer"), 18),
        (("gbuffer", "light_buffer", "clean_picture"), 21),
        (("pixel_size",), 4),
    ],
)
def test_the_discriminator_has_channels_for_what_it_is_shown(
    shown: tuple[str, ...], channels: int, config: Callable[..., TrainConfig]
) -> None:
    for octaves in (0, 2) if "clean_picture" in shown else (0,):
        given = {"gbuffer": False, "octaves": octaves, **dict.fromkeys(shown, True)}
        state = State.fresh(config(rendering="online", discriminator=given), CPU)
        first = next(m for m in state.discriminator.modules() if isinstance(m, torch.nn.Conv2d))
        assert first.in_channels == channels + 3 * octaves


def test_a_step_in_other_light_is_taken_beside_the_light_buffer(
    config: Callable[..., TrainConfig], cpu_renderer: Any
) -> None:
    chosen = config(
        rendering="online",
        discriminator={"gbuffer": True, "light_buffer": True},
        scenes={"environment": "redrawn"},
        spp=2,
    )
    source = make_batch_source(resolve_run(chosen), "train", cpu_renderer, CPU)
    state = State.fresh(chosen, CPU)
    before = weights(state)
    run_steps(chosen, state, source, 1)
    after = weights(state)
    assert any(not torch.equal(before[n], after[n]) for n in before if n.startswith("generator."))
    first = next(m for m in state.discriminator.modules() if isinstance(m, torch.nn.Conv2d))
    moved = after["discriminator." + _name(state, first)] - before["discriminator." + _name(state, first)]
    assert (moved[:, 9:] != 0).any()  # it learns from the light buffer's channels


def _name(state: State, layer: torch.nn.Module) -> str:
    return next(name for name, module in state.discriminator.named_modules() if module is layer) + ".weight"


def test_the_tone_curve_never_loses_a_gradient() -> None:
    image = torch.linspace(0, 50, 64).reshape(1, 8, 8, 1).expand(1, 8, 8, 3).clone().requires_grad_(True)
    ImageBatch(image, torch.ones(1, 8, 8), None).tone_mapped(torch.zeros(1, 3)).sum().backward()
    assert image.grad is not None
    assert (image.grad > 0).all()


def test_fresh_rendering_has_the_gradient_of_the_transport(
    config: Callable[..., TrainConfig], cpu_renderer: Any, tiny_dataset: Path
) -> None:
    """The same scenes drawn, the same samples: the same pictures, and the same first gradient of the generator."""
    kinds = {
        "stored": config(
            scenes={"pool": 0},
            discriminator={"gbuffer": False, "compares": "radiance"},
            optimizer={"discriminator_rate": 1e-12},
        ),
        "online": config(rendering="online", discriminator={"gbuffer": False}, optimizer={"discriminator_rate": 1e-12}),
    }
    gradients, pictures = [], []
    for chosen in kinds.values():
        source = make_batch_source(resolve_run(chosen), "train", cpu_renderer, CPU)
        state = State.fresh(chosen, CPU)
        scenes = source.scenes([0, 4], np.random.default_rng([chosen.seed, 0, 0, 0]))
        with torch.no_grad():
            pictures.append(scenes.render(state.generator.paint(source.inputs([0, 4]))))
        run_steps(chosen, state, source, 1)
        gradients.append([p.grad.clone() for p in state.generator.parameters() if p.grad is not None])
    torch.testing.assert_close(pictures[0], pictures[1], rtol=1e-4, atol=1e-4)
    assert len(gradients[0]) == len(gradients[1]) > 5
    scale = max(float(g.abs().max()) for g in gradients[0])
    assert scale > 0
    for stored, rendered in zip(*gradients, strict=True):
        torch.testing.assert_close(stored, rendered, rtol=1e-3, atol=1e-4 * scale)


def test_a_matched_fake_of_the_truth_is_the_exemplar_but_for_noise(source: BatchSource) -> None:
    """G0's own layer through the training transports gives back the stored pictures: nothing is turned or shifted."""
    layers = torch.stack([layer.values for layer in source.exemplars.layers if layer is not None])
    scenes = source.scenes(range(6), np.random.default_rng(0))
    fake, coverage = scenes.render(layers)
    noise = (fake - source.real.image.float()).abs().mean()
    turned = (fake.flip(2) - source.real.image.float()).abs().mean()
    assert noise < 0.35 * turned
    torch.testing.assert_close(fake.mean(dim=(1, 2)), source.real.image.float().mean(dim=(1, 2)), rtol=0.15, atol=0.01)
    assert (coverage - source.real.coverage.float()).abs().mean() < 0.03
    assert source.real.gbuffer is not None
    assert (source.real.gbuffer[:, 0, 0] == 0).all()


@pytest.mark.parametrize("step", [1, 3])
def test_a_checkpoint_returns_as_it_was(
    step: int, config: Callable[..., TrainConfig], source: BatchSource, tmp_path: Path
) -> None:
    state = State.fresh(config(), CPU)
    run_steps(config(), state, source, step)
    state.best, state.seconds, state.history = (0.25, 1), 3.5, [{"step": 1, "seconds": 1.0, "recovered": 0.25}]
    state.save(tmp_path)
    other = State.fresh(config(seed=9), CPU)
    other.load(checkpoints(tmp_path)[-1])
    assert weights(state).keys() == weights(other).keys()
    assert all(torch.equal(tensor, weights(other)[name]) for name, tensor in weights(state).items())
    assert (other.step, other.best, other.seconds, other.history) == (step, (0.25, 1), 3.5, state.history)
    run_steps(config(), state, source, 1)
    run_steps(config(), other, source, 1)
    assert all(torch.equal(tensor, weights(other)[name]) for name, tensor in weights(state).items())


def test_the_latest_two_checkpoints_are_kept(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    state = State.fresh(config(), CPU)
    for state.step in (5, 10, 15):
        state.save(tmp_path)
    assert [path.name for path in checkpoints(tmp_path)] == ["step_00000010", "step_00000015"]
    assert sorted(path.name for path in (tmp_path / "checkpoints").iterdir()) == ["step_00000010", "step_00000015"]


@pytest.mark.parametrize("damage", ["cut", "trash", "json", "gone"])
def test_a_damaged_checkpoint_is_one_sentence(damage: str, config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    state = State.fresh(config(), CPU)
    state.save(tmp_path)
    (checkpoint,) = checkpoints(tmp_path)
    tensors = checkpoint / "state.safetensors"
    if damage == "cut":
        tensors.write_bytes(tensors.read_bytes()[:-100])
    elif damage == "trash":
        tensors.write_bytes(b"x" * 500)
    elif damage == "json":
        (checkpoint / "state.json").write_text("{")
    else:
        tensors.unlink()
    with pytest.raises(AssetError, match=r"is damaged .*delete it to resume from the one before") as caught:
        state.load(checkpoint)
    assert len(str(caught.value).splitlines()) == 1


COUNTERS: dict[str, Any] = {"step": 3, "seconds": 2.0, "best": [0.5, 2], "history": [{"step": 2, "seconds": 1.0}]}


@pytest.mark.parametrize(
    "doctored",
    [
        None,
        [],
        {},
        COUNTERS | {"step": "3"},
        COUNTERS | {"step": -3},
        COUNTERS | {"step": 10**18},
        COUNTERS | {"seconds": -1},
        COUNTERS | {"best": None},
        COUNTERS | {"best": [0.5]},
        COUNTERS | {"history": {"step": 1}},
        COUNTERS | {"history": [{"step": 2}]},
        COUNTERS | {"history": [[[[[]]]]]},
        COUNTERS | {"more": 1},
    ],
)
def test_doctored_counters_are_one_sentence(doctored: Any, config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    state = State.fresh(config(), CPU)
    state.step = 3
    state.save(tmp_path)
    (checkpoint,) = checkpoints(tmp_path)
    (checkpoint / "state.json").write_text(json.dumps(doctored))
    with pytest.raises(AssetError, match=r"is damaged .*delete it to resume from the one before") as caught:
        state.load(checkpoint)
    assert len(str(caught.value).splitlines()) == 1


def test_a_checkpoint_without_moments_is_refused(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    state = State.fresh(config(), CPU)
    state.save(tmp_path)
    state.load(checkpoints(tmp_path)[-1])  # before the first step there are none
    state.step = 3
    state.save(tmp_path)
    with pytest.raises(TrainingError, match="it has no generator_adam"):
        state.load(checkpoints(tmp_path)[-1])


def test_folders_of_other_names_are_no_checkpoints(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    State.fresh(config(), CPU).save(tmp_path)
    for name in ("step_abc", "step_", "step_00000001x", "abc"):
        (tmp_path / "checkpoints" / name).mkdir()
    assert [path.name for path in checkpoints(tmp_path)] == ["step_00000000"]


def test_a_checkpoint_of_other_networks_is_refused(config: Callable[..., TrainConfig], tmp_path: Path) -> None:
    State.fresh(config(), CPU).save(tmp_path)
    with pytest.raises(TrainingError, match="of other networks"):
        State.fresh(config(generator={"blocks": 2}), CPU).load(checkpoints(tmp_path)[0])


def test_the_average_moves_half_the_way_in_a_half_life(config: Callable[..., TrainConfig]) -> None:
    state = State.fresh(config(), CPU)
    start = copy.deepcopy(state.averaged)
    with torch.no_grad():
        for parameter in state.generator.parameters():
            parameter += 1.0
    state.step = 10**6
    for _ in range(4):
        state.average(batch_size=5, half_life=20.0)
    moved = [(a - b) for a, b in zip(state.averaged.parameters(), start.parameters(), strict=True)]
    assert all(torch.allclose(m, torch.full_like(m, 0.5), atol=1e-5) for m in moved)
    state.average(batch_size=5, half_life=0.0)
    pairs = zip(state.averaged.parameters(), state.generator.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)


def test_more_pairs_are_augmented_only_while_the_discriminator_tells_too_many_apart(
    config: Callable[..., TrainConfig],
) -> None:
    state = State.fresh(config(), CPU)
    for _ in range(400):
        state.adapt(torch.tensor(0.55), 16)
    assert state.augmented == 0
    for _ in range(1000):
        state.adapt(torch.tensor(0.8), 16)
    assert state.augmented == 1, "4,000 images are enough"
    for _ in range(200):
        state.adapt(torch.tensor(0.5), 16)
    assert 0.2 < state.augmented < 0.7


def test_augmentation_is_in_the_log_and_the_checkpoint_and_can_be_left_out(
    config: Callable[..., TrainConfig], source: BatchSource, tmp_path: Path
) -> None:
    def after(**changes: Any) -> tuple[State, Diagnostics]:
        state = State.fresh(config(**changes), CPU)
        state.augmented.fill_(0.75)
        return state, run_steps(config(**changes), state, source, 1)[0]

    state, report = after()
    assert float(report["d_augmented"]) == pytest.approx(0.75, abs=0.01)
    state.save(tmp_path)
    again = State.fresh(config(), CPU)
    again.load(checkpoints(tmp_path)[-1])
    assert torch.equal(again.augmented, state.augmented)
    assert torch.equal(again.accuracy, state.accuracy)
    plain, report = after(discriminator={"augment": False})
    assert "d_augmented" not in report
    assert any(not torch.equal(tensor, weights(plain)[name]) for name, tensor in weights(state).items())
