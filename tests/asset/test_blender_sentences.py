"""The judge of files in Blender says what it should of two files, without Blender."""

import numpy as np
from blender import Opened, sentences


def _opened(**materials: list[str]) -> Opened:
    objects: dict[str, dict[str, object]] = {
        name: {"materials": slots, "vertices": 3} for name, slots in materials.items()
    }
    objects["lamp"] = {"matrix": np.eye(4)}
    return Opened(objects, sorted({slot for slots in materials.values() for slot in slots}), {}, np.zeros((1, 1, 3)))


def test_a_new_material_is_a_difference_except_where_there_was_none() -> None:
    before = _opened(body=["paint"], ball=[])
    assert sentences(before, _opened(body=["paint (weathered)"], ball=["ball"])) == []
    assert sentences(before, _opened(body=["steel"], ball=[])) == [
        "object 'body': its materials was ['paint'], is ['steel'].",
        "material 'paint' is gone.",
        "material 'steel' is new.",
    ]
    assert sentences(before, _opened(body=["paint"], ball=["paint"])) == [
        "object 'ball': its materials was [], is ['paint']."
    ]
    assert sentences(before, _opened(body=["paint"], ball=["a", "b"]))[0].endswith("is ['a', 'b'].")
