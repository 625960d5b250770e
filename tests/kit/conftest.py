"""Lets the tests of the kits say `import wrong`."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
