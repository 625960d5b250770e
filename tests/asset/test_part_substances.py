"""What faces are made of, and what recipes lie on of what is kept."""

from pathlib import Path

import numpy as np

from svbrdfgan.asset.part_substances import face_substances, settled
from svbrdfgan.asset.verdicts import Verdict
from svbrdfgan.inference.workpiece import open_workpiece
from svbrdfgan.io.gltf.document import write_document
from svbrdfgan.io.gltf.surface_files import mesh_document
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.weathering.recipes import Dust, Rust
from svbrdfgan.weathering.substances import Substance


def _verdict(kind: str, reason: str = "called so", *, weathers: bool = False) -> Verdict:
    return Verdict(0, "a part", weathers, kind, reason, 0.1, sure=True)


def test_dust_lies_on_glass_and_tyres_and_rust_does_not() -> None:
    verdicts = [_verdict(kind) for kind in ("glass", "tyre", "rim", "interior", "decal", "ground")]
    assert [verdict.weathers for verdict in settled(verdicts, Dust.settles_on)] == [True] * 3 + [False] * 3
    assert not any(verdict.weathers for verdict in settled(verdicts, Rust.settles_on))


def test_what_the_user_keeps_stays_kept() -> None:
    verdicts = [_verdict("kept", "--keep '*'"), _verdict("glass", "the mask"), _verdict("body", weathers=True)]
    assert [verdict.weathers for verdict in settled(verdicts, Dust.settles_on)] == [False, False, True]


def test_faces_have_the_substance_of_their_part_and_in_wheels_of_their_place(tmp_path: Path) -> None:
    path = tmp_path / "car.glb"
    write_document(path, mesh_document(path, build_vehicle(sample_vehicle("van", 5))))
    workpiece = open_workpiece(path)
    found = face_substances(workpiece.asset, workpiece.verdicts, workpiece.mesh)
    by_kind = {verdict.kind: set(found[workpiece.asset.face_piece == verdict.piece]) for verdict in workpiece.verdicts}
    assert by_kind["glass"] == {Substance.GLASS}
    assert by_kind["tyre"] == {Substance.RUBBER}
    same = [_verdict("body", weathers=True)] * len(workpiece.verdicts)
    by_place = face_substances(workpiece.asset, same, workpiece.mesh)
    assert set(by_place[found == Substance.GLASS]) == {Substance.PAINT}
    assert np.mean(by_place[found == Substance.RUBBER] == Substance.RUBBER) > 0.9
