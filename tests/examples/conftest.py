"""The Blender of the tests of assets."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "asset"))
