"""Makes this folder's helper module importable: the suite runs with importlib's import mode, which adds no paths."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
