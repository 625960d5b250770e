"""What the page of many machines says of Dask works, with processes of this one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.data.test_shards import assert_same


@pytest.mark.full
def test_dask_makes_the_shards(
    code_blocks: Callable[[str, str], list[str]],
    dataset_data: Callable[..., dict[str, Any]],
    tiny_dataset: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from distributed import Client, LocalCluster

    monkeypatch.chdir(tmp_path)
    Path("dataset.yaml").write_text(json.dumps(dataset_data()))
    (block,) = code_blocks("docs/many-machines.md", "python")
    names: dict[str, Any] = {}
    exec(compile(block, "docs/many-machines.md", "exec"), names)
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        client.gather(client.map(names["make"], names["shards"]))
    names["sg"].merge_shards([Path("data/cars")])
    assert_same(Path("data/cars"), tiny_dataset)
