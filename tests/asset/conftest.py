"""Lets the tests of assets say `import documents`, and so on."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
