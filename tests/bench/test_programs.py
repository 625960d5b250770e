"""Programs get their work by their command, and their output is read."""

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from svbrdfgan.bench import BenchError
from svbrdfgan.bench.cases import Case, axes
from svbrdfgan.bench.programs import Figures, Program, faster
from svbrdfgan.errors import ConfigError

STANDARD = Case("standard", 1_000_000, 256, 16)
LINE = {"peer": "other", "spp": 16, "forward_s": 0.5, "forward_backward_s": 2, "prepare_s": 1.5, "unheard_of": "x"}


def peer(code: str, *arguments: str) -> Program:
    return Program.peer(shlex.join([sys.executable, "-S", "-c", code, *arguments]))


def test_a_command_is_filled_in() -> None:
    code = "import json, sys; print('warming up'); print(json.dumps({**json.loads(sys.argv[1]), 'peer': sys.argv[2]}))"
    filled = peer(code, json.dumps(LINE), "{scene}|--spp={spp}|{batch}|{repeats}")
    figures = filled.run(STANDARD, Path("a b/scene.npz"), 7)
    assert figures.name == "a b/scene.npz|--spp=16|1|7"
    assert figures.seconds == {"prepare": 1.5, "forward": 0.5, "forward_backward": 2}
    assert (figures.peak_bytes, figures.device) == ({}, "")


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("pass", "no figures in its last line: 'it printed nothing' is not JSON."),
        ("print('done')", "no figures in its last line: 'done' is not JSON."),
        ("print([1])", r"\[1\] is not an object"),
        ("print('{\"spp\": 16}')", "'forward_s' is missing"),
        (f"print('''{json.dumps({**LINE, 'spp': 4})}''')", "it took 4 samples per pixel, wanted 16"),
        (f"print('''{json.dumps({**LINE, 'forward_s': 0})}''')", "forward_s is 0; wanted a positive number"),
        (f"print('''{json.dumps({**LINE, 'prepare_s': float('nan')})}''')", "prepare_s is nan; wanted"),
        (f"print('''{json.dumps({**LINE, 'forward_s': '1'})}''')", "forward_s is '1'; wanted"),
        ("import sys; sys.exit('no licence')", "failed with exit code 1: no licence"),
    ],
)
def test_what_is_no_figures_is_one_sentence(code: str, said: str) -> None:
    with pytest.raises(BenchError, match=said) as error:
        peer(code).run(STANDARD, Path("scene.npz"), 1)
    assert len(str(error.value).splitlines()) == 1


def test_a_program_that_is_not_there() -> None:
    with pytest.raises(BenchError, match="peer 'no-such-program' cannot be run: No such file"):
        Program.peer("no-such-program").run(STANDARD, Path("scene.npz"), 1)


@pytest.mark.parametrize("command", ["", "python 'unfinished"])
def test_what_is_no_command(command: str) -> None:
    with pytest.raises(ConfigError, match="command"):
        Program.peer(command)


@pytest.mark.parametrize(
    ("command", "case", "fits"),
    [
        ("peer", STANDARD, True),
        ("peer", replace(STANDARD, spp=200), False),
        ("peer --spp {spp}", replace(STANDARD, spp=200), True),
        ("peer --spp {spp}", replace(STANDARD, pixels=128), False),
        ("peer {scene}", replace(STANDARD, vertices=10_000), True),
        ("peer {scene} --spp {spp}", Case("car.glb", None, 256, 200), True),
        ("peer {scene} --spp {spp}", replace(STANDARD, batch=4), False),
        ("peer {scene} -b {batch}", replace(STANDARD, batch=4), True),
    ],
)
def test_a_peer_is_given_what_it_can_be_told(command: str, case: Case, fits: bool) -> None:
    assert Program.peer(command).fits(case, spp=16) is fits


def test_the_faster_of_two_runs_counts_step_by_step() -> None:
    before, after = (
        Figures("p", "cpu", {"forward": a, "forward_backward": b}, {}, {}) for a, b in ((1.0, 4.0), (2.0, 3.0))
    )
    assert faster(before, after).seconds == {"forward": 1.0, "forward_backward": 3.0}


def test_one_axis_is_varied_at_a_time() -> None:
    on_gpu = axes(STANDARD, gpu=True)
    assert [case.vertices for case in on_gpu["vertices"]] == [10_000, 100_000, 1_000_000, 4_000_000]
    assert [case.spp for case in on_gpu["spp"]] == [1, 4, 16, 64, 256]
    on_cpu = axes(STANDARD, gpu=False)
    assert {axis: len(cases) for axis, cases in on_cpu.items()} == {"vertices": 3, "pixels": 4, "spp": 4, "batch": 3}
    for axis, cases in on_gpu.items():
        assert STANDARD in cases
        assert all(replace(case, **{axis: getattr(STANDARD, axis)}) == STANDARD for case in cases)
