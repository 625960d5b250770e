"""Makes `import gltf` work in this folder's tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))
