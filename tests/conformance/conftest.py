"""Lets the tests of conformance say `import tiers`."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
